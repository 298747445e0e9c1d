"""Matched footprints, against pictures whose means are known and against ground of white noise."""

from dataclasses import replace

import numpy as np
from support.made_ground import make_ground, water
from support.made_scene import BOX, make_scene

from sucre_bench import Arrays, InputError, Scene, View
from sucre_bench.multiview.footprints import matched_footprints
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe

NO_WATER = water((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.1, 0.1, 0.1))


def spread(observations: Observations) -> float:
    """The standard deviation of colours about the mean of their pixel, root mean square."""
    place = np.concatenate([np.arange(n) for n, _ in observations.slots()])
    I = observations.intensity(slice(None)).astype(np.float64)  # noqa: E741
    n = len(observations.pixels)
    means = np.stack([np.bincount(place, i, n) / np.bincount(place, minlength=n) for i in I])
    return float(np.sqrt(((I - means[:, place]) ** 2).mean()))


def with_pictures(scene: Scene, change: dict[str, np.ndarray]) -> list[View]:
    views = scene.views
    return [replace(v, pixels=Arrays(change[v.name], v.depth)) if v.name in change else v for v in views]


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
    points = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.K).T * view.depth[..., None]
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


def test_the_rule_of_pairing_decides_who_sees_a_point() -> None:
    scene = make_ground(NO_WATER)
    pixels = np.arange(0, 90 * 120, 7)
    mutual, depth = (matched_footprints(scene["1.png"], scene.views, pixels, rule=r) for r in ("mutual", "depth"))
    assert len(depth) > len(mutual) > 1000
