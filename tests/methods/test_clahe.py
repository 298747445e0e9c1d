"""CLAHE: lightness is equalised, colour is kept."""

import numpy as np
from support.forward_model import restored_image as restored

from sucre_bench.imaging.cielab import to_lab
from sucre_bench.methods.clahe import Clahe

RNG = np.random.default_rng(0)
DULL = np.float32([0.2, 0.4, 0.45]) + np.float32(0.1) * RNG.random((64, 80, 1), dtype=np.float32)


def test_contrast_rises_and_colour_is_kept():
    """Taken for BGR, the lightness and the hue of a bluish image would be those of another."""
    before, after = to_lab(DULL), to_lab(restored(Clahe(), DULL))
    assert after[..., 0].std() > 1.5 * before[..., 0].std()
    np.testing.assert_allclose(after[..., 1:], before[..., 1:], atol=0.6)


def test_a_higher_clip_gives_more_contrast():
    spread = [to_lab(restored(Clahe(clip=clip), DULL))[..., 0].std() for clip in (1, 2, 4)]
    assert spread[0] < spread[1] < spread[2]


def test_lightness_is_not_reduced_to_a_few_values():
    ramp = np.tile(np.linspace(0.05, 0.95, 256, dtype=np.float32)[None, :, None], (64, 1, 3))
    assert len(np.unique(restored(Clahe(tiles=1), ramp)[0, :, 1])) > 120


def test_one_tile_treats_equal_pixels_equally_and_many_do_not():
    halves = np.where(np.arange(128)[None, :, None] < 64, 0.2, 0.6) + 0.05 * RNG.random((128, 128, 1))
    halves = np.repeat(halves, 3, axis=-1)
    halves[5, 5] = halves[5, 120] = 0.4
    one, many = (restored(Clahe(tiles=tiles), halves) for tiles in (1, 4))
    assert one[5, 5, 0] == one[5, 120, 0]
    assert abs(many[5, 5, 0] - many[5, 120, 0]) > 0.1
