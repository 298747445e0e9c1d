"""Depth maps: from points, of the fused surface, their files, and the neighbours they are swept with."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import CAMERA, POSES, make_shots, true_depth

from sucre_bench.camera import depth_at, moved, pixel_rays
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.programs.prepare.depth_maps import of_surface, relief, write_depth
from sucre_bench.programs.prepare.plane_sweep import agreeing, neighbours
from sucre_bench.programs.prepare.surface import fused


def test_the_relief_of_points_on_a_plane_is_that_plane():
    shots = make_shots(np.array([[0.3, -0.2, 0.1]]))
    rays = pixel_rays(CAMERA)
    truth = (2 + 0.03 - 0.1) / (1 - rays[..., 0] / 10)  # z = 2 + x / 10, from the camera's place
    depth = of_surface(relief(shots), 1)(shots[0]).depth
    assert (depth > 0).mean() > 0.95
    assert depth[depth > 0] == pytest.approx(truth[depth > 0], rel=1e-5)
    odd = shots[0].points.copy()
    odd[7, 2] -= 1  # one wrong point makes no spike
    spiked = of_surface(relief([replace(shots[0], points=odd)]), 1)(shots[0]).depth
    assert spiked[spiked > 0] == pytest.approx(truth[spiked > 0], rel=1e-5)


def test_the_fused_surface_closes_small_holes_shows_what_other_photos_measured_and_leaves_open_water_open():
    shots, truth, measured = [], [], []
    for i, pose in enumerate(POSES):
        shot = make_shots(np.zeros((1, 3)))[0]
        depth = true_depth(pose, pixel_rays(CAMERA))
        world = moved(pixel_rays(CAMERA) * depth[..., None], np.linalg.inv(pose))
        kept = np.hypot(world[..., 0] - 0.6, world[..., 1]) > 0.08  # a hole in all photos
        kept &= world[..., 0] < 1  # no photo sees anything beyond
        if i == 0:
            kept[80:160, 120:200] = False  # measured in other photos alone
        shots.append(replace(shot, name=f"{i}.png", cam_from_world=pose))
        truth.append((depth, world[..., 0]))
        measured.append(np.where(kept, depth, 0).astype(np.float32))
    surface = fused(shots, lambda i: measured[i], widest=0.1)
    for shot, (depth, x) in zip(shots, truth, strict=True):
        seen, _ = surface.caster()(shot)
        assert (seen[x < 0.95] > 0).mean() > 0.97
        assert np.quantile(np.abs(seen / depth - 1)[(x < 0.95) & (seen > 0)], 0.99) < 0.01
        assert not (seen[x > 1.35] > 0).any()


def test_specks_that_match_by_chance_are_no_depth_and_thin_things_are():
    shot, swept = make_shots(np.zeros((1, 3)))[0], np.zeros((CAMERA.height, CAMERA.width), np.float32)
    swept[20:60, 20:60], swept[30, 30], swept[80, 20:40] = 2, 5, 3  # ground with a false pixel, and a rope
    swept[100:103, 100:103] = 4  # open water that looks alike
    wanted = np.where(swept <= 3, swept, 0)
    assert agreeing(shot, swept, [shot, shot], lambda _: swept) == pytest.approx(wanted, rel=1e-6)


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
    for i, near in enumerate(neighbours(shots, 1)):
        scores = {}
        for j, other in enumerate(shots):
            own = [k for k, number in enumerate(shots[i].point_ids) if number in set(other.point_ids)]
            to_one, to_other = shots[i].centre - shots[i].points[own], other.centre - shots[i].points[own]
            one, two = np.linalg.norm(to_one, axis=1), np.linalg.norm(to_other, axis=1)
            angle = np.degrees(np.arccos(np.clip((to_one * to_other).sum(axis=1) / one / two, -1, 1)))
            weight = np.where(angle < 45, np.minimum(angle / 5, 1), 0) * np.exp(-0.5 * np.log2(one / two) ** 2)
            if j != i:
                scores[j] = weight.sum()
        assert near == [max(scores, key=lambda j: scores[j])]
    apart = replace(shots[0], point_ids=shots[0].point_ids + 5000)
    assert neighbours([apart, shots[1]], 3) == [[], []]


def test_neighbours_together_see_all_parts_of_a_photo():
    whole = make_shots(np.array([[0.0, 0, 0], [0.4, 0, 0], [0.5, 0, 0], [0.6, 0, 0], [0.1, 0, 0]]))
    left = [replace(s, point_ids=s.point_ids[:300], points=s.points[:300]) for s in whole[1:4]]
    rest = replace(whole[4], point_ids=whole[4].point_ids[300:], points=whole[4].points[300:])
    assert 4 in neighbours([whole[0], *left, rest], 3)[0]
