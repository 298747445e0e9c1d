"""Options of the single-image restorers that mean nothing are refused; those at the ends of their ranges work."""

import functools
import re
from collections.abc import Iterable
from pathlib import Path
from typing import get_origin

import numpy as np
import pytest
from support.forward_model import NOISE, UNWANTED, restored

from sucre_bench import InputError
from sucre_bench.plugins.options import Option, options_of
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.plugins.registry import discover, find

NAMES = [
    "clahe",
    "fusion_2012",
    "fusion_2018",
    "haze_lines",
    "ibla",
    "red_compensation",
    "rghs",
    "udcp",
    "ulap",
]
METHODS = {name: find("method", name) for name in NAMES}


def numbers_of(plugins: Iterable[Plugin]) -> list[tuple[Plugin, Option]]:
    return [
        (plugin, option)
        for plugin in plugins
        for option in options_of(plugin.cls)
        if {int, float} & {*option.kinds}
    ]


NUMBERS = numbers_of(METHODS.values())
NONSENSE = [
    *(float("nan"), float("inf"), float("-inf"), -1, -1e-9, 10**12, 1e300),
    *("2", True, (0.5,)),
]


def given(option: Option, value: object) -> object:
    """The value, or a tuple of which it is the last element."""
    return (0.5, 0.5, value) if get_origin(option.type) is tuple else value


def range_of(plugin: Plugin, option: Option) -> tuple[str, float, float, str]:
    """Brackets and bounds of an option's range, which its refusal names."""
    with pytest.raises(InputError) as fault:
        plugin.cls(**{option.name: given(option, float("nan"))})
    (found,) = re.findall(r"([\[(])(\S+), (\S+)([\])])", str(fault.value).partition(";")[2])
    return found[0], float(found[1]), float(found[2]), found[3]


@pytest.mark.parametrize(
    ("plugin", "option"), NUMBERS, ids=[f"{plugin.name}.{o.name}" for plugin, o in NUMBERS]
)
def test_what_is_outside_its_range_is_refused_in_one_line_with_option_value_and_range(
    plugin: Plugin, option: Option
) -> None:
    """Every number of every restorer; made directly, without the engine's own checks."""
    left, low, high, right = range_of(plugin, option)
    excluded = [low] * (left == "(") + [high] * (right == ")")
    others = [] if type(None) in option.kinds else [None]
    others += [] if float in option.kinds else [2.0]
    for value in map(functools.partial(given, option), (*NONSENSE, *excluded, *others)):
        said = rf"^method\.{option.name}: {re.escape(repr(value))}; give [^\n]*[\[(][^\n]*$"
        with pytest.raises(InputError, match=said):
            plugin.cls(**{option.name: value})


def ends(plugin: Plugin, option: Option) -> tuple[object, object]:
    """The least and the greatest value of an option's range."""
    left, low, high, right = range_of(plugin, option)
    if float not in option.kinds:
        return int(low), min(int(high), 99)  # more only takes time
    low += 1e-9 * (left == "(")
    high -= 1e-3 * (right == ")")
    if get_origin(option.type) is tuple:
        return (low,) * 3, (high,) * 3
    return low, high


@pytest.mark.parametrize("end", [0, 1], ids=["least", "greatest"])
@pytest.mark.parametrize("name", NAMES)
def test_at_the_ends_of_their_ranges_options_give_finite_colours(name: str, end: int) -> None:
    options = {}
    for plugin, option in NUMBERS:
        if plugin.name == name:
            options[option.name] = ends(plugin, option)[end]
    made = METHODS[name].cls(**options)
    for image in (*UNWANTED.values(), NOISE):
        assert np.isfinite(restored(made, image).image).all()


@pytest.mark.parametrize("name", ["udcp", "ulap"])
def test_the_greatest_transmission_is_no_less_than_the_least(name: str) -> None:
    with pytest.raises(InputError, match=r"^method\.greatest: 0\.4; .* \[0\.5, 1\]$"):
        METHODS[name].cls(least=0.5, greatest=0.4)


@pytest.mark.parametrize("value", [-1, float("nan"), float("-inf"), "2"])
def test_no_number_of_a_dataset_may_be_nonsense(tmp_path: Path, value: object) -> None:
    known = discover("dataset").values()
    numbers = numbers_of(plugin for plugin in known if isinstance(plugin, Plugin))
    assert len(numbers) > 20
    for plugin, option in numbers:
        with pytest.raises(InputError, match=rf"^dataset\.{option.name}: .*; "):
            plugin.cls(root=tmp_path, **{option.name: value})


@pytest.mark.parametrize("scale", [0.0, 1.5])
def test_images_are_scaled_down_and_not_to_nothing(tmp_path: Path, scale: float) -> None:
    with pytest.raises(InputError, match=rf"^dataset\.image_scale: {scale}; .*\(0, 1\]"):
        find("dataset", "colmap").cls(root=tmp_path, image_scale=scale)
