"""The observation store: its order, its types, and parts of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.made_ground import make_ground, water
from support.made_scene import BOX, make_scene

from sucre_bench import Arrays, InputError, Scene, View
from sucre_bench.multiview.footprints import matched_footprints
from sucre_bench.multiview.observations import Observations, Seen, arrange, compact
from sucre_bench.multiview.observe import observe

FINE = np.float32([[0.1234567, 0.5, 0.7654321]])
SIXTEEN = np.uint16([[1, 2, 65535]])


def two_views(fine: np.ndarray = FINE) -> list[Seen]:
    """Pixel 1 of two, seen finely by "b"; both, seen in 8 bits by "a"."""
    coarse = np.uint8([[51, 102, 255], [0, 1, 2]])
    return [
        Seen("b", np.array([1]), np.float32([2]), fine),
        Seen("a", np.array([0, 1]), np.float32([1, 3]), coarse),
    ]


@pytest.mark.parametrize(("fine", "white"), [(FINE, 1), (SIXTEEN, 65535)])
def test_finer_colours_are_kept_as_they_are_beside_eight_bit_ones(
    fine: np.ndarray, white: int
) -> None:
    observations = arrange((1, 2), two_views(fine), with_view=True)
    assert observations.views == ("b", "a")
    assert observations.pixels.tolist() == [1, 0]
    assert observations.starts.tolist() == [0, 2, 3]  # pixel 1 by "b", 0 by "a"; 1 by "a"
    assert observations.view.tolist() == [0, 1, 1]
    assert observations.distance.tolist() == [2, 1, 3]
    assert observations.colour.dtype == fine.dtype
    coarse = np.array([[51, 102, 255], [0, 1, 2]]) / 255 * white
    np.testing.assert_allclose(observations.colour.T, [*fine, *coarse], rtol=1e-7)


def test_parts_go_as_the_store_comes_if_they_may() -> None:
    kept, given = two_views(), two_views()
    whole, freed = arrange((1, 2), kept), arrange((1, 2), given, free=True)
    assert (len(kept), len(given)) == (2, 0)
    assert freed.views == whole.views
    assert np.array_equal(freed.colour, whole.colour)


def test_colours_are_compacted_only_where_that_loses_nothing() -> None:
    levels = np.arange(256, dtype=np.float32)
    assert compact(levels / np.float32(255)).tolist() == levels.tolist()
    assert compact(np.float32([0, 1, 65535]) / np.float32(65535)).tolist() == [0, 1, 65535]
    for odd in ([0.1234567], [256 / 255], [-1 / 255], [np.nan, 0], [np.inf]):
        kept = compact(np.float32(odd))
        assert kept.dtype != np.uint8
        np.testing.assert_allclose(
            kept / (65535 if kept.dtype == np.uint16 else 1), odd, atol=1e-6
        )


def test_many_observations_lie_where_a_plain_sort_puts_them() -> None:
    """Against a stable sort by pixel and view; large enough that threads share the work."""
    rng = np.random.default_rng(0)
    shape, seen = (700, 900), []
    for k in range(3):
        pixels = rng.permutation(700 * 900)[: 500_000 - 150_000 * k].astype(np.int32)
        colour = rng.integers(0, 256, (len(pixels), 3), dtype=np.uint8)
        seen.append(Seen(str(k), pixels, rng.random(len(pixels), dtype=np.float32), colour))
    found = arrange(shape, seen, with_view=True)
    pixels, distance, colour = (
        np.concatenate([getattr(one, name) for one in seen])
        for name in ("pixels", "distance", "colour")
    )
    view = np.repeat(np.arange(3), [len(one.pixels) for one in seen])
    counts = np.bincount(pixels, minlength=700 * 900)
    slot = np.zeros(len(pixels), int)
    by_pixel = np.lexsort((view, pixels))
    starts = np.append(0, np.cumsum(counts))[:-1]
    slot[by_pixel] = np.arange(len(pixels)) - np.repeat(starts, counts)
    order = np.lexsort((pixels, -counts[pixels], slot))
    assert np.array_equal(
        found.pixels, np.lexsort((np.arange(len(counts)), -counts))[: (counts > 0).sum()]
    )
    assert np.array_equal(found.distance, distance[order])
    assert np.array_equal(found.colour.T, colour[order])
    assert np.array_equal(found.view, view[order])


NO_WATER = water((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1, 0.1))


def spread(observations: Observations) -> float:
    """The standard deviation of colours about the mean of their pixel, root mean square."""
    place = np.concatenate([np.arange(n) for n, _ in observations.slots()])
    I = observations.intensity(slice(None)).astype(np.float64)
    n = len(observations.pixels)
    means = np.stack([np.bincount(place, i, n) / np.bincount(place, minlength=n) for i in I])
    return float(np.sqrt(((I - means[:, place]) ** 2).mean()))


def with_pictures(scene: Scene, change: dict[str, np.ndarray]) -> list[View]:
    views = scene.views
    return [
        replace(v, pixels=Arrays(change[v.name], v.depth)) if v.name in change else v
        for v in views
    ]


def test_all_observations_of_a_point_average_the_same_ground() -> None:
    scene = make_ground(NO_WATER, noise=0.0)
    target = scene["3.png"]
    sharp = observe(target, scene.views)
    matched = matched_footprints(target, scene.views, sharp.pixels)
    assert matched.n_repeated == len(matched.pixels) > 0.5 * sharp.n_repeated
    assert set(matched.views) == set(sharp.views)
    assert spread(matched) < 0.1 * spread(sharp)


def test_a_ramp_has_the_value_of_the_place_where_the_point_lies() -> None:
    """The mean of a linear picture under any symmetric weight is its value in the middle."""
    scene = make_ground(NO_WATER)
    target = scene["5.png"]
    ramps = {}
    for view in scene.views:
        v, u = np.mgrid[0.5 : view.depth.shape[0], 0.5 : view.depth.shape[1]]
        ramps[view.name] = np.stack([u, v, u + v], axis=-1) / 500
    views = with_pictures(scene, ramps)
    rays = matched_footprints(views[5], views, np.arange(target.depth.size), with_ray=True)
    K = target.camera.K
    x, y = K[:2, :2] @ rays.ray + K[:2, 2:]
    np.testing.assert_allclose(rays.colour, np.stack([x, y, x + y]) / 500, atol=5e-4)


def test_no_colour_mixes_two_surfaces() -> None:
    """A bright box before a dark plane: at its outline windows hold both, and such observations are left out."""
    scene = make_scene()
    views = with_pictures(scene, {view.name: painted(view) for view in scene.views})
    target = views[1]
    matched = matched_footprints(target, views, np.flatnonzero(target.depth > 0))
    assert len(matched.pixels) > 100
    assert np.minimum(matched.colour, 0.9 - matched.colour).max() < 0.02
    assert 0.05 < (matched.colour[0] > 0.5).mean() < 0.95


def painted(view: View) -> np.ndarray:
    """0.9 where the box of the made scene is seen, black elsewhere."""
    camera, pose = view.camera, view.cam_from_world
    v, u = np.mgrid[0.5 : camera.height, 0.5 : camera.width]
    points = (
        np.stack([u, v, np.ones_like(u)], axis=-1)
        @ np.linalg.inv(camera.K).T
        * view.depth[..., None]
    )
    world = (points - pose[:3, 3]) @ pose[:3, :3]
    on_box = ((world > BOX[0] - 1e-3) & (world < BOX[1] + 1e-3)).all(axis=-1) & (view.depth > 0)
    return 0.9 * np.repeat(on_box[..., None], 3, axis=2)


def test_colours_that_are_not_finite_and_views_that_cannot_be_read_are_left_out() -> None:
    class Broken:
        def load(self, plane: str) -> np.ndarray:
            raise InputError("damaged")

    scene = make_ground(NO_WATER)
    rgb = scene["2.png"].rgb.copy()
    rgb[30:60] = np.nan
    views = with_pictures(scene, {"2.png": rgb})
    views[4] = replace(views[4], pixels=Broken())
    matched = matched_footprints(views[2], views, np.arange(rgb[..., 0].size))
    assert np.isfinite(matched.colour).all()
    assert "4.png" not in matched.views
