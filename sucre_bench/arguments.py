"""Checks what a Python script passes to public functions and classes: a wrong argument is one line that names it."""

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Set
from numbers import Integral, Real
from pathlib import Path
from types import SimpleNamespace, UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

from sucre_bench.errors import InputError, is_utf8, one_line, shown_value

P = ParamSpec("P")
T = TypeVar("T")

_WORDS = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    type(None): "None",
}
_WORDS |= {Mapping: "a dict", Path: "a path"}

# Parameters that take any number of arguments, and so lack none.
_OF_MANY = (inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD)


def checked(call: Callable[P, T]) -> Callable[P, T]:
    """Decorate a public function or dataclass: what does not fit is an InputError, see `check_argument`."""
    function: Callable[P, T] = call.__init__ if isinstance(call, type) else call  # type: ignore[misc]
    signature = inspect.signature(function)
    name = call.__qualname__

    @functools.cache
    def hints() -> dict[str, Any]:
        if isinstance(call, type):
            return get_type_hints(call)
        named = {
            one.name: one.annotation
            for one in signature.parameters.values()
            if one.annotation is not one.empty
        }
        return get_type_hints(
            SimpleNamespace(__annotations__=named), inspect.unwrap(call).__globals__
        )

    def lacking(args: Iterable[Any], kwargs: Mapping[str, Any]) -> str:
        """Name all arguments that are missing, if several are: Python's message names the first."""
        try:
            given = signature.bind_partial(*args, **kwargs).arguments
        except TypeError:
            return ""
        names = [
            one.name
            for one in signature.parameters.values()
            if one.default is one.empty and one.name not in given and one.kind not in _OF_MANY
        ]
        return f"missing required arguments: {', '.join(names)}" if len(names) > 1 else ""

    @functools.wraps(function)
    def checking(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            bound = signature.bind(*args, **kwargs)
        except TypeError as fault:
            missing = lacking(args, kwargs) or str(fault)
            raise InputError(missing, name, f"see help({name})") from fault
        given = bound.arguments
        for parameter, hint in hints().items():
            if (
                parameter in given
                and signature.parameters[parameter].kind is not inspect.Parameter.VAR_KEYWORD
            ):
                given[parameter] = check_argument(
                    f"{name}({parameter})", given[parameter], hint
                )
        return function(*bound.args, **bound.kwargs)

    if isinstance(call, type):
        _check_in_subclasses(
            call, checking, lambda: {one: hints()[one] for one in [*signature.parameters][1:]}
        )
        call.__init__ = checking  # type: ignore[misc]
        return call
    return checking


def _check_in_subclasses(
    cls: Any, checking: object, hints: Callable[[], dict[str, Any]]
) -> None:
    """Check these fields also in dataclasses made from this one, which have an `__init__` of their own."""
    inherited = getattr(cls, "__post_init__", None)

    def check_fields(made: Any, *unstored: Any) -> None:
        if type(made).__init__ is not checking:
            for field, hint in hints().items():
                check_argument(
                    f"{type(made).__qualname__}({field})", getattr(made, field), hint
                )
        if inherited:
            inherited(made, *unstored)

    cls.__post_init__ = check_fields


def check_argument(place: str, value: Any, hint: Any) -> Any:
    """Raise InputError unless a value fits a type: None fits no text, a text is no list. place: as the user typed it.

    Returns the value; of an iterator what it yields, unless that may be anything. `array_of` looks at arrays.
    """
    try:
        is_taken = fits(value, hint)
        if (
            is_taken
            and isinstance(value, Iterator)
            and not any(isinstance(one, TypeVar) for one in get_args(hint))
        ):
            value = tuple(value)
            is_taken = fits(value, hint)
    except Exception as fault:  # of a collection of the user's
        raise InputError(
            f"raises {one_line(fault)}", place, f"pass {_wording(hint)}"
        ) from fault
    if not is_taken:
        is_whole = isinstance(value, Integral) and not isinstance(value, bool)
        below = " below 2^63" if is_whole and hint is int else ""
        raise InputError(f"is {shown_value(value)}", place, f"pass {_wording(hint)}{below}")
    return value


def fits(value: object, hint: Any) -> bool:
    """Whether a value is of a type. True and False are no numbers, a whole number is a number; text is no list."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return any(fits(value, one) for one in inner)
    if origin is Literal:
        return isinstance(value, str) and value in inner
    if isinstance(origin, type) and issubclass(origin, Mapping):
        if not isinstance(value, Mapping):
            return False
        return inner[1] is Any or all(
            fits(key, inner[0]) and fits(one, inner[1]) for key, one in value.items()
        )
    if origin is tuple:
        kinds = (
            inner[:1] * len(value) if isinstance(value, tuple) and inner[-1] is ... else inner
        )
        return (
            isinstance(value, tuple)
            and len(value) == len(kinds)
            and all(map(fits, value, kinds))
        )
    if (
        isinstance(origin, type)
        and issubclass(origin, Iterable)
        and origin.__module__ != "numpy"
    ):
        kind: Any = Set if origin is frozenset else origin
        ndim, is_any = getattr(value, "ndim", 1), isinstance(inner[0], TypeVar)
        if not isinstance(value, kind) or isinstance(value, (str, bytes, Mapping)):
            return False
        if ndim != 1 and not (ndim and is_any):
            return False
        return (
            is_any or isinstance(value, Iterator) or all(fits(one, inner[0]) for one in value)
        )
    if hint in (int, float):
        is_number = isinstance(value, Integral if hint is int else Real) and not isinstance(
            value, bool
        )
        # as in tables
        return is_number and (not isinstance(value, Integral) or -(2**63) <= int(value) < 2**63)
    if hint is str:
        return isinstance(value, str) and (value.isascii() or is_utf8(value))
    is_class = (
        isinstance(hint, type) and origin is None and not getattr(hint, "_is_protocol", False)
    )
    return hint is Any or not is_class or isinstance(value, hint)


def _wording(hint: Any) -> str:
    """What to pass for a type: "a Scene", "text or None"."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(map(_wording, inner)))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin is tuple and inner[-1] is not ...:
        return f"a tuple ({', '.join(map(_wording, inner))})"
    if isinstance(origin, type) and not issubclass(origin, Mapping):
        if issubclass(origin, Set):
            return "a set of text"
        return "a list" if inner[0] is Any else f"a list of {_wording(inner[0])}"
    if inner and inner[0] is str and inner[1] is not Any:
        return "a dict with texts as keys"
    kind = Mapping if origin else hint
    return _WORDS.get(kind, f"a {getattr(kind, '__name__', kind)}")


def array_of(
    place: str, value: Any, shape: tuple[int | str, ...], finite: bool = False, kinds: str = "f"
) -> Any:
    """Return a value as a NumPy array of numbers of this shape. Letters stand for any length but 0: ("H", "W", 3).

    kinds: of numbers, as `numpy.dtype.kind`. A masked value is NaN. Raises InputError for another shape, other numbers,
    and if finite is True for NaN and infinity. place: as the user typed it.
    """
    import numpy as np

    lengths = f"{shape[0]}," if len(shape) == 1 else ", ".join(map(str, shape))
    remedy = f"pass {'finite ' if finite else ''}floats of shape ({lengths})"
    try:
        if isinstance(value, np.ma.MaskedArray):
            masked: Any = value if value.dtype.kind == "f" else value.astype(np.float64)
            value = masked.filled(np.nan)
        array = np.asarray(value)
    except Exception as fault:
        # of a list of lists of other lengths, or another library's array on a GPU
        raise InputError(
            f"is a {type(value).__name__} that is no array", place, remedy
        ) from fault
    pairs = zip(array.shape, shape, strict=False)
    if array.ndim != len(shape) or not all(
        n == want or (isinstance(want, str) and n) for n, want in pairs
    ):
        raise InputError(
            f"has shape {array.shape}" if array.ndim else f"is {shown_value(value)}",
            place,
            remedy,
        )
    if array.dtype.kind not in kinds:
        raise InputError(f"is of {array.dtype}", place, remedy)
    if finite and not np.isfinite(array).all():
        raise InputError("is not finite", place, remedy)
    return array
