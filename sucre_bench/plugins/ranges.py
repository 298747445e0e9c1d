"""Ranges of restorers' options: checked where a restorer is made, before any view is read."""

from __future__ import annotations

from numbers import Integral, Real
from typing import Any, get_args, get_origin

from sucre_bench.errors import InputError
from sucre_bench.plugins.options import options_of

__all__ = ["check_ranges"]


def check_ranges(plugin: Any, **ranges: str) -> None:
    """Raise InputError for the first option outside of its range: one line with its name, its value and the range.

    plugin: a decorated dataclass; ranges: option -> interval, such as ``"(0, 1]"``, of which "(" excludes the bound;
    of a tuple, each element is to lie in it. NaN lies in none. A whole number is asked for where the field is an int,
    and None is let through where it may be.
    """
    types = {option.name: option.type for option in options_of(type(plugin))}
    for option, interval in ranges.items():
        value, kind = getattr(plugin, option), types[option]
        if not _fits(value, kind, interval):
            place = f"{type(plugin).__plugin__.name}.{option}"
            raise InputError(f"{place}: {value!r}; give {_noun(kind)} in {interval}{' or none' * _is_optional(kind)}")


def _fits(value: Any, kind: Any, interval: str) -> bool:
    if get_origin(kind) is tuple:
        return isinstance(value, (tuple, list)) and all(_fits(one, get_args(kind)[0], interval) for one in value)
    if value is None:
        return _is_optional(kind)
    is_number = isinstance(value, Integral if _is_whole(kind) else Real) and not isinstance(value, bool)
    return is_number and _within(value, interval)


def _within(value: float, interval: str) -> bool:
    low, high = (float(bound) for bound in interval[1:-1].split(","))
    above = value > low if interval[0] == "(" else value >= low
    return bool(above and (value < high if interval[-1] == ")" else value <= high))


def _noun(kind: Any) -> str:
    noun = "whole number" if _is_whole(kind) else "number"
    return f"{noun}s" if get_origin(kind) is tuple else f"a {noun}"


def _is_whole(kind: Any) -> bool:
    return float not in (kind, *get_args(kind))


def _is_optional(kind: Any) -> bool:
    return type(None) in get_args(kind)
