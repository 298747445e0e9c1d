"""Options of the single-image restorers that mean nothing are refused; those at the ends of their ranges work."""

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args, get_origin

import numpy as np
import pytest
from support.forward_model import NOISE, UNWANTED, restored
from support.messages import names

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.plugins.options import Option, check_ranges, options_of
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
NUMBERS = [
    pytest.param(plugin, option, id=f"{name}.{option.name}")
    for name, plugin in METHODS.items()
    for option in options_of(plugin.cls)
    if {int, float} & {option.type, *get_args(option.type)}
]
NONSENSE = [float("nan"), float("inf"), float("-inf"), -1, -1e-9, 10**12, 1e300, "2", True]


@method(name="made_for_ranges")
@dataclass(frozen=True)
class Made:
    """Options of every type that has a range."""

    whole: int = 1
    share: float = 0.5
    open_end: float = 0.0
    maybe: int | None = None
    many: tuple[float, ...] = (0.5, 0.6)

    def __post_init__(self) -> None:
        check_ranges(
            self,
            whole="[1, 3]",
            share="(0, 1]",
            open_end="[0, 50)",
            maybe="[1, 9]",
            many="(0, 1]",
        )

    def restore(self, scene: Scene, view: View) -> Restoration:
        return Restoration(view.rgb)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"whole": 0}, "[1, 3]"),
        ({"whole": 2.0}, "[1, 3]"),
        ({"whole": None}, "[1, 3]"),
        ({"share": 0.0}, "(0, 1]"),
        ({"share": 1.0001}, "(0, 1]"),
        ({"share": float("nan")}, "(0, 1]"),
        ({"share": (0.5,)}, "(0, 1]"),
        ({"open_end": 50}, "[0, 50)"),
        ({"maybe": 0}, "[1, 9]"),
        ({"many": (0.5, float("nan"))}, "(0, 1]"),
        ({"many": 0.5}, "(0, 1]"),
    ],
)
def test_what_does_not_is_refused_in_one_line_with_the_option_its_value_and_its_range(
    wrong: dict[str, Any], named: str
) -> None:
    with pytest.raises(InputError) as fault:
        Made(**wrong)
    ((option, value),) = wrong.items()
    assert re.match(rf"made_for_ranges\.{option}: {re.escape(str(value))}; ", str(fault.value))
    assert named in names(fault.value)


def given(option: Option, value: object) -> object:
    return (value,) * 3 if get_origin(option.type) is tuple else value


@pytest.mark.parametrize(("plugin", "option"), NUMBERS)
def test_no_number_of_a_restorer_may_be_nonsense(plugin: Plugin, option: Option) -> None:
    """Every field, so that none can be forgotten; made directly, without the engine's own checks."""
    for value in [*NONSENSE, *([1.5] if option.type is int else [])]:
        with pytest.raises(
            InputError, match=rf"^{plugin.name}\.{option.name}: .*; give [^\n]*$"
        ):
            plugin.cls(**{option.name: given(option, value)})


def ends(plugin: Plugin, option: Option) -> tuple[object, object]:
    """The least and the greatest value of an option's range, which its refusal names."""
    with pytest.raises(InputError) as fault:
        plugin.cls(**{option.name: given(option, float("nan"))})
    (interval,) = re.findall(r"([\[(])(\S+), (\S+)([\])])", str(fault.value))
    low, high = map(float, interval[1:3])
    if "whole" in str(fault.value):
        return int(low), min(int(high), 99)  # more only takes time
    low += 1e-9 * (interval[0] == "(")
    high -= 1e-3 * (interval[3] == ")")
    return given(option, low), given(option, high)


@pytest.mark.parametrize("end", [0, 1], ids=["least", "greatest"])
@pytest.mark.parametrize("name", NAMES)
def test_at_the_ends_of_their_ranges_options_give_finite_colours(name: str, end: int) -> None:
    options = {}
    for plugin, option in (one.values for one in NUMBERS):
        if plugin.name == name:
            options[option.name] = ends(plugin, option)[end]
    made = METHODS[name].cls(**options)
    for image in (*UNWANTED.values(), NOISE):
        assert np.isfinite(restored(made, image).image).all()


@pytest.mark.parametrize("name", ["udcp", "ulap"])
def test_the_greatest_transmission_is_no_less_than_the_least(name: str) -> None:
    with pytest.raises(InputError, match=rf"^{name}\.greatest: 0\.4; .* \[0\.5, 1\]$"):
        METHODS[name].cls(least=0.5, greatest=0.4)


@pytest.mark.parametrize("value", [-1, float("nan"), float("-inf"), "2"])
def test_no_number_of_a_dataset_may_be_nonsense(tmp_path: Path, value: object) -> None:
    numbers = [
        (plugin, option.name)
        for plugin in discover("dataset").values()
        if isinstance(plugin, Plugin)
        for option in options_of(plugin.cls)
        if {int, float} & {option.type, *get_args(option.type)}
    ]
    assert len(numbers) > 20
    for plugin, name in numbers:
        with pytest.raises(InputError, match=rf"^{plugin.name}\.{name}: .*; "):
            plugin.cls(root=tmp_path, **{name: value})


@pytest.mark.parametrize("scale", [0.0, 1.5])
def test_images_are_scaled_down_and_not_to_nothing(tmp_path: Path, scale: float) -> None:
    with pytest.raises(InputError, match=rf"^colmap\.image_scale: {scale}; .*\(0, 1\]"):
        find("dataset", "colmap").cls(root=tmp_path, image_scale=scale)
