"""The options of a plugin, its dataclass's fields: types, help texts, checks; a choice of them, and the plugin made.

`source_hash` is one short hash of all that a result depends on: source code, and the files that options name.
"""

from __future__ import annotations

import ast
import contextlib
import functools
import inspect
import itertools
import marshal
import math
import textwrap
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any, Literal, get_args, get_origin, get_type_hints

from sucre_bench.arguments import check_argument, fits, wording
from sucre_bench.errors import InputError, did_you_mean, is_number_in, shown_value, unknown_name
from sucre_bench.imaging.display import normalisation
from sucre_bench.machine.files import expanded, fault_of
from sucre_bench.machine.provenance import hash_of, require
from sucre_bench.plugins.plugin import Kind, Plugin
from sucre_bench.plugins.registry import discover, find, get


@dataclass(frozen=True)
class Option:
    """A field of a plugin."""

    name: str
    type: Any

    default: Any
    """It is dataclasses.MISSING when a value must be given."""

    cls: type[Any]
    """The plugin's class."""

    @property
    def is_required(self) -> bool:
        """Whether it must be given."""
        return self.default is MISSING

    @property
    def help(self) -> str:
        """The docstring under the field. It is looked up when asked for: that parses the source of the class."""
        return field_docs(self.cls).get(self.name, "")

    @property
    def kinds(self) -> tuple[Any, ...]:
        """The type and its parts: of `Path | None` the whole, `Path` and `None`."""
        return self.type, *get_args(self.type)

    @property
    def choices(self) -> tuple[str, ...]:
        """The words a Literal admits, also one that is an alternative to a path or text; empty for any other type."""
        words = (get_args(kind) for kind in self.kinds if get_origin(kind) is Literal)
        return tuple(itertools.chain(*words))

    @property
    def is_closed(self) -> bool:
        """Whether nothing but its choices may be given."""
        return get_origin(self.type) is Literal


def options_of(cls: Any) -> tuple[Option, ...]:
    """Return a plugin class's fields; those that plugins share come last."""
    return _options_of(cls)


@functools.cache  # asked for with every score
def _options_of(cls: Any) -> tuple[Option, ...]:
    hints = get_type_hints(cls)
    given = sorted((f for f in fields(cls) if f.init), key=lambda f: bool(f.kw_only))
    defaults = (
        f.default if f.default_factory is MISSING else f.default_factory() for f in given
    )
    return tuple(
        Option(f.name, hints[f.name], default, cls)
        for f, default in zip(given, defaults, strict=True)
    )


def default_values(cls: Any) -> dict[str, Any]:
    """Return the default of each option as plain data, "???" for one that must be given: as OmegaConf writes it."""
    return {o.name: "???" if o.is_required else plain_value(o.default) for o in options_of(cls)}


@functools.cache
def field_docs(cls: type[Any]) -> dict[str, str]:
    """Return the string under each annotated name of a class body, as every documentation generator reads them."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body  # type: ignore[attr-defined]
        except (OSError, TypeError):
            continue  # made in a console: it has no source
        for above, below in itertools.pairwise(body):
            if isinstance(above, ast.AnnAssign) and isinstance(above.target, ast.Name):
                text = below.value if isinstance(below, ast.Expr) else None
                if isinstance(text, ast.Constant) and isinstance(text.value, str):
                    docs[above.target.id] = " ".join(text.value.split())
    return docs


def checked_options(cls: Any, given: Mapping[str, Any], place: str = "") -> dict[str, Any]:
    """Return the given values of a class's options as their types have them.

    cls: of a plugin, or of a group of options of `sucre-bench run`; place: what the user types before the options of a
    group.
    Raises InputError for an unknown option, a missing one, a value of another type, or a word that a Literal does not
    admit.
    """
    plugin: Plugin | None = getattr(cls, "__plugin__", None)
    if plugin:
        place = plugin.place
    known = {option.name: option for option in options_of(cls)}
    values = {}
    for name, value in given.items():
        where = f"{place}.{name}" if place else name
        if name not in known:
            raise unknown_name(where, name, known)
        values[name] = _checked_value(where, value, known[name])
    for option in known.values():
        if option.is_required and option.name not in values:
            example = "FOLDER" if option.name == "root" else "VALUE"
            where = f"{place}.{option.name}"
            raise InputError("must be given", where, f"add {where}={example}")
    return values


def _checked_value(place: str, given: Any, option: Option) -> Any:
    value = typed(option.type, given)
    each = value if isinstance(value, (list, tuple)) else [value]
    if Path in option.kinds and not all(str(one).strip() for one in each):
        # else it would be the current folder
        raise InputError("is empty", place, "give a path")
    if option.is_closed and value not in option.choices:
        remedy = did_you_mean(str(value), option.choices)
        raise InputError(f"'{value}' is not a choice", place, remedy)
    check_argument(place, value, option.type)
    # Options of a run have ranges, which name the numbers that are allowed.
    is_of_plugin = hasattr(option.cls, "__plugin__")
    if is_of_plugin and not all(math.isfinite(one) for one in each if isinstance(one, float)):
        raise InputError(f"{value} is not a finite number", place, "give one")
    return value


def typed(annotation: Any, value: Any) -> Any:
    """Return a value as an option's type has it, if it can be: text as path or number, 2 as 2.0, a list as a tuple."""
    kinds = (annotation, *get_args(annotation))
    lists = [kind for kind in kinds if get_origin(kind) in (tuple, list, Sequence)]
    if lists and isinstance(value, (list, tuple)):
        elements = [typed(get_args(lists[0])[0], one) for one in value]
        return tuple(elements) if get_origin(lists[0]) is tuple else elements
    if Path in kinds and isinstance(value, (str, Path)):
        return expanded(value) if str(value).strip() else value
    if fits(value, annotation):
        is_float = float in kinds and int not in kinds
        return float(value) if is_float and type(value) is int else value
    if isinstance(value, str):
        for kind in (int, float):
            with contextlib.suppress(ValueError):
                if kind in kinds:
                    return kind(value)
        # None is the word of Python, which messages have
        return {"true": True, "false": False, "none": None}.get(value.lower(), value)
    if isinstance(value, (int, float)):
        # as it was typed: a file may be called true, and "nan" may be a word of a Literal
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if Path in kinds:
            return expanded(text)
        if str in kinds or text in kinds:
            return text
    return value


def check_ranges(options: Any, place: str | None = None, /, **ranges: str) -> None:
    """Raise InputError for the first option outside of its range: one line with its name, its value and the range.

    options: a dataclass, of a plugin say; place: what stands before the option's name, default that of a plugin;
    ranges: option -> interval, such as ``"(0, 1]"``, of which "(" excludes the bound. Each element of a tuple must lie
    in it. NaN lies in none. A field of type int takes whole numbers only, and an optional one takes None.
    """
    types = {option.name: option.type for option in options_of(type(options))}
    for option, interval in ranges.items():
        value = getattr(options, option)
        each = value if isinstance(value, tuple) else (value,)
        numbers = [one for one in each if one is not None]
        if not fits(value, types[option]) or not all(
            is_number_in(interval, number) for number in numbers
        ):
            before = type(options).__plugin__.place if place is None else place
            remedy = f"give {wording(types[option])} in {interval}"
            raise InputError(
                shown_value(value), f"{before}.{option}" if before else option, remedy
            )


def plain_value(value: Any) -> Any:
    """Return an option's value, or a group of them, as rows and labels have it: paths as text, tuples as lists."""
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, Mapping):
        return {name: plain_value(inner) for name, inner in value.items()}
    return [*map(plain_value, value)] if isinstance(value, (list, tuple)) else value


def seed_of(seed: int, axis: Kind | Literal["degrade"], replicate: int) -> int:
    """Return the seed that an axis draws with in a replicate, at most 32 bits.

    Dataset, degradation and method each have their own, and every replicate has new ones. All methods of one replicate
    see the same draws of the data, so they stay paired. What a method draws does not depend on which other methods run.
    Replicate 0 has the seeds that were given.
    """
    import numpy as np

    if not replicate:
        return seed
    return int(
        np.random.SeedSequence([seed, zlib.crc32(axis.encode()), replicate]).generate_state(1)[
            0
        ]
    )


@dataclass(frozen=True)
class Choice:
    """A plugin with the options it is to be made with."""

    plugin: Plugin
    label: str
    options: Mapping[str, Any]

    display: str = ""
    """A method's normalisation, else empty."""

    replicate: int = 0
    """Which draws it makes, see `seed_of`."""

    variants: tuple[str, ...] = ()
    """Of a metric."""

    @property
    def label_option(self) -> str:
        """The word of a command that gives it another label."""
        return f"{self.plugin.kind}.label=..."

    def make(self, out: Path | None = None) -> Any:
        """Create the plugin; its options were checked. Raises what its own __post_init__ raises, and InputError, with
        the command that installs them, where packages are missing that it requires.

        An option that the plugin `reads` must lead to a file or folder, which is not opened. out: the folder of results
        of a command that is about to run; what is to lie in it may be made by an earlier job.
        """
        plugin = self.plugin
        require(f"{plugin.kind} '{plugin.name}'", *plugin.requires)
        seed = {} if self.seed is None else {"seed": self.seed}
        made = plugin.cls(**{**self.options, **seed})
        for option, path in read_by_options(plugin, self.options):
            if isinstance(path, Plugin) or path.is_dir():
                continue
            is_ours = out is not None and path.absolute().is_relative_to(out.absolute())
            may_come = is_ours and not path.exists()
            fault = fault_of(path)
            if fault and not may_come:
                words = f", or one of {', '.join(option.choices)}" if option.choices else ""
                remedy = f"give a path that exists in {plugin.place}.{option.name}{words}"
                raise InputError(fault, path, remedy)
        return made

    @property
    def seed(self) -> int | None:
        """The seed it draws with; None where it draws nothing."""
        if "seed" not in self.options:
            return None
        return seed_of(self.options["seed"], self.plugin.kind, self.replicate)

    @property
    def rests_on(self) -> tuple[list[Plugin], list[Path]]:
        """The other methods that options name, and the files and folders, with records that tell of them."""
        read = [read for _, read in read_by_options(self.plugin, self.options)]
        paths = [one for one in read if isinstance(one, Path)]
        records = [path.with_suffix(".json") for path in paths if path.suffix == ".npz"]
        files = [path for path in (*paths, *records) if path.exists()]
        return [one for one in read if isinstance(one, Plugin)], files

    @property
    def record(self) -> dict[str, Any]:
        """What a row keeps as options."""
        display = {"display": self.display} if self.display else {}
        return {"name": self.plugin.name, **display, **plain_value(self.options)}


def plugin_choice(kind: Kind, values: Any) -> Choice:
    """Return the plugin that `name` in the values is, with its label, display and checked options.

    Raises InputError for what the plugin does not take.
    """
    values = dict(values or {})
    if "name" not in values:
        raise InputError(
            f"no {kind} is chosen; add {kind}=NAME, `sucre-bench list {kind}s` shows what there is"
        )
    plugin = find(kind, values.pop("name"))
    label = typed(str | None, values.pop("label", None))
    display = values.pop("display", "")
    check_argument(f"{kind}.label", label, str | None)
    check_argument(f"{kind}.display", display, str)
    if kind == "method":
        normalisation(display)
    options = checked_options(plugin.cls, values)
    return Choice(plugin, label or plugin.name, options, display)


def create(plugin: Plugin, values: Mapping[str, Any]) -> Any:
    """Check options and make the plugin with them. Raises what `checked_options` and `Choice.make` raise.

    A path may be given as text, a tuple as a list.
    """
    return Choice(plugin, plugin.name, checked_options(plugin.cls, values)).make()


def read_by_options(
    plugin: Plugin, values: Mapping[str, Any]
) -> Iterator[tuple[Option, Path | Plugin]]:
    """Yield what options of these values name for a plugin to read: a path, or another method.

    Words with a meaning of their own are left out.
    """
    for option in options_of(plugin.cls):
        value = values.get(option.name, "")
        if (
            option.name in plugin.reads
            and isinstance(value, (str, Path))
            and value not in ("", *option.choices)
        ):
            name = value if isinstance(value, str) else ""
            method = get("method", name)
            if method or name not in discover("method", name):
                yield option, method or expanded(value)


def source_hash(*used: Plugin, files: Iterable[Path] = ()) -> str:
    """Return a hash of what makes a result: the code of the plugins and of the engine's numerics, and further files.

    Code counts as it stands in its files, comments too; where in a folder a file lies does not. The versions of the
    engine and of the libraries it computes with count.

    Of `files`, which may be large, name, size and time of change count. Of a folder, those of all files in it, except
    hidden files and `__pycache__`.
    """
    places = [_source_of(plugin.cls, plugin.kind) for plugin in used]
    # what there is of a plugin without a file: the compiled code of what its class defines
    typed_in = [
        marshal.dumps(value.__code__, 2)
        for plugin, place in zip(used, places, strict=True)
        for value in vars(plugin.cls).values()
        if place is None and inspect.isfunction(value)
    ]
    stamps = [stamp for place in files for stamp in _stamps(place)]
    packages = {name for plugin in used for name in (*plugin.requires, *plugin.may_use)}
    return hash_of(tuple(filter(None, places)), packages, (typed_in, stamps))


def _stamps(place: Path) -> Iterator[tuple[str, int, int]]:
    for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
        within = path.relative_to(place)
        if path.is_file() and not any(
            part.startswith(".") or part == "__pycache__" for part in within.parts
        ):
            state = path.stat()
            yield str(within), state.st_size, state.st_mtime_ns


def _source_of(cls: type[Any], kind: Kind) -> Path | None:
    """A plugin's file, or its folder where it has one of its own; None for one that was typed into a session."""
    try:
        file = Path(inspect.getsourcefile(cls) or "")
    except (OSError, TypeError):
        return None
    shared = (Path(__file__).parent.parent / f"{kind}s").resolve()
    has_folder = file.parent.resolve() != shared and (file.parent / "__init__.py").exists()
    return file.parent if has_folder else file
