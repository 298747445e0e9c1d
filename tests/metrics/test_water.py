"""water and water_parameters: relative errors by hand, and what a method estimates as it is."""

from __future__ import annotations

import numpy as np
import pytest

from sucre_bench.metrics.water import Water, WaterParameters
from sucre_bench.scene import Arrays, Restoration, Score, View, Water as SceneWater

IMAGE = np.zeros((2, 2, 3), np.float32)
TRUTH = SceneWater(
    np.array([0.1, 0.2, 0.4]), np.array([0.4, 0.2, 0.1]), np.array([0.3, 0.0, 0.2])
)
ESTIMATE = SceneWater(
    np.array([0.11, 0.2, 0.2]), np.array([0.2, 0.3, 0.1]), np.array([0.3, 0.1, 0.1])
)


def scores(variant: str, restored: Restoration) -> dict[str, Score]:
    return {
        s.region: s
        for s in Water().score(restored, IMAGE, View("a.png", Arrays(IMAGE)), variant)
    }


@pytest.mark.parametrize(
    ("variant", "errors", "mean"),
    [
        ("veiling_light", [0.1, 0, 0.5], 0.2),
        ("attenuation", [0.5, 0.5, 0], 1 / 3),
        ("backscatter", [0, np.nan, 0.5], 0.25),  # no relative error of a true 0
    ],
)
def test_error_is_relative_to_the_truth_by_channel_and_in_the_mean(
    variant: str, errors: list[float], mean: float
):
    found = scores(variant, Restoration(IMAGE, ESTIMATE, info={"true_water": TRUTH}))
    assert list(found) == ["image", "image/red", "image/green", "image/blue"]
    np.testing.assert_allclose([s.value for s in found.values()], [mean, *errors], atol=1e-12)


def test_without_an_estimate_or_a_truth_there_is_no_score() -> None:
    assert not scores("attenuation", Restoration(IMAGE, info={"true_water": TRUTH}))
    assert not scores("attenuation", Restoration(IMAGE, ESTIMATE))


def test_a_parameter_that_is_not_estimated_has_no_score_and_the_others_have() -> None:
    unknown = np.full(3, np.nan)
    restored = Restoration(
        IMAGE,
        SceneWater(np.array([0.1, 0.2, 0.2]), unknown, unknown),
        info={"true_water": TRUTH},
    )
    assert not scores("attenuation", restored)
    assert scores("veiling_light", restored)["image"].value == pytest.approx(0.5 / 3)


KNOWN = SceneWater(
    np.array([0.1, 0.2, 0.4]), np.array([0.5, 0.3, 0.2]), np.array([0.7, np.nan, 0.6])
)


def parameters(variant: str, water: SceneWater | None) -> list[Score]:
    return list(
        WaterParameters().score(
            Restoration(IMAGE, water), IMAGE, View("a.png", Arrays(IMAGE)), variant
        )
    )


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("veiling_light", [0.1, 0.2, 0.4]),
        ("attenuation", [0.5, 0.3, 0.2]),
        ("backscatter", [0.7, np.nan, 0.6]),
    ],
)
def test_every_channel_of_every_parameter_passes_through(
    name: str, values: list[float]
) -> None:
    found = [parameters(f"{name}-{channel}", KNOWN) for channel in ("red", "green", "blue")]
    np.testing.assert_array_equal([score.value for (score,) in found], values)
    assert all(score.region == "image" for (score,) in found)
