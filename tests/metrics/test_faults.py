"""faults: each fault is found in a picture made with it, and in no true picture of the same scene."""

from dataclasses import dataclass

import numpy as np
import pytest

from sucre_bench.arrays import Array
from sucre_bench.metrics.faults import FAULTS, Faults
from sucre_bench.scene import Arrays, Restoration, View

pytestmark = pytest.mark.short
RNG = np.random.default_rng(11)
GROUND = 0.4 + 0.05 * np.kron(RNG.normal(size=(12, 16, 3)), np.ones((10, 10, 1)))
PHOTOGRAPH = (GROUND * [0.3, 0.8, 0.9] + RNG.normal(0, 0.002, GROUND.shape)).clip(0, 1).astype(np.float32)
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


HALF = np.where(np.arange(120)[:, None, None] < 60, np.nan, TRUE).astype(np.float32)
CASES = {
    "holes": Made(HALF),
    "guessed": Made(HALF, TRUE),
    "below": Made(_changed(top=[-0.1, 0.4, 0.4])),
    "above": Made(_changed(top=[1.3, 1.3, 1.3])),
    "clipped": Made(np.round(TRUE).astype(np.float32)),
    "cast": Made((TRUE * np.float32([1.4, 1, 0.5])).clip(0, 1)),
    "red": Made(_changed(top=[0.8, 0.1, 0.1])),
    "noise": Made((TRUE + RNG.normal(0, 0.1, TRUE.shape)).clip(0.01, 0.99).astype(np.float32)),
}


def scores(made: Made, variant: str) -> dict[str, float]:
    view = View("a.png", Arrays(PHOTOGRAPH))
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
    assert scores(Made(PHOTOGRAPH), "cast") == {"image": 0.0}


def test_a_picture_without_any_colour_has_holes_and_no_other_fault() -> None:
    empty = Made(np.full_like(TRUE, np.nan))
    assert {fault for fault in FAULTS if scores(empty, fault)["image"] > FAULTS[fault].limit} == {"holes"}
