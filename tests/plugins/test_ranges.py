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
            self, whole="[1, 3]", share="(0, 1]", open_end="[0, 50)", maybe="[1, 9]", many="(0, 1]"
        )

    def restore(self, scene: Scene, view: View) -> Restoration:
        return Restoration(view.rgb)


@pytest.mark.parametrize(
    "right",
    [
        {"whole": 1},
        {"whole": np.int64(3)},
        {"share": 1},
        {"share": np.float32(0.5)},
        {"open_end": 0},
        {"open_end": 49.999},
        {"maybe": None},
        {"maybe": 9},
        {"many": (1.0,)},
        {"many": [0.1, 0.2]},
    ],
)
def test_what_lies_in_its_range_is_taken(right: dict[str, Any]) -> None:
    Made(**right)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"whole": 0}, {"whole", "number", "[1, 3]"}),
        ({"whole": 2.0}, {"whole", "number", "[1, 3]"}),
        ({"whole": None}, {"whole", "number", "[1, 3]"}),
        ({"share": 0.0}, {"number", "(0, 1]"}),
        ({"share": 1.0001}, {"number", "(0, 1]"}),
        ({"share": float("nan")}, {"number", "(0, 1]"}),
        ({"share": (0.5,)}, {"number", "(0, 1]"}),
        ({"open_end": 50}, {"number", "[0, 50)"}),
        ({"maybe": 0}, {"whole", "number", "[1, 9]", "none"}),
        ({"many": (0.5, float("nan"))}, {"numbers", "(0, 1]"}),
        ({"many": 0.5}, {"numbers", "(0, 1]"}),
    ],
)
def test_what_does_not_is_refused_in_one_line_with_the_option_its_value_and_its_range(
    wrong: dict[str, Any], named: set[str]
) -> None:
    with pytest.raises(InputError) as fault:
        Made(**wrong)
    ((option, value),) = wrong.items()
    assert re.match(rf"made_for_ranges\.{option}: {re.escape(str(value))}; ", str(fault.value))
    assert named <= names(fault.value)


@pytest.mark.parametrize(("plugin", "option"), NUMBERS)
def test_no_number_of_a_restorer_may_be_nonsense(plugin: Plugin, option: Option) -> None:
    """Every field, so that none can be forgotten; made directly, without the engine's own checks."""
    for value in [*NONSENSE, *([1.5] if option.type is int else [])]:
        given = (0.5, value, 0.5) if get_origin(option.type) is tuple else value
        with pytest.raises(InputError, match=rf"^{plugin.name}\.{option.name}: .*; give [^\n]*$"):
            plugin.cls(**{option.name: given})


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("clahe", {"clip": 1e-9, "tiles": 256}),
        ("clahe", {"clip": 256, "tiles": 1}),
        (
            "fusion_2012",
            {"illuminant": 1, "percent": 49.9, "noise": 1, "clip": 256, "tiles": 256, "levels": 32},
        ),
        (
            "fusion_2012",
            {"illuminant": 0, "percent": 0, "noise": 1e-30, "clip": 1e-9, "tiles": 1, "levels": 1},
        ),
        ("fusion_2018", {"red": 10, "blue": 10, "gamma": 10, "blur_px": 200, "levels": 32}),
        ("fusion_2018", {"red": 0, "blue": 0, "gamma": 1e-9, "blur_px": 1e-9, "levels": 1}),
        ("rghs", {"distance_m": 100, "tail": 49.999, "noise": 1}),
        ("rghs", {"distance_m": 0, "tail": 0, "noise": 0}),
        ("red_compensation", {"strength": 10, "percent": 49.999}),
        ("red_compensation", {"strength": 0, "percent": 0}),
        ("udcp", {"window": 1001, "radius": 1000, "eps": 1, "least": 1, "greatest": 1}),
        ("udcp", {"window": 1, "radius": 1, "eps": 1e-6, "least": 1e-6, "greatest": 1e-6}),
        ("ulap", {"remaining": (1, 1, 1), "deepest": 1e-9, "share": 1, "radius": 1000, "eps": 1}),
        (
            "ulap",
            {
                "remaining": (1e-3, 1e-3, 1e-3),
                "deepest": 1000,
                "share": 1e-9,
                "radius": 1,
                "eps": 1e-6,
            },
        ),
        ("ulap", {"deepest": 1000, "least": 1e-6, "greatest": 1e-6}),
        (
            "ibla",
            {
                "window": 1001,
                "scales": 8,
                "radius": 1000,
                "eps": 1,
                "deepest": 1000,
                "red": 10,
                "least": 1e-6,
            },
        ),
        (
            "ibla",
            {
                "window": 1,
                "scales": 1,
                "radius": 1,
                "eps": 1e-6,
                "deepest": 1e-9,
                "red": 1e-9,
                "work_px": 1,
            },
        ),
        (
            "haze_lines",
            {
                "lines": 1,
                "radius": 1,
                "eps": 1e-6,
                "least": 1e-6,
                "contrast": 0,
                "textureless": 1e-9,
            },
        ),
        (
            "haze_lines",
            {"lines": 5000, "radius": 1000, "eps": 1, "least": 1, "contrast": 1, "textureless": 1},
        ),
        ("haze_lines", {"work_px": 1}),
    ],
)
def test_at_the_ends_of_their_ranges_options_give_finite_colours(
    name: str, options: dict[str, Any]
) -> None:
    for kind in ("black", "white", "gray", "black and white", "1 x 1"):
        assert np.isfinite(restored(METHODS[name].cls(**options), UNWANTED[kind]).image).all()
    assert np.isfinite(restored(METHODS[name].cls(**options), NOISE).image).all()


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
