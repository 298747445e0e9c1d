"""Ranges of options: checked when a plugin is made, before any view is read."""

from typing import Any, get_args, get_origin

from sucre_bench.errors import InputError, is_number_in, shown_value
from sucre_bench.plugins.options import options_of


def check_ranges(options: Any, place: str | None = None, /, **ranges: str) -> None:
    """Raise InputError for the first option outside of its range: one line with its name, its value and the range.

    options: a dataclass, of a plugin say; place: what stands before the option's name, default the plugin's name;
    ranges: option -> interval, such as ``"(0, 1]"``, of which "(" excludes the bound. Each element of a tuple must lie
    in it. NaN lies in none. A field of type int takes whole numbers only, and an optional one takes None.
    """
    types = {option.name: option.type for option in options_of(type(options))}
    for option, interval in ranges.items():
        value, kinds = getattr(options, option), (types[option], *get_args(types[option]))
        is_whole, is_many, is_optional = float not in kinds, get_origin(kinds[0]) is tuple, type(None) in kinds
        each = value if is_many and isinstance(value, (tuple, list)) else [value]
        if is_many != (each is value) or not all(is_number_in(interval, one, is_whole) for one in each):
            if value is None and is_optional:
                continue
            before = type(options).__plugin__.name if place is None else place
            noun = ("" if is_many else "a ") + ("whole number" if is_whole else "number") + "s" * is_many
            fault, remedy = shown_value(value), f"give {noun} in {interval}{' or none' * is_optional}"
            raise InputError(fault, f"{before}.{option}" if before else option, remedy)
