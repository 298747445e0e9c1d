"""Ranges of options: checked when a plugin is made, before any view is read."""

from typing import Any, get_args, get_origin

from sucre_bench.errors import InputError, is_number_in
from sucre_bench.plugins.options import options_of


def check_ranges(options: Any, place: str | None = None, /, **ranges: str) -> None:
    """Raise InputError for the first option outside of its range: one line with its name, its value and the range.

    options: a dataclass, of a plugin say; place: what stands before the option's name, default the plugin's name;
    ranges: option -> interval, such as ``"(0, 1]"``, of which "(" excludes the bound. Each element of a tuple must lie
    in it. NaN lies in none. A field of type int takes whole numbers only, and an optional one takes None.
    """
    types = {option.name: option.type for option in options_of(type(options))}
    for option, interval in ranges.items():
        value, kind = getattr(options, option), types[option]
        if not _fits(value, kind, interval):
            before = type(options).__plugin__.name if place is None else place
            name = f"{before}.{option}" if before else option
            raise InputError(f"{value!r}", name, f"give {_noun(kind)} in {interval}{' or none' * _is_optional(kind)}")


def _fits(value: Any, kind: Any, interval: str) -> bool:
    if get_origin(kind) is tuple:
        return isinstance(value, (tuple, list)) and all(_fits(one, get_args(kind)[0], interval) for one in value)
    if value is None:
        return _is_optional(kind)
    return is_number_in(interval, value, _is_whole(kind))


def _noun(kind: Any) -> str:
    noun = "whole number" if _is_whole(kind) else "number"
    return f"{noun}s" if get_origin(kind) is tuple else f"a {noun}"


def _is_whole(kind: Any) -> bool:
    return float not in (kind, *get_args(kind))


def _is_optional(kind: Any) -> bool:
    return type(None) in get_args(kind)
