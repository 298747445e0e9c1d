"""The water from matched footprints, on ground of white noise whose far pixels average more of it than near ones."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.made_ground import SLOPE, WATERS, errors_of_water, make_ground, with_pictures
from support.made_observations import ONE_MODEL, record_of

from sucre_bench import Restoration, Scene
from sucre_bench.degrade import degraded
from sucre_bench.methods.sucre import Sucre

sucre = partial(Sucre, **ONE_MODEL)
GROUND = {name: SLOPE[name] for name in ("width", "height", "heights_m")}


@pytest.fixture(scope="module")
def grounds() -> dict[str, Scene]:
    return {
        name: make_ground(water, **GROUND)
        for name, water in WATERS.items()
        if name in ("coast", "green", "milky")
    }


@pytest.fixture(scope="module")
def matched(grounds: dict[str, Scene]) -> dict[str, Restoration]:
    return {name: sucre().restore(scene, scene["3.png"]) for name, scene in grounds.items()}


@pytest.mark.parametrize("name", ["coast", "green", "milky"])
def test_water_is_found_where_single_pixels_mistake_blur_for_attenuation(
    name: str, grounds: dict[str, Scene], matched: dict[str, Restoration]
) -> None:
    scene = grounds[name]
    plain = sucre(footprint=False).restore(scene, scene["3.png"])
    assert errors_of_water(plain, scene.water)[1].min() > 0.08
    assert np.abs(errors_of_water(matched[name], scene.water)).max() < 0.025
    assert matched[name].info["footprint"] is True


def test_colours_that_a_jpeg_stores_at_half_size_leave_the_water_right() -> None:
    """Its detail of red is that of brightness, which water does not take away: beta was 20 % too high."""
    scene = degraded(make_ground(WATERS["green"], width=160, height=120), jpeg_quality=95)
    assert (
        np.abs(errors_of_water(sucre().restore(scene, scene["3.png"]), scene.water)).max() < 0.1
    )


def test_light_that_is_cut_off_at_white_leaves_the_water_right() -> None:
    """Near pixels are cut off more often than far ones: beta was 9 % too low."""
    truth = WATERS["green"]
    ground = make_ground(truth, width=160, height=120)
    scene = with_pictures(ground, lambda _, rgb: 1.6 * rgb)
    brighter = replace(truth, veiling_light=1.6 * truth.veiling_light)
    assert (
        np.abs(errors_of_water(sucre().restore(scene, scene["3.png"]), brighter)).max() < 0.03
    )


def test_colours_come_from_sharp_pixels(
    grounds: dict[str, Scene], matched: dict[str, Restoration], tmp_path: Path
):
    scene, result = grounds["coast"], matched["coast"]
    (tmp_path / "water.json").write_text(json.dumps(record_of(result.water)))
    given = sucre(water=str(tmp_path / "water.json")).restore(scene, scene["3.png"])
    np.testing.assert_array_equal(result.image, given.image)
