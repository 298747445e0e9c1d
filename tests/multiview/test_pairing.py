"""Pairing, against a literal float64 reading of the paper's rule, and against the scene itself."""

import itertools
from dataclasses import replace
from math import floor

import numpy as np
import pytest
from support.made_scene import make_camera, make_pose, make_scene, make_view

from sucre_bench import Arrays, Camera, InputError, View
from sucre_bench.multiview.pairing import Surface, lift, match, visible_pixels

SCENE = make_scene()
TARGET = SCENE["a.png"]
OTHERS = ["near.png", "side.png", "far.png"]

# Twice over, a scattered point within this of a pixel's border may be rounded to either side in float32.
BORDER_PX = 1e-3


def literal_pairs(target: View, other: View) -> tuple[dict[int, tuple[int, float]], set[int]]:
    """Eq. 4 and 5, a pixel at a time in float64: flat pixel -> (flat other pixel, distance), and the doubtful ones."""
    pairs, doubtful = {}, set()
    there = other.cam_from_world @ np.linalg.inv(target.cam_from_world)
    back = target.cam_from_world @ np.linalg.inv(other.cam_from_world)
    depths = target.depth.astype(np.float64), other.depth.astype(np.float64)
    for v1, u1 in np.argwhere(depths[0] > 0):
        pixel = int(v1 * target.camera.width + u1)
        landed = _carry(target.camera, other.camera, there, u1, v1, depths[0][v1, u1])
        if landed is None:
            continue
        u2, v2 = floor(landed[0]), floor(landed[1])
        if (
            not (0 <= u2 < other.camera.width and 0 <= v2 < other.camera.height)
            or depths[1][v2, u2] == 0
        ):
            continue
        returned = _carry(other.camera, target.camera, back, u2, v2, depths[1][v2, u2])
        if any(abs(x - round(x)) < BORDER_PX for x in (*landed, *(returned or ()))):
            doubtful.add(pixel)
        elif returned is not None and (floor(returned[0]), floor(returned[1])) == (u1, v1):
            ray = np.linalg.inv(other.camera.K) @ [u2 + 0.5, v2 + 0.5, 1]
            pairs[pixel] = (
                v2 * other.camera.width + u2,
                float(np.linalg.norm(ray * depths[1][v2, u2])),
            )
    return pairs, doubtful


def _carry(
    one: Camera, two: Camera, pose: np.ndarray, u: int, v: int, depth: float
) -> tuple[float, float] | None:
    point = pose @ np.append(np.linalg.inv(one.K) @ [u + 0.5, v + 0.5, 1] * depth, 1)
    if point[2] <= 0:
        return None
    x, y, w = two.K @ point[:3]
    return x / w, y / w


@pytest.mark.parametrize("name", OTHERS)
def test_pairs_are_those_of_a_literal_float64_reading(name: str) -> None:
    expected, doubtful = literal_pairs(TARGET, SCENE[name])
    found = match(lift(TARGET), SCENE[name])
    pairs = dict(
        zip(
            found.pixels.tolist(),
            zip(found.others.tolist(), found.distance.tolist(), strict=True),
            strict=True,
        )
    )
    assert len(expected) > 200
    assert len(doubtful) < 0.05 * len(expected)
    assert pairs.keys() - doubtful == expected.keys()
    for pixel, (other, distance) in expected.items():
        assert pairs[pixel][0] == other
        assert pairs[pixel][1] == pytest.approx(distance, rel=1e-6)


def everywhere(surface: Surface) -> Surface:
    """The surface with tiles that reach a kilometre in every direction: every view may see them."""
    corner = np.array(list(itertools.product((-1e3, 1e3), repeat=3))).T  # (3, 8)
    return replace(
        surface,
        tile_corners=np.repeat(corner[..., None], surface.tile_corners.shape[-1], axis=-1),
    )


@pytest.mark.parametrize("ahead_m", [3, -3])
def test_a_point_behind_either_camera_is_not_matched_through_its_mirror_image(
    ahead_m: float,
) -> None:
    # On one axis. 3 m ahead, the other camera has the target's point behind it, and would see it, mirrored, in its
    # middle, whose own point is before the target; 3 m back, it is the other way round.
    camera = Camera(np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1.0]]), 1, 1)
    arrays = Arrays(np.zeros((1, 1, 3)), np.ones((1, 1)))
    target, other = (
        View("a", arrays, camera, np.eye(4)),
        View("b", arrays, camera, make_pose((0, 0, ahead_m))),
    )
    assert len(match(everywhere(lift(target)), other).pixels) == 0


def test_culling_never_drops_a_match() -> None:
    surface = lift(make_view("a.png", make_camera(96, 72, 80), make_pose((0, 0, 0))), tile_px=8)
    rng = np.random.default_rng(0)
    poses = [
        make_pose(
            tuple(rng.uniform(-1.5, 1.5, 3)), *rng.uniform(-1.2, 1.2, 2), rng.uniform(-3, 3)
        )
        for _ in range(40)
    ]
    views = [
        make_view(f"{k}.png", make_camera(64, 48, 50), pose) for k, pose in enumerate(poses)
    ]
    kept = [match(surface, view) for view in views]
    share_seen = visible_pixels(surface, views) / len(surface.pixels)
    for culled, view, share in zip(kept, views, share_seen, strict=True):
        everything = match(everywhere(surface), view)
        assert set(everything.pixels) == (set(culled.pixels) if culled is not None else set())
        assert len(everything.pixels) <= share * len(surface.pixels)
    assert (share_seen == 0).sum() > 5  # there was something to cull,
    assert ((share_seen > 0) & (share_seen < 1)).sum() > 10  # in whole and in part


def test_views_without_camera_pose_or_depth_have_no_matches() -> None:
    camera, rgb = make_camera(40, 30, 40), Arrays(np.zeros((30, 40, 3)))
    surface = lift(TARGET)
    lost = [View("b", rgb, camera, None), View("b", rgb, None, np.eye(4))]
    assert visible_pixels(surface, lost).tolist() == [0, 0]
    for view in (*lost, View("b", rgb, camera, np.eye(4))):
        assert match(surface, view) is None


def test_a_target_that_cannot_be_paired_is_named_with_the_reason() -> None:
    camera, arrays = make_camera(40, 30, 40), Arrays(np.zeros((15, 20, 3)), np.ones((15, 20)))
    with pytest.raises(InputError, match=r"^a\.png: .*pose;"):
        lift(View("a.png", arrays, camera, None))
    with pytest.raises(InputError, match=r"^a\.png: .*20x15, .*40x30;"):
        lift(View("a.png", arrays, camera, np.eye(4)))
