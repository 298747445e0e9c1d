"""Degraded views: what their random numbers belong to, their order, what is decoded, and which are chosen."""

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from support.made_scene import NINE, many, of, photo

from sucre_bench import Camera, Scene, View
from sucre_bench.arrays import Array
from sucre_bench.degrade import degraded
from sucre_bench.scene import Plane

RANDOM = {"noise": 0.1, "depth_noise": 0.1, "depth_holes": 0.2, "pose_noise_m": 0.1, "pose_noise_deg": 1.0}


def planes(view: View) -> list[Array]:
    assert view.cam_from_world is not None
    return [view.rgb, view.depth, view.cam_from_world]


def test_random_numbers_are_a_views_own_whatever_else_there_is():
    scene = many()
    part = replace(scene, views=[scene.views[5], scene.views[2]])
    for options in (RANDOM, {"noise": 0.1}):
        whole, fewer = degraded(scene, **options), degraded(part, **options)
        for one, other in zip(planes(whole["v2.png"]), planes(fewer["v2.png"]), strict=True):
            assert np.array_equal(one, other)
    whole, again, reseeded = (degraded(scene, seed=seed, **RANDOM) for seed in (0, 0, 1))
    for one, same, other, neighbour in zip(
        *(planes(v) for v in (whole["v2.png"], again["v2.png"], reseeded["v2.png"], whole["v3.png"])), strict=True
    ):
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)
        assert not np.array_equal(one, neighbour)
    alone = degraded(scene, noise=0.1)["v2.png"]  # one kind of noise does not shift another's numbers
    assert np.array_equal(alone.rgb, whole["v2.png"].rgb)


def test_all_at_once_is_one_after_the_other_in_the_order_of_light():
    scene = of(photo(), np.full((60, 80), 2.0), camera=Camera(np.diag([50.0, 50, 1]), 80, 60))
    at_once = degraded(scene, jpeg_quality=40, bits=5, noise=0.05, scale=0.5, blur_px=1.5, add_water=NINE)["a.png"]
    for step in (
        {"add_water": NINE}, {"blur_px": 1.5}, {"scale": 0.5}, {"noise": 0.05}, {"bits": 5}, {"jpeg_quality": 40},
    ):  # fmt: skip
        scene = degraded(scene, **step)
    assert np.array_equal(at_once.rgb, scene["a.png"].rgb)
    depths = [{"scale": 0.5}, {"depth_noise": 0.1}, {"depth_holes": 0.2}]
    scene = start = of(photo(), np.full((60, 80), 2.0))
    for step in depths:
        scene = degraded(scene, **step)
    both = degraded(start, depth_holes=0.2, depth_noise=0.1, scale=0.5)
    assert np.array_equal(both["a.png"].depth, scene["a.png"].depth)


@dataclass(frozen=True, eq=False)
class Counting:
    """Pixels that record which planes were asked for."""

    asked: list[Plane]

    def load(self, plane: Plane) -> Array | None:
        self.asked.append(plane)
        return None if plane == "reference" else photo()[..., 0] if plane == "depth" else photo()


def test_nothing_is_decoded_before_it_is_asked_for_and_planes_are_locked():
    asked: list[Plane] = []
    scene = Scene("lazy", [View("a.png", Counting(asked))], frozenset({"depth"}), data_id="lazy")
    made = degraded(scene, noise=0.1, scale=0.5, depth_noise=0.1, add_water=NINE)
    assert asked == []
    assert made["a.png"].depth.shape == (30, 40)
    assert asked == ["depth"]
    with pytest.raises(ValueError, match="read-only"):
        made["a.png"].rgb[:] = 0


def test_within_and_keep_choose_views_in_capture_order():
    scene = many()

    def names(**options: int) -> list[str]:
        return [view.name for view in degraded(scene, target="v4.png", **options)]

    assert names(within=2) == ["v2.png", "v3.png", "v4.png", "v5.png", "v6.png"]
    assert names(within=0) == names(keep=1) == ["v4.png"]
    assert [v.name for v in degraded(scene, target="v1.png", within=2)] == ["v0.png", "v1.png", "v2.png", "v3.png"]
    drawn = [names(keep=count) for count in range(1, 10)]
    for count, chosen in enumerate(drawn, start=1):
        assert len(chosen) == count
        assert chosen == sorted(chosen)
        assert "v4.png" in chosen
    assert all(set(few) < set(more) for few, more in itertools.pairwise(drawn))
    assert len({tuple(names(keep=3, seed=seed)) for seed in range(20)}) > 5
    both = names(within=2, keep=3)
    assert len(both) == 3
    assert set(both) <= set(names(within=2))
    assert degraded(scene, target="v4.png", within=2)["v3.png"] is scene["v3.png"]
