"""faults: each fault is found in a picture made with it, and in no true picture of the same scene; turning dives."""

from dataclasses import dataclass

import numpy as np
import pytest

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.imaging.visible_faults import faults_of_dive, look_at
from sucre_bench.metrics.faults import FAULTS, Faults
from sucre_bench.scene import Arrays, Restoration, View

pytestmark = pytest.mark.short
RNG = np.random.default_rng(11)
GROUND = 0.4 + 0.05 * np.kron(RNG.normal(size=(12, 16, 3)), np.ones((10, 10, 1)))
PHOTOGRAPH = (
    (GROUND * [0.3, 0.8, 0.9] + RNG.normal(0, 0.002, GROUND.shape))
    .clip(0, 1)
    .astype(np.float32)
)
CAMERA = Camera(np.array([[200, 0, 80], [0, 200, 60], [0, 0, 1.0]]), 160, 120)
# a wall at 2 m before one at 4 m
DEPTH = np.where(np.arange(160) < 80, 2, 4) * np.ones((120, 1), np.float32)
TRUE = (PHOTOGRAPH / np.float32([0.3, 0.8, 0.9])).clip(0, 1)


@dataclass(frozen=True)
class Made:
    """A picture with one fault: image is J; filled, of a guess."""

    image: Array
    filled: Array | None = None


def _changed(**to: Array | float) -> Array:
    image = TRUE.copy()
    image[:60] = np.float32(to["top"])
    return image


def _rimmed() -> Array:
    image = TRUE.copy()
    image[:, 77:83] *= np.float32([0.2, 1, 1])
    return image


def _painted() -> Array:
    image = TRUE.copy()
    image[20:60, 40:110] = np.float32([0.4, 0.3, 0.2])
    return image


HALF = np.where(np.arange(120)[:, None, None] < 60, np.nan, TRUE).astype(np.float32)
CASES = {
    "holes": Made(HALF),
    "guessed": Made(HALF, TRUE),
    "below": Made(_changed(top=[-0.1, 0.4, 0.4])),
    "rims": Made(_rimmed()),
    "flat": Made(_painted()),
    "above": Made(_changed(top=[1.3, 1.3, 1.3])),
    "clipped": Made(np.round(TRUE).astype(np.float32)),
    "cast": Made((TRUE * np.float32([1.4, 1, 0.5])).clip(0, 1)),
    "red": Made(_changed(top=[0.3, 0.05, 0.05])),
    "noise": Made((TRUE + RNG.normal(0, 0.1, TRUE.shape)).clip(0.01, 0.99).astype(np.float32)),
}


def scores(made: Made, variant: str) -> dict[str, float]:
    view = View("a.png", Arrays(PHOTOGRAPH, DEPTH), CAMERA)
    shown = made.image.clip(0, 1)
    found = Faults().score(Restoration(made.image, filled=made.filled), shown, view, variant)
    return {score.region: score.value for score in found}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_above_its_limit_where_it_was_made_and_not_in_the_truth(fault: str) -> None:
    assert scores(CASES[fault], fault)["image"] > FAULTS[fault].limit
    assert not scores(Made(TRUE), fault)["image"] > FAULTS[fault].limit


def test_shares_are_of_the_picture_and_a_guess_is_no_hole() -> None:
    assert scores(CASES["holes"], "holes") == {"image": 0.5}
    assert scores(CASES["guessed"], "holes") == {"image": 0.0}
    assert scores(CASES["guessed"], "guessed") == {"image": 0.5}
    assert scores(CASES["below"], "below") == {"image": 0.5}


def test_a_cast_has_a_name_and_the_photograph_has_none() -> None:
    assert set(scores(CASES["cast"], "cast")) == {"image", "image/orange"}
    blue = (TRUE * np.float32([0.6, 0.8, 1.6])).clip(0, 1)
    assert set(scores(Made(blue), "cast")) == {"image", "image/blue"}
    assert scores(Made(PHOTOGRAPH), "cast")["image"] == pytest.approx(0, abs=1e-3)


def test_blue_tiles_are_no_cast_and_brown_ones_are() -> None:
    """A pool: tiles are really blue and grout is white, so a restorer that makes grout orange has changed colours."""
    is_grout = (np.arange(120)[:, None] % 8 < 2) | (np.arange(160) % 8 < 2)
    tiles = np.where(is_grout[..., None], [0.8, 0.8, 0.8], [0.25, 0.3, 0.65]).astype(np.float32)
    photograph = tiles * np.float32([0.85, 1, 0.95])
    right, brown = tiles, (tiles * np.float32([1, 0.75, 0.4])).astype(np.float32)
    for picture, kinds in ((photograph, set()), (right, set()), (brown, {"cast"})):
        (found,) = faults_of_dive([look_at(picture, photograph, DEPTH)])
        assert {fault.kind for fault in found} == kinds


def test_a_dive_that_turns_is_seen_in_the_pictures_that_differ_from_the_others() -> None:
    tints = [[1, 1, 1], [1, 1, 1], [1.02, 1, 1], [0.7, 1, 1]]
    looks = [look_at((TRUE * np.float32(tint)).clip(0, 1), PHOTOGRAPH, DEPTH) for tint in tints]
    assert [[fault.kind for fault in found] for found in faults_of_dive(looks)] == [
        [],
        [],
        [],
        ["turning"],
    ]
    tinted = [(TRUE * np.float32(tint)).clip(0, 1) for tint in tints]
    same = [look_at(picture, picture, DEPTH) for picture in tinted]
    assert not any(fault.kind == "turning" for found in faults_of_dive(same) for fault in found)


def test_a_picture_without_any_colour_has_holes_and_no_other_fault() -> None:
    empty = Made(np.full_like(TRUE, np.nan))
    assert {
        fault for fault in FAULTS if scores(empty, fault)["image"] > FAULTS[fault].limit
    } == {"holes"}
