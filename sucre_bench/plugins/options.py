"""The options of a plugin: the fields of its dataclass, with their types, help texts and checks."""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import math
import textwrap
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin, get_type_hints

from sucre_bench.errors import ANY_FAULT, InputError, did_you_mean, one_line, unknown_name
from sucre_bench.machine.files import expanded

if TYPE_CHECKING:
    from sucre_bench.plugins.plugin import Plugin

# Set by the bench beside a plugin's own options.
RESERVED = frozenset({"name", "label", "display", "variants"})


@dataclass(frozen=True)
class Option:
    """A field of a plugin: its name, type and default (dataclasses.MISSING when it must be given).

    cls: the plugin's class.
    """

    name: str
    type: Any
    default: Any
    cls: type[Any]

    @property
    def help(self) -> str:
        """The docstring under the field. It is looked up when asked for: that parses the source of the class."""
        return _field_docs(self.cls).get(self.name, "")

    @property
    def choices(self) -> tuple[str, ...]:
        """The words a Literal admits, also one that is an alternative to a path or text; empty for any other type."""
        kinds = (self.type, *get_args(self.type))
        return tuple(word for kind in kinds if get_origin(kind) is Literal for word in get_args(kind))

    @property
    def is_closed(self) -> bool:
        """Whether nothing but its choices may be given."""
        return get_origin(self.type) is Literal


def options_of(cls: Any) -> tuple[Option, ...]:
    """Return a plugin class's fields."""
    return _options_of(cls)


@functools.cache  # asked for with every score
def _options_of(cls: Any) -> tuple[Option, ...]:
    hints = get_type_hints(cls)
    # Those that plugins share come last.
    given = sorted((f for f in fields(cls) if f.init), key=lambda f: bool(f.kw_only))
    defaults = (f.default if f.default_factory is MISSING else f.default_factory() for f in given)
    return tuple(Option(f.name, hints[f.name], default, cls) for f, default in zip(given, defaults, strict=True))


@functools.cache
def _field_docs(cls: type[Any]) -> dict[str, str]:
    """The string under an annotated name in a class body documents it, as in every documentation generator."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body  # type: ignore[attr-defined]
        except (OSError, TypeError):
            continue  # made in a console: it has no source
        for above, below in itertools.pairwise(body):
            if isinstance(above, ast.AnnAssign) and isinstance(above.target, ast.Name):
                said = (
                    below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else ""
                )
                if isinstance(said, str) and said:
                    docs[above.target.id] = " ".join(said.split())
    return docs


def check_options(plugin: Plugin, values: Mapping[str, Any]) -> None:
    """Raise InputError for an unknown option, a missing one, or a word that a Literal does not admit."""
    known = options_of(plugin.cls)
    check_values(plugin.name, known, values, f"see `sucre-bench list {plugin.kind}s`")
    missing = [option.name for option in known if option.default is MISSING and option.name not in values]
    if missing:
        name = missing[0]
        value = "FOLDER" if name == "root" else "VALUE"
        raise InputError(f"{plugin.name}.{name}: must be given; add {plugin.kind}.{name}={value}")


_NOUNS = {bool: "true or false", int: "a whole number", float: "a number", str: "a word"}


def check_values(place: str, options: Iterable[Option], values: Mapping[str, Any], remedy: str) -> None:
    """Raise InputError for an unknown option, a value of another type, or a word that a Literal does not admit.

    place: what stands before an option's name, nothing if empty; remedy: what to do about a value of another type.
    """
    known = {option.name: option for option in options}
    for name, value in values.items():
        where = f"{place}.{name}" if place else name
        if name not in known:
            raise unknown_name(where, name, known)
        if not _fits(known[name].type, value):
            of = _NOUNS.get(known[name].type, known[name].type)
            raise InputError(f"{where}: {value!r} is not {of}; {remedy}")
        if not _finite(value):
            raise InputError(f"{where}: {value} is not a finite number; give one")
        if known[name].is_closed and value not in known[name].choices:
            raise InputError(f"{where}: '{value}' is not a choice; {did_you_mean(str(value), known[name].choices)}")


def _fits(annotation: Any, value: Any) -> bool:
    """Whether a value may stand where a number, a truth value or text is asked for; other types are not checked."""
    kinds = [kind for kind in (annotation, *get_args(annotation)) if kind in (bool, int, float, str)]
    if annotation not in (bool, int, float, str) and get_origin(annotation) not in (Union, UnionType):
        return True
    if (
        not kinds
        or any(get_origin(kind) is not None for kind in get_args(annotation))
        or (value is None and type(None) in get_args(annotation))
        or isinstance(value, Path)
    ):
        return True
    return any(type(value) is kind or (kind is float and type(value) is int) for kind in kinds)


def _finite(value: Any) -> bool:
    """Whether a value is no float, or a finite one; of a list or tuple, each."""
    if isinstance(value, (list, tuple)):
        return all(_finite(one) for one in value)
    return not isinstance(value, float) or math.isfinite(value)


def typed(annotation: Any, value: Any) -> Any:
    """Return an option's value as its type: text as a path, a list as a tuple; else as it is."""
    if isinstance(value, list) and get_origin(annotation) is tuple:
        return tuple(value)
    is_path = Path in (annotation, *get_args(annotation))
    return expanded(value) if is_path and isinstance(value, (str, Path)) else value


def unusable(plugin: Plugin) -> str:
    """Why a plugin's options cannot be configured; empty when they can."""
    try:
        hints = get_type_hints(plugin.cls)
    except ANY_FAULT as fault:
        return f"its annotations do not resolve, {one_line(fault)}"
    for option in fields(plugin.cls):
        if option.init and option.name in RESERVED:
            return f"option '{option.name}' has a reserved name"
        if option.init and not _is_plain(hints[option.name]):
            return (
                f"option '{option.name}' is {hints[option.name]}; use numbers, strings, paths, Literal words or tuples"
            )
    return ""


def _is_plain(annotation: Any) -> bool:
    """Whether Hydra can hold an option of this type."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return all(isinstance(word, str) for word in args)
    if origin in (Union, UnionType, tuple, list):
        return all(_is_plain(arg) for arg in args if arg not in (type(None), Ellipsis))
    return annotation in (int, float, str, bool, Path)
