"""Writes a plugin to start from, with its test: into this repository, into a folder, or as a package of its own."""

import builtins
import importlib.util
import keyword
import re
import shlex
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sucre_bench import plugins
from sucre_bench.errors import InputError, OutputError
from sucre_bench.machine.files import write_atomically
from sucre_bench.plugins.plugin import Kind
from sucre_bench.programs.contract.outcome_text import shown_path

_TEMPLATES = Path(__file__).with_name("templates")


@dataclass(frozen=True)
class Written:
    """The files of a new plugin, and the next commands with their purposes."""

    files: tuple[Path, ...]
    commands: tuple[tuple[str, str], ...]


def checkout_of(folder: Path) -> Path | None:
    """Return the checkout of this repository that holds a folder, or None."""
    for place in (folder, *folder.parents):
        if (place / "sucre_bench" / "plugins").is_dir() and all((place / f"{k}s").is_dir() for k in plugins.KINDS):
            return place
    return None


def write_new(kind: Kind, name: str, here: Path, package: Path | None = None, depth: bool = False) -> Written:
    """Write a plugin and its test.

    here: the folder the command is given in; package: the folder of a package to make for it; depth: write a method
    that needs depth. Raises InputError for an invalid or taken name, and if a file exists already.
    """
    _check_name(kind, name)
    checkout = None if package else checkout_of(here)
    if not checkout:
        _check_module(name, "file" if package is None else "module")
    place = "package" if package else "house" if checkout else "folder"
    cls = "".join(part.capitalize() for part in name.split("_"))
    if cls in _taken_names():
        cls += kind.capitalize()
    about: dict[str, Any] = {"kind": kind, "name": name, "cls": cls, "depth": depth, "place": place, "module": name}
    about["is_named"] = plugins.snake_case(cls) != name  # of my_method_2 the class would be called my_method2
    if package:
        return _package(package, about)
    folder, tests = (checkout / f"{kind}s", checkout / "tests" / f"{kind}s") if checkout else (here, here)
    file, test = folder / f"{name}.py", tests / f"test_{name}.py"
    _write({file: _filled(f"{kind}.py.j2", about), test: _filled(f"test_{kind}.py.j2", about)})
    return Written((file, test), _next(kind, name, None if checkout else f"{name}.py", test))


def _next(kind: Kind, name: str, file: str | None, test: Path) -> tuple[tuple[str, str], ...]:
    """The next commands. file: if no command finds the plugin by its name."""
    given = {"method": "", "dataset": " dataset.root=DIR", "metric": ""}[kind]
    plugin = f"--plugin {file} " if file else ""
    job = {
        "method": f"-m {plugin}dataset=demo method=underwater,{name} every=4",
        "dataset": f"-m {plugin}dataset={name} dataset.root=DIR method=underwater,gray_world",
        "metric": f"-m {plugin}dataset=demo method=underwater,gray_world 'metrics=[psnr,{name}]' every=4",
    }[kind]
    return (
        ("check", f"sucre-bench check {file or name}{given}"),
        ("test", f"python -m pytest {shlex.quote(shown_path(test))}"),
        ("run", f"sucre-bench run {job}"),
    )


def _taken_names() -> set[str]:
    """Names that have another meaning in a plugin's file or test: built-in ones, and all that a template imports."""
    texts = "\n".join(file.read_text(encoding="utf-8") for file in _TEMPLATES.glob("*.py.j2"))
    imports = re.findall(r"^(?:from|import) .*", texts, re.MULTILINE)
    return {*dir(builtins), *re.findall(r"\w+", " ".join(imports))}


def _package(folder: Path, about: Mapping[str, Any]) -> Written:
    kind, name, title = about["kind"], about["name"], folder.resolve().name
    module = re.sub(r"\W", "_", title).lower()
    if not re.fullmatch(r"[a-z]\w*", module, re.ASCII) or keyword.iskeyword(module):
        raise InputError(f"{title}: cannot be a package's name; call the folder like my-restorers")
    _check_module(module, "package")
    distribution = re.sub(r"_+", "-", module).strip("-")
    about = {**about, "package": module, "module": f"{module}.{name}", "distribution": distribution}
    files = {
        folder / "pyproject.toml": _filled("pyproject.toml.j2", about),
        folder / "README.md": _filled("readme.md.j2", about),
        folder / "src" / module / "__init__.py": _filled("init.py.j2", about),
        folder / "src" / module / f"{name}.py": _filled(f"{kind}.py.j2", about),
        folder / "tests" / f"test_{name}.py": _filled(f"test_{kind}.py.j2", about),
    }
    _write(files)
    check, test, job = _next(kind, name, None, folder / "tests" / f"test_{name}.py")
    install = ("install", f"pip install -e {shlex.quote(str(folder))}")
    listed = ("list", f"sucre-bench list {kind}s")
    return Written(tuple(files), (install, listed, check, test, job))


def _check_name(kind: Kind, name: str) -> None:
    snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", re.sub(r"\W+", "_", name)).strip("_").lower()
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        fit = re.fullmatch(r"[a-z][a-z0-9_]*", snake)
        raise InputError(f"{name}: cannot be a {kind}'s name; use small letters, {snake if fit else 'my_' + kind}")
    if keyword.iskeyword(name):
        raise InputError(f"{name}: is a word of Python's; use my_{name}")
    if name in plugins.discover(kind):
        raise InputError(f"{name}: there is a {kind} of that name; use another, my_{name}")


def _check_module(name: str, what: str) -> None:
    """Refuse names of modules: a file numpy.py would be imported in place of numpy by tests beside it."""
    try:
        taken = importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        taken = True
    if taken:
        raise InputError(f"{name}: a {what} of that name would hide Python's {name}; use another, my_{name}")


def _filled(template: str, about: Mapping[str, Any]) -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    engine = Environment(
        loader=FileSystemLoader(_TEMPLATES),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    return engine.get_template(template).render(about)


def _write(files: Mapping[Path, str]) -> None:
    """Write all files or none."""
    for path in files:
        if path.exists():
            raise InputError(f"{path}: is there already; use another name, or move it away")
    try:
        for path, text in files.items():
            write_atomically(path, text.encode())
    except OutputError:
        for path in files:
            with suppress(OSError):  # nor can what was not written be removed
                path.unlink()
        raise
