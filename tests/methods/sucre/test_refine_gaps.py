"""Two views that differ by a gain: gaps of one must not show in the colours, and where views agree nothing changes."""

import numpy as np
import pytest
from support.forward_model import in_water
from support.made_ground import SLOPE, WATERS, make_ground, with_pictures
from support.made_observations import ONE_MODEL, parameters
from support.made_scene import WATER

from sucre_bench.methods.sucre import Sucre
from sucre_bench.methods.sucre.refine_views import evened
from sucre_bench.methods.sucre.solution import colours_for_water
from sucre_bench.multiview.observations import Observations, Seen, arrange

SHAPE = (60, 90)
WATER_OF_ALL = parameters(WATER)
ROW, COLUMN = np.divmod(np.arange(SHAPE[0] * SHAPE[1]), SHAPE[1])
GAPS = (ROW + COLUMN) % 4 == 0
FIELD = COLUMN < 60  # of the other view


def two_views(gain: float) -> tuple[Observations, np.ndarray]:
    """The target, and a nearer view of its left part with gaps, brighter by a gain; and the true J (3, P)."""
    rng = np.random.default_rng(0)
    J = np.full((3, len(ROW)), 0.5) + rng.normal(0, 0.02, (3, len(ROW)))
    seen = []
    for name, chosen, z, factor in (
        ("target.png", np.arange(len(ROW)), 4.0, 1.0),
        ("other.png", np.flatnonzero(FIELD & ~GAPS), 2.5, gain),
    ):
        distance = np.full(len(chosen), z, np.float32)
        I = factor * in_water(J[:, chosen].T, distance, WATER)
        I += rng.normal(0, 0.004, I.shape)
        seen.append(Seen(name, chosen, distance, I.astype(np.float32)))
    observations = arrange(SHAPE, seen, with_view=True)
    return observations, J[:, observations.pixels]


def colours_and_evened(observations: Observations) -> tuple[np.ndarray, np.ndarray]:
    J = colours_for_water(observations, WATER_OF_ALL, None, "numpy", "cpu").J
    return observations.image(J), observations.image(
        evened(observations, J, WATER_OF_ALL, "target.png")
    )


@pytest.mark.parametrize("gain", [0.85, 1.2])
def test_gaps_of_a_view_do_not_show(gain: float) -> None:
    observations, _ = two_views(gain)
    inside = FIELD & (COLUMN < 45) & (COLUMN > 5)
    before, after = (image.reshape(-1, 3) for image in colours_and_evened(observations))
    step = [
        np.abs(image[inside & GAPS].mean(axis=0) - image[inside & ~GAPS].mean(axis=0))
        for image in (before, after)
    ]
    assert (step[0] > 0.05).all()
    assert (step[1] < 0.1 * step[0]).all()
    means = [image[inside].mean(axis=0) for image in (after, before)]
    np.testing.assert_allclose(*means, atol=2e-3)  # what all views say of a place stays


def test_pixels_that_the_target_does_not_show_stay() -> None:
    observations, _ = two_views(1.2)
    J = colours_for_water(observations, WATER_OF_ALL, None, "numpy", "cpu").J
    np.testing.assert_array_equal(evened(observations, J, WATER_OF_ALL, "elsewhere.png"), J)


def test_animals_without_weight_do_not_come_back_into_the_gaps() -> None:
    """Gray boxes in four of the seven views of a ground, found by robust=true, which refine=true must leave out."""
    rng = np.random.default_rng(1)

    def with_animals(k: int, rgb: np.ndarray) -> np.ndarray:
        if k % 2 == 0:
            for row, column in zip(rng.integers(0, 45, 4), rng.integers(0, 60, 4), strict=True):
                rgb[row : row + 15, column : column + 20] = 0.8
        return rgb

    clean = make_ground(WATERS["green"], **{**SLOPE, "width": 80, "height": 60})
    scene = with_pictures(clean, with_animals)

    def error(**options: bool) -> float:
        view = scene["3.png"]
        restored = Sucre(**{**ONE_MODEL, "robust": True}, **options).restore(scene, view)
        return float(np.sqrt(np.nanmean((restored.image - view.reference) ** 2)))

    assert error(refine=True) < 1.05 * error()
