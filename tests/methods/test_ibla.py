"""Restoration by blurriness and light absorption, against its formulas computed by hand."""

import numpy as np
import pytest

from sucre_bench.methods.ibla import (
    attenuation_ratio,
    veiling_light_of,
)

RNG = np.random.default_rng(0)


def test_the_ratio_of_attenuation_is_that_of_the_wavelengths_and_the_veiling_light() -> None:
    """By hand: m l + i = .92457, 1.01497, 1.11667; .2 * 1.01497 / (.5 * .92457), .2 * 1.11667 / (.6 * .92457)."""
    ratio = attenuation_ratio(np.array([0.2, 0.5, 0.6]))
    np.testing.assert_allclose(ratio, [1, 0.439110, 0.402591], atol=1e-6)
    # blue scatters more: the wavelengths are not swapped
    assert attenuation_ratio(np.array([0.3, 0.3, 0.3]))[2] > 1


@pytest.mark.parametrize(("level", "expected"), [(0.3, "least"), (0.8, "greatest")])
def test_the_veiling_light_is_the_least_candidate_in_dark_water_and_the_greatest_in_bright(
    level: float, expected: str
):
    """The flat quarter is the block of least variance, the corner what is most blurred."""
    rgb = (level + RNG.uniform(-0.1, 0.1, (64, 64, 1)) * np.ones(3)).astype(np.float32)
    rgb[:33, :33] = level - 0.05
    rgb[33:, 33:] = level + 0.05 + 0.001 * RNG.random((31, 31, 1), dtype=np.float32)
    sharpness = np.ones((64, 64), np.float32)
    sharpness[33:, 33:] = 0.1
    A = veiling_light_of(rgb, sharpness)
    np.testing.assert_allclose(
        A, level + (0.05 if expected == "greatest" else -0.05), atol=2e-3
    )
