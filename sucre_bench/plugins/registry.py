"""Finds plugins: in the folders of this package, in installed packages, and in files that the user names."""

from __future__ import annotations

import contextlib
import functools
import importlib
import importlib.metadata
import importlib.util
import inspect
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from contextvars import ContextVar
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import ModuleType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from sucre_bench.arguments import checked
from sucre_bench.errors import (
    ANY_FAULT,
    InputError,
    PluginError,
    did_you_mean,
    one_line,
    raise_if_stop,
)
from sucre_bench.machine.files import is_file
from sucre_bench.machine.text_formats import short_hash
from sucre_bench.plugins.plugin import Broken, Kind, Plugin

# Set by the bench beside a plugin's own options.
_RESERVED = frozenset({"name", "label", "display", "variants"})


@dataclass(frozen=True)
class Registry:
    """What is known of plugins."""

    files: dict[Path, ModuleType] = field(default_factory=dict)
    """Modules of plugin files, by the path they were loaded from."""

    known: dict[tuple[Kind, str], dict[str, Plugin | Broken]] = field(default_factory=dict)
    """What `discover` returned for a kind and a name."""

    def copy(self) -> Registry:
        """Return a registry with the same plugins; what is loaded into one of them is not in the other."""
        return Registry(dict(self.files), dict(self.known))


_current: ContextVar[Registry] = ContextVar("registry", default=Registry())  # noqa: B039, one for the whole process


@contextlib.contextmanager
def using(registry: Registry) -> Iterator[Registry]:
    """Inside, the functions of `sucre_bench.plugins` work on this registry."""
    token = _current.set(registry)
    try:
        yield registry
    finally:
        _current.reset(token)


def current() -> Registry:
    """Return the registry in use."""
    return _current.get()


@checked
def load_file(path: str | Path) -> list[Plugin]:
    """Register the plugins of one Python file, and return them in its order.

    Raises PluginError if it does not exist, cannot be imported or holds no plugin.

    >>> from pathlib import Path
    >>> import sucre_bench as sb
    >>> [plugin.name for plugin in sb.load_file(Path(sb.__file__).parent / "methods" / "gray_world.py")]
    ['gray_world']
    """
    if not is_file(Path(path)):
        raise PluginError(
            "no such plugin file", str(path) or "load_file('')", "give the path of a .py file"
        )
    registry, path = _current.get(), Path(path).resolve()
    if path not in registry.files:
        registry.files[path] = _module_of(path)
        registry.known.clear()
    return _plugins_in(registry.files[path])


def is_loaded(path: str | Path) -> bool:
    """Whether a plugin file was loaded."""
    return Path(path).resolve() in _current.get().files


def discover(kind: Kind, name: str = "") -> dict[str, Plugin | Broken]:
    """Return every plugin of a kind by name, sorted; those that do not import or share a name are `Broken`.

    name: the plugin of this name is wanted. Files of this package without it are not imported, which is quicker.
    """
    known = _current.get().known
    key = kind, "" if (kind, "") in known else name
    if key not in known:
        known[key] = _found(*key)
    return known[key]


def usable(kind: Kind) -> dict[str, Plugin]:
    """Return the plugins of a kind that are not broken, by name, sorted."""
    return {
        name: plugin for name, plugin in discover(kind).items() if isinstance(plugin, Plugin)
    }


def get(kind: Kind, name: str) -> Plugin | None:
    """Return the plugin of that name; None where there is none that works."""
    plugin = discover(kind, name).get(name)
    return plugin if isinstance(plugin, Plugin) else None


def is_name(kind: Kind, name: str) -> bool:
    """Whether a plugin of that kind, broken or not, has the name."""
    return name in discover(kind, name)


def find(kind: Kind, name: str) -> Plugin:
    """Return the plugin of that name. InputError with the nearest name, or PluginError with why it is broken."""
    plugin = discover(kind, name).get(name)
    if plugin is None:
        raise unknown(kind, name, discover(kind))
    if isinstance(plugin, Broken):
        raise PluginError(
            f"cannot be used, {plugin.reason}", f"{kind} '{name}'", "mend it or leave it out"
        )
    return plugin


def _found(kind: Kind, name: str) -> dict[str, Plugin | Broken]:
    package = importlib.import_module(f"sucre_bench.{kind}s")
    entries = list[Plugin | Broken]()
    for info in pkgutil.iter_modules(package.__path__):
        is_wanted = not name or _may_define(Path(package.__path__[0]) / info.name, name)
        if is_wanted and not info.name.startswith("_"):
            load = functools.partial(importlib.import_module, f"{package.__name__}.{info.name}")
            entries += _imported(info.name, load)
    for point in _entry_points(tuple(sys.path)):
        entries += _imported(point.name, point.load)
    for module in _current.get().files.values():
        entries += _plugins_in(module)
    found: dict[str, Plugin | Broken] = {}
    for entry in entries:
        if isinstance(entry, Plugin) and entry.kind != kind:
            continue
        other = found.get(entry.name)
        if other is not None and _where(other) != _where(entry):
            both = f"{_where(other)} and {_where(entry)}"
            entry = Broken(entry.name, f"two {kind}s have this name, in {both}")
        elif isinstance(entry, Plugin) and (fault := _unusable(entry)):
            entry = Broken(entry.name, fault)
        found[entry.name] = entry
    return dict(sorted(found.items()))


def _may_define(module: Path, name: str) -> bool:
    """Whether a file or folder has a class of a plugin's name, or the name in quotes."""
    plain = re.escape(name.replace("_", "").lower())
    files = module.rglob("*.py") if module.is_dir() else [module.with_suffix(".py")]
    texts = (file.read_text(encoding="utf-8").replace("_", "").lower() for file in files)
    return any(re.search(f"class {plain}|[\"']{plain}[\"']", text) for text in texts)


@functools.cache
def _entry_points(search_path: tuple[str, ...]) -> importlib.metadata.EntryPoints:
    """Return what the packages on a search path offer as plugins. Finding it reads a file of each package."""
    return importlib.metadata.entry_points(group="sucre_bench.plugins")


def _module_of(path: Path) -> ModuleType:
    """Import a plugin file. PluginError if it does not import or holds no plugin."""
    # two files may have one name
    name = f"sucre_bench_plugin_{path.stem}_{short_hash(str(path))}"
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise PluginError("not a Python file", path, "give the path of a .py file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses look their module up there
    try:
        with contextlib.redirect_stdout(sys.stderr):  # its prints are no part of our output
            spec.loader.exec_module(module)
    except BaseException as fault:
        raise_if_stop(fault)
        del sys.modules[module.__name__]
        raise PluginError(
            f"does not import, {one_line(fault)}", path, "mend the file"
        ) from fault
    if not _plugins_in(module):
        remedy = "decorate a class in it with @method, @dataset or @metric"
        raise PluginError("holds no plugin", path, remedy)
    return module


def _imported(name: str, load: Callable[[], Any]) -> list[Plugin | Broken]:
    try:
        with contextlib.redirect_stdout(sys.stderr):
            loaded = load()
        return [loaded.__plugin__] if hasattr(loaded, "__plugin__") else [*_plugins_in(loaded)]
    except BaseException as fault:
        raise_if_stop(fault)
        return [Broken(name, one_line(fault))]


def _plugins_in(module: ModuleType) -> list[Plugin]:
    """The plugins that a module defines; of an `__init__.py` also those that it imports from its folder.

    A package that is loaded by its path has another name than the one by which its `__init__.py` imports from it.
    """
    folders = [Path(folder).resolve() for folder in getattr(module, "__path__", ())]
    plugins = []
    for cls in vars(module).values():
        plugin = vars(cls).get("__plugin__") if isinstance(cls, type) else None
        if plugin is None:
            continue
        is_in_module = f"{cls.__module__}.".startswith(f"{module.__name__}.")
        if is_in_module or any(Path(_where(plugin)).is_relative_to(f) for f in folders):
            plugins.append(plugin)
    return plugins


def unknown(kind: str, name: str, known: Iterable[str], give: str = "--plugin ") -> InputError:
    """Return what to say of a name that no plugin has: the nearest, or its file, where that lies here.

    give: what stands before a file in the command.
    """
    if is_file(Path(f"{name}.py")):
        remedy = f"give {give}{name}.py"
        return InputError(f"no {kind} is called '{name}', but {name}.py is here", remedy=remedy)
    return InputError(f"no {kind} is called '{name}'", remedy=did_you_mean(name, known))


def _unusable(plugin: Plugin) -> str:
    """Why a plugin's options cannot be configured; empty when they can."""
    try:
        hints = get_type_hints(plugin.cls)
    except ANY_FAULT as fault:
        return f"its annotations do not resolve, {one_line(fault)}"
    for option in (f for f in fields(plugin.cls) if f.init):
        kind = hints[option.name]
        if option.name in _RESERVED:
            return f"option '{option.name}' has a reserved name"
        if not _is_plain(kind):
            return f"option '{option.name}' is {kind}; use numbers, strings, paths, Literal words or tuples"
    return ""


def _is_plain(annotation: Any) -> bool:
    """Whether a command can set an option of this type."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return all(isinstance(word, str) for word in args)
    if origin in (Union, UnionType, tuple, list):
        return all(_is_plain(arg) for arg in args if arg not in (type(None), Ellipsis))
    return annotation in (int, float, str, bool, Path)


def _where(plugin: Plugin | Broken) -> str:
    return (
        str(Path(inspect.getsourcefile(plugin.cls) or "").resolve())
        if isinstance(plugin, Plugin)
        else plugin.name
    )
