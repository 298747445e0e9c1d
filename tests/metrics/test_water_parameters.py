"""water_parameters: what a method estimates, as it is."""

import numpy as np
import pytest

from sucre_bench import plugins
from sucre_bench.arrays import Array
from sucre_bench.metrics.water import WaterParameters
from sucre_bench.scene import Arrays, Restoration, Score, View, Water

IMAGE = np.zeros((2, 2, 3), np.float32)
WATER = Water(np.array([0.1, 0.2, 0.4]), np.array([0.5, 0.3, 0.2]), np.array([0.7, np.nan, 0.6]))


def scores(variant: str, water: Water | None, image: Array = IMAGE) -> list[Score]:
    return list(WaterParameters().score(Restoration(image, water), image, View("a.png", Arrays(IMAGE)), variant))


@pytest.mark.parametrize(
    ("name", "values"),
    [("veiling_light", [0.1, 0.2, 0.4]), ("attenuation", [0.5, 0.3, 0.2]), ("backscatter", [0.7, np.nan, 0.6])],
)
def test_every_channel_of_every_parameter_passes_through(name: str, values: list[float]) -> None:
    found = [scores(f"{name}-{channel}", WATER) for channel in ("red", "green", "blue")]
    np.testing.assert_array_equal([score.value for (score,) in found], values)
    assert all(score.region == "image" for (score,) in found)


def test_all_nine_are_asked_for_by_default() -> None:
    assert len(WaterParameters.__plugin__.default) == 9
    assert set(WaterParameters.__plugin__.default) == set(WaterParameters.__plugin__.variants)


def test_without_an_estimate_there_is_no_score() -> None:
    assert not scores("attenuation-red", None)


def test_coverage_is_that_of_the_restoration() -> None:
    holed = IMAGE.copy()
    holed[0, 0] = np.nan
    (score,) = scores("attenuation-red", WATER, holed)
    assert (score.n_pixels, score.coverage) == (3, 0.75)


@pytest.mark.parametrize("name", ["water_parameters", "distance_variance", "chart_distance", "hue", "patch_colour"])
def test_what_describes_is_no_contest(name: str) -> None:
    assert plugins.find("metric", name).better == "none"
