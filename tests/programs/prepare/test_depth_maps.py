"""Depth maps: from points, their holes, their files, and the neighbours they are swept with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import CAMERA, WIDTH, make_shots

from sucre_bench.camera import depth_at, pixel_rays
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.programs.prepare.depth_maps import relief, without_small_holes, write_depth
from sucre_bench.programs.prepare.plane_sweep import neighbours


def test_the_relief_of_points_on_a_plane_is_that_plane():
    shots = make_shots(np.array([[0.3, -0.2, 0.1]]))
    rays = pixel_rays(CAMERA)
    truth = (2 + 0.03 - 0.1) / (1 - rays[..., 0] / 10)  # z = 2 + x / 10, from the camera's place
    depth = relief(shots)(shots[0])
    assert (depth > 0).mean() > 0.95
    assert depth[depth > 0] == pytest.approx(truth[depth > 0], rel=1e-5)
    odd = shots[0].points.copy()
    odd[7, 2] -= 1  # one wrong point makes no spike
    spiked = relief([replace(shots[0], points=odd)])(shots[0])
    assert spiked[spiked > 0] == pytest.approx(truth[spiked > 0], rel=1e-5)


def test_holes_are_filled_where_their_rim_is_one_plane_only():
    rays = pixel_rays(CAMERA)
    plane = (1 / (rays @ np.array([0.1, 0.2, 0.4]))).astype(np.float32)
    holed = plane.copy()
    holed[100:120, 100:120] = 0
    holed[:10, 50:60] = 0  # at the border nobody knows what goes on
    step = np.where(np.arange(WIDTH) < 205, 1, np.float32(1.5))
    holed[100:120, 200:210] = 0
    filled = without_small_holes((holed * step).astype(np.float32))
    assert filled[100:120, 100:120] == pytest.approx(plane[100:120, 100:120], rel=1e-5)
    assert (filled[:10, 50:60] == 0).all()
    assert (filled[100:120, 200:210] == 0).all()


@pytest.mark.parametrize(("metres", "suffix"), [(2.5, ".png"), (90.0, ".tif"), (0.123456, ".tif")])
def test_depth_maps_keep_depths_that_millimetres_cannot(tmp_path: Path, metres: float, suffix: str):
    assert write_depth(tmp_path, "sub/a.png", np.full((4, 6), metres, np.float32))
    assert read_depth(tmp_path / "sub" / f"depth_a{suffix}") == pytest.approx(metres, rel=1e-6)
    assert not write_depth(tmp_path, "sub/b.png", np.zeros((4, 6), np.float32))
    assert len(list((tmp_path / "sub").iterdir())) == 1


def test_depth_is_looked_up_in_the_pixel_that_holds_a_place_and_nowhere_else():
    depth = np.array([[1.0, 2], [3, 0]], np.float32)
    xy = np.array([[0, 0], [1.99, 0.5], [0.5, 1], [1.5, 1.5], [2, 0], [-0.01, 0], [0, 2], [np.nan, np.nan]])
    assert depth_at(depth, xy).tolist() == [1, 2, 3, 0, 0, 0, 0, 0]


def test_neighbours_are_those_under_the_telling_angles_by_every_pair():
    random = np.random.default_rng(4)
    shots = []
    for shot in make_shots(random.uniform(-2, 2, (9, 3)) * [1, 1, 0.3]):
        kept = np.sort(random.choice(400, 150, replace=False))
        shots.append(replace(shot, point_ids=3 * kept + 7, points=shot.points[kept]))
    for i, near in enumerate(neighbours(shots, 3)):
        scores = {}
        for j, other in enumerate(shots):
            own = [k for k, number in enumerate(shots[i].point_ids) if number in set(other.point_ids)]
            to_one, to_other = shots[i].centre - shots[i].points[own], other.centre - shots[i].points[own]
            one, two = np.linalg.norm(to_one, axis=1), np.linalg.norm(to_other, axis=1)
            angle = np.degrees(np.arccos(np.clip((to_one * to_other).sum(axis=1) / one / two, -1, 1)))
            weight = np.where(angle < 45, np.minimum(angle / 5, 1), 0) * np.exp(-0.5 * np.log2(one / two) ** 2)
            if j != i:
                scores[j] = weight.sum()
        assert near == sorted(scores, key=lambda j: -scores[j])[:3]
    apart = replace(shots[0], point_ids=shots[0].point_ids + 5000)
    assert neighbours([apart, shots[1]], 3) == [[], []]
