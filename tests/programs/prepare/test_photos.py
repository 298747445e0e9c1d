"""Photos and masks to prepare: too few, damaged, sharing nothing, or in the way of the result."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.photographed_valley import (
    CAMERA,
    HEIGHT,
    POSES,
    make_shots,
    photograph,
    true_depth,
    write,
)

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at, moved, pixel_rays
from sucre_bench.errors import InputError
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.depth_maps import of_surface, relief, write_depth
from sucre_bench.programs.prepare.photos import find_photos
from sucre_bench.programs.prepare.pipeline import prepare
from sucre_bench.programs.prepare.plane_sweep import agreeing, neighbours
from sucre_bench.programs.prepare.scale import Scale, find_scale, known_scale
from sucre_bench.programs.prepare.shots import Shot
from sucre_bench.programs.prepare.surface import fused


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ((), r"no photos; .*two"),
        (("a.png",), r"one photo; .*two"),
        (("a.png", "cut.png"), r"one photo .*\(cut\.png .*cut.*\); .*two"),
        (
            ("cut.jpg", "text.jpg", "text.png"),
            r"no photos .*\(cut\.jpg .*truncated.*; text\.jpg .*image.*; text\.png .*\); .*two",
        ),
    ],
)
def test_too_few_photos_are_an_error_that_names_the_damaged(
    tmp_path: Path, names: tuple[str, ...], message: str
):
    (tmp_path / "photos").mkdir()
    for name in names:
        file = tmp_path / "photos" / name
        write(file, photograph(POSES[0]))
        if not name.startswith("a"):
            file.write_bytes(
                b"no image" if name.startswith("text") else file.read_bytes()[:1000]
            )
    with pytest.raises(InputError, match=message):
        prepare(tmp_path / "photos", tmp_path / "out")
    assert not (tmp_path / "out" / "images").exists()


def test_photos_that_share_nothing_are_named_with_what_they_share(tmp_path: Path):
    for seed in range(2):
        noise = np.random.default_rng(seed).integers(0, 255, (120, 160, 3), dtype=np.uint8)
        write(tmp_path / "photos" / f"{seed}.png", noise)
    with pytest.raises(InputError, match=r"/photos: .*\b30\b"):
        prepare(tmp_path / "photos", tmp_path / "out")


@pytest.mark.parametrize("out", [".", "images"])
def test_photos_in_the_way_of_the_result_are_left_alone(tmp_path: Path, out: str):
    (tmp_path / out / ".prepare").mkdir(parents=True)  # as of an earlier command
    for name in ("a.png", "b.png"):
        write(tmp_path / "images" / name, photograph(POSES[0]))
    with pytest.raises(InputError, match=f"^{re.escape(str(tmp_path / out))}: "):
        prepare(tmp_path / "images", tmp_path / out)
    assert len(list((tmp_path / "images").glob("*.png"))) == 2


def test_a_mask_that_is_missing_or_of_another_shape_is_named(photos: Path, tmp_path: Path):
    (tmp_path / "masks").mkdir()
    with pytest.raises(InputError, match=r"cut\.png\.png: "):
        prepare(photos / "photos", tmp_path / "out", Options(masks=tmp_path / "masks"))
    write(tmp_path / "masks" / "cut.png", np.zeros((HEIGHT, HEIGHT), np.uint8))
    with pytest.raises(InputError, match=r"cut\.png: .*180x180, .*240x180; "):
        prepare(photos / "photos", tmp_path / "out", Options(masks=tmp_path / "masks"))


def test_masks_among_the_photos_are_no_photos_and_bitmaps_are(tmp_path: Path):
    for name in ("a.png", "b.bmp", "c.webp"):
        write(tmp_path / name, np.zeros((24, 32, 3), np.uint8))
        write(tmp_path / "masks" / f"{name}.png", np.full((24, 32), 255, np.uint8))
    found, damaged = find_photos(tmp_path, tmp_path / "masks", 0, tmp_path / "out")
    assert [photo.name for photo in found] == ["a.png", "b.bmp", "c.webp"]
    assert not damaged


def test_a_depth_track_gives_the_scale_where_cameras_leave_every_plane(tmp_path: Path):
    random = np.random.default_rng(0)
    places = random.uniform(-1, 1, (12, 3))
    assert scale_of(places, tmp_path / "track.csv").metres_per_unit == pytest.approx(
        1.7, rel=1e-6
    )
    # what the depths tell of the direction they do not leave in is noise
    with pytest.raises(InputError, match=r"flat\.csv: .*cameras .*\d %"):
        scale_of(places * [1, 1, 0.001], tmp_path / "flat.csv")


def scale_of(places: Array, track: Path) -> Scale:
    """The scale that a depth track gives cameras at these places, where a unit is 1.7 m."""
    depths = 7 + 1.7 * places @ [0.6, 0.0, 0.8]
    rows = [f"{i}.png,{depth:.6f}" for i, depth in enumerate(depths)]
    track.write_text("\n".join(["image,depth", *rows]))
    known = known_scale(depth_track=track)
    return find_scale(known, make_shots(places), same_names(len(places)), no_depth)


def same_names(count: int) -> dict[str, str]:
    return {f"{i}.png": f"{i}.png" for i in range(count)}


def no_depth(shot: Shot) -> Array:
    raise AssertionError(shot.name)


def test_without_a_known_length_the_scale_is_called_arbitrary_and_two_are_refused():
    shots = make_shots(np.array([[0.0, 0, 0], [1, 0, 0]]))
    found = find_scale({}, shots, same_names(2), no_depth)
    assert isinstance(found, Scale)
    assert not found.is_metric
    with pytest.raises(
        InputError, match=r"^scale: .*--scale, --distance, --length, --depth-track"
    ):
        known_scale(factor=1, distances=[("0.png", "1.png", 1.0)])
    with pytest.raises(InputError, match=r"^--distance: 9\.png "):
        find_scale(
            known_scale(distances=[("0.png", "9.png", 1.0)]), shots, same_names(2), no_depth
        )


def test_the_relief_of_points_on_a_plane_is_that_plane():
    shots = make_shots(np.array([[0.3, -0.2, 0.1]]))
    rays = pixel_rays(CAMERA)
    # z = 2 + x / 10, from the camera's place
    truth = (2 + 0.03 - 0.1) / (1 - rays[..., 0] / 10)
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
    (shot,) = make_shots(np.zeros((1, 3)))
    swept = np.zeros((CAMERA.height, CAMERA.width), np.float32)
    swept[20:60, 20:60] = 2  # ground
    swept[30, 30] = 5  # a false pixel
    swept[80, 20:40] = 3  # a rope
    swept[100:103, 100:103] = 4  # open water that looks alike
    wanted = np.where(swept <= 3, swept, 0)
    assert agreeing(shot, swept, [shot, shot], lambda _: swept) == pytest.approx(
        wanted, rel=1e-6
    )


@pytest.mark.parametrize(
    ("metres", "suffix"), [(2.5, ".png"), (90.0, ".tif"), (0.123456, ".tif")]
)
def test_depth_maps_keep_depths_that_millimetres_cannot(
    tmp_path: Path, metres: float, suffix: str
):
    assert write_depth(tmp_path, "sub/a.png", np.full((4, 6), metres, np.float32))
    assert read_depth(tmp_path / "sub" / f"depth_a{suffix}") == pytest.approx(metres, rel=1e-6)
    assert not write_depth(tmp_path, "sub/b.png", np.zeros((4, 6), np.float32))
    assert len(list((tmp_path / "sub").iterdir())) == 1


def test_depth_is_looked_up_in_the_pixel_that_holds_a_place_and_nowhere_else():
    depth = np.array([[1.0, 2], [3, 0]], np.float32)
    inside = [[0, 0], [1.99, 0.5], [0.5, 1], [1.5, 1.5]]
    outside = [[2, 0], [-0.01, 0], [0, 2], [np.nan, np.nan]]
    assert depth_at(depth, np.array(inside + outside)).tolist() == [1, 2, 3, 0, 0, 0, 0, 0]


def test_neighbours_together_see_all_parts_of_a_photo():
    whole = make_shots(
        np.array([[0.0, 0, 0], [0.4, 0, 0], [0.5, 0, 0], [0.6, 0, 0], [0.1, 0, 0]])
    )
    left = [replace(s, point_ids=s.point_ids[:300], points=s.points[:300]) for s in whole[1:4]]
    rest = replace(whole[4], point_ids=whole[4].point_ids[300:], points=whole[4].points[300:])
    assert 4 in neighbours([whole[0], *left, rest], 3)[0]


def test_neighbours_see_the_ground_from_other_places_but_not_under_wide_angles():
    shots = make_shots(np.array([[0.0, 0, 0], [0.4, 0, 0], [0.001, 0, 0], [0, 0, 60]]))
    assert neighbours(shots, 1)[0] == [1]
    assert neighbours(shots, 3)[0] == [1, 2]
    apart = replace(shots[0], point_ids=shots[0].point_ids + 5000)
    assert neighbours([apart, shots[1]], 3) == [[], []]
