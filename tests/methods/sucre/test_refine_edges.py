"""Pixels that other views show wrongly, as at outlines."""

import numpy as np
from support.forward_model import in_water
from support.made_ground import WATERS
from support.made_observations import parameters

from sucre_bench.methods.sucre.refine_views import corrected_edges

SHAPE = (80, 120)
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]
NEAR = 2.0
COAST = WATERS["coast"]
WATER = parameters(COAST)


def test_pixels_that_other_views_show_wrongly_get_what_the_image_shows_and_its_noise() -> None:
    rng = np.random.default_rng(1)
    J = (0.5 + 0.05 * rng.standard_normal((*SHAPE, 3))).astype(np.float32)
    distance = np.full(SHAPE, NEAR)
    I = in_water(J, distance, COAST) + 0.003 * rng.standard_normal(J.shape)
    I[70, 100] = np.nan
    wrong = (ROW % 9 == 4) & (COLUMN % 9 == 4)
    paired = np.where(wrong[..., None], J + 0.3, J).astype(np.float32)
    paired[:4], distance[:4] = np.nan, 0
    deviation = np.full((*SHAPE, 3), 0.002, np.float32)
    untold = (ROW < 40) & (COLUMN < 60)  # a deviation may be infinite
    deviation[untold] = np.inf
    found, left = corrected_edges(I, distance, paired, deviation, WATER)
    assert np.abs(found - J)[wrong].mean() < 0.04
    assert (left[wrong & ~untold] > deviation[wrong & ~untold]).all()
    assert not np.isnan(left).any()
    assert np.isfinite(left[wrong & untold]).mean() > 0.9
    np.testing.assert_array_equal(found[~wrong], paired[~wrong])
