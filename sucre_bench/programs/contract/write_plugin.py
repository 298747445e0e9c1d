"""Writes a plugin to start from, with its test: into this repository, or into a folder."""

import builtins
import importlib.util
import keyword
import re
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import sucre_bench
from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.machine.files import write_atomically
from sucre_bench.plugins.plugin import Kind

_IMPORTED = ("Iterator", "Path")  # by the templates, beside the names of sucre_bench


class Written(NamedTuple):
    """The files of a new plugin, and the next commands with their purposes."""

    files: tuple[Path, ...]
    commands: tuple[tuple[str, str], ...]


def shown_path(path: Path) -> str:
    """Return a path relative to the current folder if it lies there."""
    full = Path.cwd() / path
    return str(full.relative_to(Path.cwd())) if full.is_relative_to(Path.cwd()) else str(full)


def checkout_of(folder: Path) -> Path | None:
    """Return the checkout of this repository that holds a folder, or None."""
    for place in (folder, *folder.parents):
        if (place / "sucre_bench" / "plugins").is_dir() and all(
            (place / f"{k}s").is_dir() for k in plugins.KINDS
        ):
            return place
    return None


def write_new(kind: Kind, name: str, here: Path, depth: bool = False) -> Written:
    """Write a plugin and its test.

    here: the folder the command is given in; depth: write a method that needs depth.
    Raises InputError for an invalid or taken name, and if a file exists already.
    """
    _check_name(kind, name)
    cls = "".join(part.capitalize() for part in name.split("_"))
    if cls in {*dir(builtins), *sucre_bench.__all__, *_IMPORTED}:
        # the file and its test use these names
        cls += kind.capitalize()
    checkout = checkout_of(here)
    if checkout:
        plugin = checkout / f"{kind}s" / f"{name}.py"
        test = checkout / "tests" / f"{kind}s" / f"test_{name}.py"
        called = name
    else:
        _check_module(name)
        plugin = here / f"{name}.py"
        test = here / f"test_{name}.py"
        called = plugin.name  # no command finds it by its name
    about: dict[str, Any] = {
        "kind": kind,
        "name": name,
        "cls": cls,
        "depth": depth,
        # of my_method_2 the class would be called my_method2
        "is_named": plugins.snake_case(cls) != name,
        "place": "house" if checkout else "folder",
    }
    _write({plugin: f"{kind}.py.j2", test: f"test_{kind}.py.j2"}, about)
    return Written((plugin, test), _next_commands(kind, name, called, test))


def _next_commands(
    kind: Kind, name: str, called: str, test: Path
) -> tuple[tuple[str, str], ...]:
    """What to type next, with a word for each. called: the plugin's name, or its file if no command finds the name."""
    plugin = "" if called == name else f"--plugin {called} "
    job = {
        "method": f"-m {plugin}dataset=demo method=underwater,{name} every=4",
        "dataset": f"-m {plugin}dataset={name} dataset.root=DIR method=underwater,gray_world",
        "metric": f"-m {plugin}dataset=demo method=underwater,gray_world 'metrics=[psnr,{name}]' every=4",
    }[kind]
    root = " dataset.root=DIR" if kind == "dataset" else ""
    return (
        ("check", f"sucre-bench check {called}{root}"),
        ("test", f"python -m pytest {shlex.quote(shown_path(test))}"),
        ("run", f"sucre-bench run {job}"),
    )


def _check_name(kind: Kind, name: str) -> None:
    snake = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", re.sub(r"\W+", "_", name)).strip("_").lower()
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name):
        fit = re.fullmatch(r"[a-z][a-z0-9_]*", snake)
        raise InputError(
            f"{name}: cannot be a {kind}'s name; use small letters, {snake if fit else 'my_' + kind}"
        )
    if keyword.iskeyword(name):
        raise InputError(f"{name}: is a word of Python's; use my_{name}")
    if name in plugins.discover(kind):
        raise InputError(f"{name}: there is a {kind} of that name; use another, my_{name}")


def _check_module(name: str) -> None:
    """Refuse names of modules: a file numpy.py would be imported in place of numpy by tests beside it."""
    try:
        taken = importlib.util.find_spec(name) is not None
    except (ImportError, ValueError):
        taken = True
    if taken:
        raise InputError(
            f"{name}: a file of that name would hide Python's {name}; use another, my_{name}"
        )


def _write(templates: Mapping[Path, str], about: Mapping[str, Any]) -> None:
    """Fill in and write all files or none: the plugin itself comes after its test."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    for path in templates:
        if path.exists():
            raise InputError(f"{path}: is there already; use another name, or move it away")
    loader = FileSystemLoader(Path(__file__).with_name("templates"))
    engine = Environment(
        loader=loader,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    for path, template in reversed([*templates.items()]):
        write_atomically(path, engine.get_template(template).render(about).encode())
