"""Checks what a Python script passes to public functions and classes: a wrong argument is one line that names it."""

import functools
import inspect
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from contextvars import ContextVar
from numbers import Integral, Real
from types import UnionType
from typing import Any, Literal, ParamSpec, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np
import typeguard
from typeguard import (
    CollectionCheckStrategy,
    TypeCheckerCallable,
    TypeCheckError,
    TypeCheckMemo,
)

from sucre_bench.errors import InputError, is_utf8, shown_value

P = ParamSpec("P")
T = TypeVar("T")

_WORDS = {
    str: "text",
    int: "a whole number",
    float: "a number",
    bool: "True or False",
    type(None): "None",
}


def checked(call: Callable[P, T]) -> Callable[P, T]:
    """Decorate a public function: an argument that does not fit its annotation is an InputError."""
    signature = inspect.signature(call)
    hints = functools.cache(lambda: get_type_hints(call))

    @functools.wraps(call)
    def checking(*args: P.args, **kwargs: P.kwargs) -> T:
        function = call.__qualname__
        try:
            given = signature.bind(*args, **kwargs).arguments
        except TypeError as fault:
            raise InputError(str(fault), function, f"see help({function})") from fault
        for name, value in given.items():
            check_argument(f"{function}({name})", value, hints().get(name, Any))
        return call(*args, **kwargs)

    return checking


def checked_fields(cls: type[T]) -> type[T]:
    """Decorate a public class, below @dataclass: a field that does not fit its annotation is an InputError.

    Dataclasses that are made from the class check its fields, too.
    """
    inherited = getattr(cls, "__post_init__", None)
    hints = functools.cache(lambda: get_type_hints(cls))

    def check_fields(made: Any) -> None:
        for name, hint in hints().items():
            check_argument(f"{type(made).__qualname__}({name})", getattr(made, name), hint)
        if inherited:
            inherited(made)

    cls.__post_init__ = check_fields  # type: ignore[attr-defined]
    return cls


def check_argument(place: str, value: Any, hint: Any) -> None:
    """Raise InputError unless a value fits a type, see `fits`. place: as the user typed it."""
    if not fits(value, hint):
        below = " below 2^63" if isinstance(value, int) and abs(value) >= 2**63 else ""
        raise InputError(f"is {shown_value(value)}", place, f"pass {wording(hint)}{below}")


def fits(value: object, hint: Any) -> bool:
    """Whether a value is of a type. True and False are no numbers, a whole number is a number; text is no list.

    Of arrays nothing is checked here, see `array_of`; of protocols and iterators neither.
    """
    token = _at_work.set(True)
    try:
        typeguard.check_type(
            value, hint, collection_check_strategy=CollectionCheckStrategy.ALL_ITEMS
        )
    except Exception:
        # also of collections that cannot be looped over
        return False
    finally:
        _at_work.reset(token)
    return True


# Other code that uses typeguard keeps its own rules: ours hold only inside `fits`.
_at_work: ContextVar[bool] = ContextVar("fits is at work", default=False)


def _check_number(value: Any, kind: Any, *_: object) -> None:
    is_number = isinstance(value, Integral if kind is int else Real)
    if not is_number or isinstance(value, bool):
        raise TypeCheckError("is no number")
    if isinstance(value, Integral) and not -(2**63) <= int(value) < 2**63:
        raise TypeCheckError("is too large for tables")


def _check_text(value: Any, *_: object) -> None:
    if not isinstance(value, str) or not is_utf8(value):
        raise TypeCheckError("is no text")


def _check_several(value: Any, kind: Any, of: tuple[Any, ...], memo: TypeCheckMemo) -> None:
    # a set is taken for a frozenset
    is_several = isinstance(value, Set if kind is frozenset else kind)
    if not is_several or isinstance(value, (str, bytes, Mapping)):
        raise TypeCheckError("is no list")
    if not isinstance(value, Iterator):
        for one in value:
            typeguard.check_type_internal(one, of[0], memo)


def _pass_over(*_: object) -> None:
    pass


_CHECKS: dict[Any, TypeCheckerCallable] = {
    int: _check_number,
    float: _check_number,
    str: _check_text,
    Sequence: _check_several,
    Iterable: _check_several,
    frozenset: _check_several,
    np.ndarray: _pass_over,
}


def _our_check(kind: Any, *_: object) -> TypeCheckerCallable | None:
    if not _at_work.get():
        return None
    if getattr(kind, "_is_protocol", False):
        return _pass_over
    return _CHECKS.get(kind)


typeguard.checker_lookup_functions.insert(0, _our_check)


def wording(hint: Any) -> str:
    """Return what to pass for a type: "a number or None"."""
    origin = get_origin(hint)
    inner = [one for one in get_args(hint) if one is not ...]
    if origin in (Union, UnionType):
        return " or ".join(map(wording, inner))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin in (Sequence, Iterable, list, tuple):
        return f"a {'tuple' if origin is tuple else 'list'} of {', '.join(map(wording, inner))}"
    return _WORDS.get(hint) or re.sub(r"\w+\.", "", inspect.formatannotation(hint))


def array_of(
    place: str, value: Any, shape: tuple[int | str, ...], finite: bool = False, kinds: str = "f"
) -> Any:
    """Return a value as a NumPy array of numbers of this shape. Letters stand for any length but 0: ("H", "W", 3).

    kinds: of numbers, as `numpy.dtype.kind`. A masked value is NaN. Raises InputError for another shape, other numbers,
    and if finite is True for NaN and infinity. place: as the user typed it.
    """
    lengths = f"{shape[0]}," if len(shape) == 1 else ", ".join(map(str, shape))
    remedy = f"pass {'finite ' if finite else ''}floats of shape ({lengths})"
    try:
        if isinstance(value, np.ma.MaskedArray):
            value = np.ma.filled(value.astype(np.float64), np.nan)
        array = np.asarray(value)
    except Exception as fault:
        # of a list of lists of other lengths, or another library's array on a GPU
        raise InputError(f"is no array but {shown_value(value)}", place, remedy) from fault
    is_right = array.ndim == len(shape) and array.size
    for length, wanted in zip(array.shape, shape, strict=False):
        is_right = is_right and (length == wanted or isinstance(wanted, str))
    if not is_right:
        given = f"has shape {array.shape}" if array.ndim else f"is {shown_value(value)}"
        raise InputError(given, place, remedy)
    if array.dtype.kind not in kinds:
        raise InputError(f"is of {array.dtype}", place, remedy)
    if finite and not np.isfinite(array).all():
        raise InputError("is not finite", place, remedy)
    return array
