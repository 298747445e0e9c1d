"""Gray world by range, against brute force over all pixels and against scenes whose colours are known."""

from dataclasses import replace

import numpy as np
import pytest
from support.forward_model import in_water
from support.made_scene import WATER, Watched

from sucre_bench import Arrays, NotApplicableError, Scene, SolveError, View
from sucre_bench.methods.dive_gray_world import DiveGrayWorld, pooled

HEIGHT = 90
WIDTH = 120


def drawn_view(seed: int, nearest: float, farthest: float) -> tuple[View, np.ndarray]:
    """A view of colours that do not depend on distance, and those colours (H, W, 3)."""
    rng = np.random.default_rng(seed)
    z = rng.uniform(nearest, farthest, (HEIGHT, WIDTH)).astype(np.float32)
    J = rng.normal([0.5, 0.4, 0.6], [0.1, 0.15, 0.05], (HEIGHT, WIDTH, 3))
    return View(f"{seed}.png", Arrays(in_water(J, z, WATER), z)), J


def dive(*views: View) -> Scene:
    return Scene("dive", views, frozenset({"depth"}))


def test_at_every_distance_what_is_left_is_the_scenes_own_variation():
    """J exp(-beta z) + veil is affine in J at each z, so that (J - mean) / deviation comes back without the water."""
    views, truths = zip(
        *(drawn_view(seed, 1 + seed / 4, 4 + seed) for seed in range(6)), strict=True
    )
    scene = dive(*views)
    for view, J in zip(views, truths, strict=True):
        expected = 0.5 + 0.15 * (J - [0.5, 0.4, 0.6]) / [0.1, 0.15, 0.05]
        image = DiveGrayWorld(fewest=100).restore(scene, view).image
        assert np.abs(image - expected).mean() < 0.02


def test_an_image_of_one_distance_is_corrected_by_what_others_saw_there():
    """A view of red things only stays redder than the dive: its own mean is not its gray."""
    views = [drawn_view(seed, 1, 6)[0] for seed in range(4)]
    z = np.zeros((HEIGHT, WIDTH), np.float32)
    z[:4, :25] = 2.0
    mean = pooled(dive(*views), DiveGrayWorld(), "gamma", "depth").at(np.array(2.0), 0)[0]
    colour = np.broadcast_to([mean + 0.1, mean, mean], (HEIGHT, WIDTH, 3))
    red = View("red.png", Arrays(colour, z))
    alone = DiveGrayWorld().restore(dive(red), red).image[0, 0, 0]
    among = DiveGrayWorld().restore(dive(red, *views), red).image[0, 0, 0]
    assert alone == pytest.approx(0.5, abs=0.01)
    assert among > 0.6


def test_bins_with_few_pixels_take_their_neighbours_values():
    view, _ = drawn_view(0, 1, 3)
    lone = view.depth.copy()
    lone[0, 0] = 40
    strange = View("strange.png", Arrays(np.where((lone == 40)[..., None], 1, view.rgb), lone))
    image = DiveGrayWorld(bin_m=0.5, fewest=200).restore(dive(strange), strange).image
    plain = pooled(dive(view), DiveGrayWorld(bin_m=0.5, fewest=200), "gamma", "depth")
    mean, deviation = plain.at(np.array(3.0), 2)
    assert image[0, 0, 2] == pytest.approx(float((1 - mean) / deviation * 0.15 + 0.5), rel=0.02)


def test_pixels_without_depth_have_no_colour_and_do_not_count():
    view, _ = drawn_view(0, 0.1, 0.9)
    depth, rgb = view.depth.copy(), view.rgb.copy()
    depth[:30], rgb[:30] = 0, 1
    blind = View("a.png", Arrays(rgb, depth))
    image = DiveGrayWorld(bin_m=1, fewest=50).restore(dive(blind), blind).image
    assert np.isnan(image[:30]).all()
    np.testing.assert_allclose(np.nanmean(image, axis=(0, 1)), 0.5, atol=0.01)


def test_the_dive_is_read_once_for_all_its_views():
    drawn = [drawn_view(seed, 1, 4)[0] for seed in range(5)]
    views = [
        replace(view, name=f"{k}.png", pixels=Watched(view.pixels))
        for k, view in enumerate(drawn)
    ]
    scene = dive(*views)
    method = DiveGrayWorld()
    method.restore(scene, views[0])
    assert all("rgb" in view.pixels.loaded for view in views)  # all of them count
    others = [len(view.pixels.loaded) for view in views[2:]]
    method.restore(scene, views[1])
    assert [len(view.pixels.loaded) for view in views[2:]] == others


def test_views_without_depth_are_left_out_and_refused():
    view, _ = drawn_view(0, 1, 4)
    flat = View("flat.png", Arrays(view.rgb))
    assert DiveGrayWorld().restore(dive(flat, view), view).info["n_views"] == 1
    blind = View("blind.png", Arrays(view.rgb, np.zeros((HEIGHT, WIDTH))))
    with pytest.raises(NotApplicableError):
        DiveGrayWorld().restore(dive(blind), blind)
    with pytest.raises(SolveError):
        pooled(dive(flat), DiveGrayWorld(), "gamma", "depth")


def test_by_place_evens_the_light_of_a_lamp_over_the_dive():
    """The lamp lights the middle; the mean of all restored views is even, but for the corners."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    light = np.exp(-((x / WIDTH - 0.5) ** 2 + (y / HEIGHT - 0.5) ** 2) / 0.3)[..., None]
    views = []
    for seed in range(24):
        view, _ = drawn_view(seed, 1, 4)
        views.append(
            replace(view, pixels=Arrays((view.rgb * light).astype(np.float32), view.depth))
        )
    scene = dive(*views)
    unevenness = {}
    for by_place in (False, True):
        method = DiveGrayWorld(fewest=100, by_place=by_place)
        mean = np.mean([method.restore(scene, view).image for view in views], axis=0)
        cells = mean.reshape(9, HEIGHT // 9, 12, WIDTH // 12, 3).mean(axis=(1, 3))
        unevenness[by_place] = float(cells.std(axis=(0, 1)).max())
    assert unevenness[False] > 0.05
    assert unevenness[True] < unevenness[False] / 4
