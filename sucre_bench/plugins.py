"""Methods, datasets and metrics are plugins: a decorated frozen dataclass in a file of its own.

The decorators only attach what they are told to the class; `discover` looks for such classes in the
folders methods/, datasets/ and metrics/, in the entry-point group ``sucre_bench.plugins``, and in files the
user names. A plugin that does not import is kept with its reason and harms nobody else. Importing a plugin must
be cheap: heavy packages are named in ``requires`` and imported where they are used.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import importlib.metadata
import importlib.util
import inspect
import math
import pkgutil
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, Protocol, TypeVar, get_args

from sucre_bench.colour import check_display
from sucre_bench.errors import ANY_FAULT, InputError, PluginError, did_you_mean, one_line
from sucre_bench.options import unusable
from sucre_bench.scene import Array, Restoration, Scene, Score, View

__all__ = [
    "Better",
    "Broken",
    "Dataset",
    "Method",
    "Metric",
    "Plugin",
    "dataset",
    "discover",
    "distribution_of",
    "find",
    "load_file",
    "method",
    "metric",
    "missing_needs",
    "missing_packages",
    "set_aside",
    "snake_case",
    "unknown",
]

Better = Literal["higher", "lower", "none"]
Kind = Literal["method", "dataset", "metric"]
KINDS: tuple[Kind, ...] = get_args(Kind)
# What a scene may offer; "restoration" is what a metric needs that makes no sense on just any picture.
NEEDS = frozenset({"depth", "poses", "reference", "charts", "truth", "restoration"})

# Import name -> what pip calls it, where the two differ.
_PACKAGE = {
    "cv2": "opencv-python-headless",
    "skimage": "scikit-image",
    "colour": "colour-science",
    "hydra": "hydra-core",
    "PIL": "Pillow",
}


class Method(Protocol):
    """Restores a view of a scene. Must not alter its inputs, and must give NaN where it has no colour."""

    def restore(self, scene: Scene, view: View) -> Restoration: ...


class Dataset(Protocol):
    """Yields scenes. Raises InputError, naming the file and the remedy, when the data are not as expected."""

    def scenes(self) -> Iterable[Scene]: ...


class Metric(Protocol):
    """Scores a restoration.

    restored.image is what the method computed; shown is the picture made of it, (H, W, 3) in [0, 1],
    gamma-encoded, NaN where there is no colour. Yields nothing where the view has nothing to score.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterable[Score]: ...


@dataclass(frozen=True)
class Plugin:
    """What is known of a plugin without running it.

    needs: what a scene must offer; requires: packages it imports when it runs; display: how its image is brought
    to the screen, encoding, reads: see `method`; source, has: see `dataset`; unit, better, range, variants, default:
    see `metric`.
    """

    kind: Kind
    name: str
    cls: type[Any]
    needs: frozenset[str] = frozenset()
    requires: tuple[str, ...] = ()
    cites: str = ""
    licence: str = ""
    display: str = "none"
    encoding: Literal["any", "gamma"] = "any"
    reads: tuple[str, ...] = ()
    source: str = ""
    has: frozenset[str] = frozenset()
    unit: str = ""
    better: Better = "higher"
    range: tuple[float, float] = (-math.inf, math.inf)
    variants: Mapping[str, str] = field(default_factory=dict)
    default: tuple[str, ...] = ()

    @property
    def summary(self) -> str:
        """The first sentence of the class's docstring."""
        return (inspect.getdoc(self.cls) or "").split("\n\n")[0].replace("\n", " ")


@dataclass(frozen=True)
class Broken:
    """A plugin that cannot be used, and why."""

    name: str
    reason: str


_C = TypeVar("_C", bound=type[Any])


def _decorator(kind: Kind, name: str, needs: Iterable[str], **about: Any) -> Callable[[_C], _C]:
    needs, known = frozenset(needs), NEEDS if kind == "metric" else NEEDS - {"restoration"}
    if needs - known:
        raise PluginError(f"{kind}: unknown needs {sorted(needs - known)}; {did_you_mean(min(needs - known), known)}")

    def attach(cls: _C) -> _C:
        if not is_dataclass(cls) or not cls.__dataclass_params__.frozen:  # type: ignore[attr-defined]
            raise PluginError(f"{cls.__qualname__}: not a frozen dataclass; put @dataclass(frozen=True) under @{kind}")
        cls.__plugin__ = Plugin(  # type: ignore[attr-defined]
            kind, name or snake_case(cls.__name__), cls, needs, **about
        )
        return cls

    return attach


def method(
    *,
    name: str = "",
    needs: Iterable[str] = (),
    requires: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
    display: str = "none",
    encoding: Literal["any", "gamma"] = "any",
    reads: Iterable[str] = (),
) -> Callable[[_C], _C]:
    """Make a frozen dataclass with ``restore(scene, view)`` a restorer.

    name: default the class's in snake_case; needs: of "depth", "poses", "reference", "charts", "truth";
    requires: import names of packages it uses when it runs; cites, licence: of the method it implements;
    display: the normalisation its result is shown and scored with, see `sucre_bench.colour.display`;
    encoding: "gamma" when it assumes gamma-encoded intensities: it then gets a linear view encoded (sRGB), and what it
    returns is decoded again; reads: options that name a file, a folder or another method that its results rest on, e.g.
    weights: when that changes, views are restored again.
    """
    check_display(display)
    needs = frozenset(needs)
    if encoding == "gamma" and "poses" in needs:
        raise PluginError("method: encoding=gamma is for methods of one view; other views are given as they are")
    about: dict[str, Any] = {"display": display, "encoding": encoding, "reads": tuple(reads)}
    return _decorator("method", name, needs, requires=tuple(requires), cites=cites, licence=licence, **about)


def dataset(
    *,
    name: str = "",
    requires: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
    source: str = "",
    has: Iterable[str] = (),
) -> Callable[[_C], _C]:
    """Make a frozen dataclass with ``scenes()`` a dataset.

    licence: of the data; source: where to get them, and how large they are; has: what its scenes may offer, of "depth",
    "poses", "reference", "charts", "truth".
    """
    about: dict[str, Any] = {"source": source, "has": frozenset(has)}
    return _decorator("dataset", name, (), requires=tuple(requires), cites=cites, licence=licence, **about)


def metric(
    *,
    variants: Mapping[str, str],
    unit: str,
    better: Better,
    range: tuple[float, float],
    name: str = "",
    needs: Iterable[str] = (),
    default: Iterable[str] = (),
    requires: Iterable[str] = (),
    cites: str = "",
    licence: str = "",
) -> Callable[[_C], _C]:
    """Make a frozen dataclass with ``score(restored, shown, view, variant)`` a metric.

    variants: name -> what sets it apart; default: those computed unless others are asked for (the first one);
    unit: as printed; better: "higher", "lower", or "none" for what describes and nobody wins by; range: of possible
    values.
    """
    if better not in get_args(Better):
        raise PluginError(f"metric: better='{better}'; it is 'higher', 'lower' or 'none'")
    chosen = tuple(default) or tuple(variants)[:1]
    about = {"unit": unit, "better": better, "range": range, "variants": dict(variants), "default": chosen}
    return _decorator("metric", name, needs, requires=tuple(requires), cites=cites, licence=licence, **about)


def snake_case(name: str) -> str:
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", "_", name).lower()


# -- finding them ------------------------------------------------------------------------------------------


_files: dict[Path, ModuleType] = {}


def load_file(path: str | Path) -> None:
    """Add the plugins of one Python file. PluginError when it is not there or does not import."""
    path = Path(path).resolve()
    if path in _files:
        return
    if not path.is_file():
        raise PluginError(f"{path}: no such plugin file; give the path of a .py file")
    of = hashlib.blake2b(str(path).encode(), digest_size=4).hexdigest()  # two files may have one name
    spec = importlib.util.spec_from_file_location(f"sucre_bench_plugin_{path.stem}_{of}", path)
    if spec is None or spec.loader is None:
        raise PluginError(f"{path}: not a Python file; give the path of a .py file")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module.__name__] = module  # dataclasses look their module up there
    try:
        with contextlib.redirect_stdout(sys.stderr):  # what it prints is no part of our output
            spec.loader.exec_module(module)
    except ANY_FAULT as fault:
        del sys.modules[module.__name__]
        raise PluginError(f"{path}: does not import, {one_line(fault)}; mend the file") from fault
    if not _plugins_in(module):
        raise PluginError(f"{path}: holds no plugin; decorate a class with @method, @dataset or @metric")
    _files[path] = module
    discover.cache_clear()


@functools.cache
def discover(kind: Kind) -> dict[str, Plugin | Broken]:
    """Return every plugin of a kind by name, sorted; those that do not import or share a name are `Broken`."""
    found: dict[str, Plugin | Broken] = {}
    for entry in _everywhere(kind):
        if isinstance(entry, Plugin) and entry.kind != kind:
            continue
        if isinstance(entry, Plugin) and (fault := unusable(entry)):
            entry = Broken(entry.name, fault)
        other = found.get(entry.name)
        if other is not None and _where(other) != _where(entry):
            entry = Broken(entry.name, f"two {kind}s have this name, in {_where(other)} and {_where(entry)}")
        found[entry.name] = entry
    return dict(sorted(found.items()))


def _everywhere(kind: Kind) -> Iterator[Plugin | Broken]:
    package = importlib.import_module(f"sucre_bench.{kind}s")
    for info in pkgutil.iter_modules(package.__path__):
        if not info.name.startswith("_"):
            yield from _try(info.name, functools.partial(importlib.import_module, f"{package.__name__}.{info.name}"))
    for entry in importlib.metadata.entry_points(group="sucre_bench.plugins"):
        yield from _try(entry.name, entry.load)
    for module in _files.values():
        yield from _plugins_in(module)


def _try(name: str, load: Callable[[], Any]) -> list[Plugin | Broken]:
    try:
        with contextlib.redirect_stdout(sys.stderr):
            loaded = load()
        return [loaded.__plugin__] if hasattr(loaded, "__plugin__") else list(_plugins_in(loaded))
    except ANY_FAULT as fault:
        return [Broken(name, one_line(fault))]


def _plugins_in(module: ModuleType) -> list[Plugin]:
    """The decorated classes a module (or a folder's own modules) defines, imported ones left out."""
    inside = (module.__name__, module.__name__ + ".")
    classes = [c for c in vars(module).values() if isinstance(c, type) and "__plugin__" in vars(c)]
    return [
        c.__dict__["__plugin__"] for c in classes if c.__module__ == inside[0] or c.__module__.startswith(inside[1])
    ]


def find(kind: Kind, name: str) -> Plugin:
    """Return the plugin of that name. InputError with the nearest name, or PluginError with why it is broken."""
    known = discover(kind)
    plugin = known.get(name)
    if plugin is None:
        raise unknown(kind, name, known)
    if isinstance(plugin, Broken):
        raise PluginError(f"{kind} '{name}': cannot be used, {plugin.reason}; mend it or leave it out")
    return plugin


def unknown(kind: str, name: str, known: Iterable[str], give: str = "--plugin ") -> InputError:
    """Return what to say of a name that no plugin has: the nearest, or its file, where that lies here.

    give: what stands before a file in the command.
    """
    if Path(f"{name}.py").is_file():
        return InputError(f"no {kind} is called '{name}', but {name}.py is here; give {give}{name}.py")
    return InputError(f"no {kind} is called '{name}'; {did_you_mean(name, known)}")


def set_aside(plugin: Plugin, reason: str) -> None:
    """From now on, treat a plugin as one that cannot be used."""
    discover(plugin.kind)[plugin.name] = Broken(plugin.name, reason)


def _where(plugin: Plugin | Broken) -> str:
    return str(Path(inspect.getsourcefile(plugin.cls) or "").resolve()) if isinstance(plugin, Plugin) else plugin.name


# -- using them --------------------------------------------------------------------------------------------


def missing_packages(plugin: Plugin) -> str:
    """Return the line that installs what a plugin requires and this machine lacks; empty when nothing is missing."""
    absent = [name for name in plugin.requires if not _is_installed(name)]
    return f"pip install {' '.join(map(distribution_of, absent))}" if absent else ""


def distribution_of(package: str) -> str:
    """Return what is installed to import a package."""
    return _PACKAGE.get(package, package)


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # of a package that it is in
        return False


def missing_needs(plugin: Plugin, has: frozenset[str]) -> str:
    """Return what a plugin needs and a scene does not offer, in words; empty when nothing is missing."""
    absent = sorted(plugin.needs - has)
    return f"needs {' and '.join(absent)}, the scene has {', '.join(sorted(has)) or 'only images'}" if absent else ""
