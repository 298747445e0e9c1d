"""The simple restorers, against what their definitions say."""

import numpy as np
import pytest
from support.made_scene import make_scene

from sucre_bench import Arrays, InputError, Scene, SolveError, View
from sucre_bench.imaging.display import display
from sucre_bench.methods.gray_world import GrayWorld
from sucre_bench.methods.histogram_stretch import HistogramStretch
from sucre_bench.methods.stitching import Stitching
from sucre_bench.methods.underwater import Underwater
from sucre_bench.multiview.pairing import lift, match

SCENE = make_scene()
TARGET = SCENE["a.png"]


def photo(rgb: np.ndarray, depth: np.ndarray | None = None) -> View:
    return View("photo.png", Arrays(rgb, depth))


def alone(view: View) -> Scene:
    return Scene("alone", [view], frozenset())


def test_underwater_is_the_input() -> None:
    assert np.array_equal(Underwater().restore(SCENE, TARGET).image, TARGET.rgb)


def test_gray_world_makes_the_means_over_valid_pixels_equal() -> None:
    image = GrayWorld().restore(SCENE, TARGET).image
    mean = image[TARGET.valid].mean(axis=0, dtype=np.float64)
    np.testing.assert_allclose(mean, TARGET.rgb[TARGET.valid].mean(dtype=np.float64), rtol=1e-6)
    assert np.isfinite(image).all()
    assert image.dtype == np.float32


def test_gray_world_scales_pixels_without_depth_by_the_same_gains() -> None:
    image = GrayWorld().restore(SCENE, TARGET).image
    ratio = image / TARGET.rgb
    np.testing.assert_allclose(ratio, np.broadcast_to(ratio[-1, -1], ratio.shape), rtol=1e-5)


@pytest.mark.parametrize("depth", [None, np.zeros((5, 7))])
def test_gray_world_uses_every_pixel_where_no_depth_is_known(depth: np.ndarray | None) -> None:
    rgb = np.random.default_rng(0).uniform(0.1, 0.5, (5, 7, 3)) * [0.2, 1, 0.8]
    view = photo(rgb, depth)
    mean = GrayWorld().restore(alone(view), view).image.mean(axis=(0, 1))
    np.testing.assert_allclose(mean, rgb.mean(), rtol=1e-5)


def test_gray_world_leaves_a_black_channel_black() -> None:
    view = photo(np.random.default_rng(0).uniform(0.1, 0.5, (5, 7, 3)) * [0, 1, 0.8])
    image = GrayWorld().restore(alone(view), view).image
    assert not image[..., 0].any()
    assert np.isfinite(image).all()
    assert image[..., 1].mean() == pytest.approx(image[..., 2].mean(), rel=1e-5)


def test_the_stretch_is_the_display_normalisation_of_the_papers_tables() -> None:
    view = photo(TARGET.rgb)
    np.testing.assert_allclose(
        HistogramStretch().restore(alone(view), view).image, display(view.rgb, "stretch-1-99"), atol=1e-6
    )


def test_the_stretch_takes_its_percentiles_over_valid_pixels() -> None:
    rgb = np.zeros((1, 103, 3))
    rgb[0, :101] = np.linspace(0.2, 0.7, 101)[:, None]
    rgb[0, 101], rgb[0, 102] = 0.1, 0.45  # neither has depth
    view = photo(rgb, np.array([[1.0] * 101 + [0.0] * 2]))
    image = HistogramStretch(low=10, high=90).restore(alone(view), view).image
    np.testing.assert_allclose(image[0, 10::10, 1], [0, *np.arange(1, 8) / 8, 1, 1], atol=1e-6)
    np.testing.assert_allclose(image[0, 101:, 1], [0, 0.5], atol=1e-6)


def test_the_stretch_leaves_a_constant_channel_alone() -> None:
    rgb = np.random.default_rng(0).uniform(0, 1, (5, 7, 3))
    rgb[..., 2] = 0.25
    view = photo(rgb)
    image = HistogramStretch().restore(alone(view), view).image
    assert (image[..., 2] == 0.25).all()
    assert np.isfinite(image).all()


@pytest.mark.parametrize(("low", "high"), [(-1, 99), (50, 50), (1, 101)])
def test_the_stretch_refuses_percentiles_that_are_none(low: float, high: float) -> None:
    with pytest.raises(InputError, match=r"^histogram_stretch: .*use 0 <= low < high <= 100"):
        HistogramStretch(low=low, high=high)


def test_stitching_takes_the_closest_observation() -> None:
    nearest = {p: (TARGET.distance.ravel()[p], TARGET.rgb.reshape(-1, 3)[p]) for p in np.flatnonzero(TARGET.depth)}
    for view in SCENE:
        if view is not TARGET:
            found = match(lift(TARGET), view)
            for pixel, other, z in zip(found.pixels, found.others, found.distance, strict=True):
                if z < nearest[pixel][0]:
                    nearest[pixel] = (z, view.rgb.reshape(-1, 3)[other])
    image = Stitching().restore(SCENE, TARGET).image
    for pixel, (_, colour) in nearest.items():
        np.testing.assert_allclose(image.reshape(-1, 3)[pixel], colour, atol=1e-6)
    assert (image != TARGET.rgb)[TARGET.valid].any(axis=-1).mean() > 0.3  # a nearer view did help


def test_stitching_a_view_without_any_depth_is_an_error_that_says_so() -> None:
    blind = View("blind.png", Arrays(TARGET.rgb, np.zeros(TARGET.depth.shape)), TARGET.camera, TARGET.cam_from_world)
    with pytest.raises(SolveError, match=r"^blind\.png: .*depth;"):
        Stitching().restore(SCENE, blind)
