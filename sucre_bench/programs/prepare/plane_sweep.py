"""Depth by plane sweep: each pixel takes the plane on which several photos look most alike.

Planes are parallel in inverse depth: w = g . (x, y, 1) + k dw, where the slope g is that of the sparse points, so that
planes lie parallel to a slanted seabed. Collins, A space-sweep approach to true multi-image
matching, CVPR 1996; likeness is normalised cross-correlation (NCC), which water does not change if
its gain and veil are even over a window. A depth counts if the depths of other photos agree with it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, depth_at, moved, pixel_rays, project, relative_pose
from sucre_bench.machine.compute import compiled
from sucre_bench.programs.prepare.registered_photos import Shot

_WINDOW = (7, 7)  # pixels
_LEAST_LIKENESS = 0.5
_LEAST_VARIANCE = 0.6**2  # standard deviation of 8-bit gray levels in a window; below it is rounding
_STEP_PX = 1.0  # pixels that a step may move a pixel in any photo; a parabola through three scores resolves a tenth
_MOST_PLANES = 256
_FEWEST_PLANES = 16
_AGREEMENT = 0.01  # relative difference of depths


@dataclass(frozen=True, eq=False, slots=True)
class Planes:
    """slope: (3,) g, so that g . (x, y, 1) is an inverse depth at a pixel; offsets: (K,) equally spaced k dw."""

    slope: Array
    offsets: Array


class _Best(NamedTuple):
    """The best of a sweep so far, each (H, W): numba takes this as a tuple of arrays.

    first, second: the two best correlations on this plane; previous: the score of the plane before; best: the best
    score; at: its plane; before, after: the scores of the planes next to that.
    """

    first: Array
    second: Array
    previous: Array
    best: Array
    at: npt.NDArray[np.int16]
    before: Array
    after: Array

    @classmethod
    def of(cls, shape: tuple[int, int]) -> "_Best":
        """Return the state before the first plane."""
        first, second, previous, best, before, after = (np.full(shape, -1, dtype=np.float32) for _ in range(6))
        return cls(first, second, previous, best, np.zeros(shape, dtype=np.int16), before, after)


class _Moments(NamedTuple):
    """What a source's correlation needs, each (H, W): its gray levels, and over a window their mean, their mean square,
    and their mean product with the photo's."""

    warped: Array
    mean: Array
    square: Array
    product: Array


def planes_of(shot: Shot, sources: Sequence[Shot]) -> Planes:
    """Return the planes to sweep for a photo: parallel to its sparse points, over their range with a margin."""
    xy, depth = shot.seen_points()
    w = 1 / depth
    slope = _slope(xy, w, shot.camera)
    rest = w - np.column_stack([xy, np.ones(len(xy))]) @ slope
    low, high = np.quantile(rest, [0.01, 0.99])
    margin = 0.25 * (high - low) + 0.05 * np.median(w)
    low, high = low - margin, high + margin
    step = _STEP_PX / max(_motion(shot, source) for source in sources)
    count = int(np.clip(np.ceil((high - low) / step), _FEWEST_PLANES, _MOST_PLANES))
    return Planes(slope, np.linspace(low, high, count))


def _slope(xy: Array, w: Array, camera: Camera) -> Array:
    """The plane w = g . (x, y, 1) through the points by least absolute differences; level if there are few."""
    level = np.array([0.0, 0.0, np.median(w)])
    if len(w) < 12:
        return level
    size = np.array([camera.width, camera.height, 1.0])
    design, weight, g = np.column_stack([xy, np.ones(len(xy))]) / size, np.ones(len(w)), level * size
    for _ in range(20):
        root = np.sqrt(weight)
        g = np.linalg.lstsq(design * root[:, None], w * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(w - design @ g), 1e-3 * np.median(w))
    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]) @ g
    return g / size if corners.max() < 8 * np.median(w) else level


def _motion(shot: Shot, source: Shot) -> float:
    """How fast points move in the source's image, in pixels per unit of inverse depth (95 % of pixels are slower)."""
    xy, depth = shot.seen_points()
    rays = (np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(shot.camera.K).T).T
    pose, w = relative_pose(source.cam_from_world, shot.cam_from_world), 1 / depth
    change = 1e-4 * np.median(w)
    ends = [project(source.camera, ((pose[:3, :3] @ rays / at) + pose[:3, 3:]).T)[0] for at in (w, w + change)]
    speed = np.linalg.norm(ends[1] - ends[0], axis=1) / change
    speed = speed[np.isfinite(speed)]
    return float(np.quantile(speed, 0.95)) if len(speed) else 1e-9


def sweep(shot: Shot, gray: Array, sources: Sequence[Shot], grays: Sequence[Array], planes: Planes) -> Array:
    """Return planar depth (H, W) float32 in the model's unit, 0 = not found.

    gray, grays: (H, W) float32, 1 to 256, of the photo and of its sources, 0 where masked out, at their cameras' sizes.
    """
    import cv2

    mean = cv2.blur(gray, _WINDOW)
    variance = cv2.blur(gray * gray, _WINDOW) - mean * mean
    telling = (variance > _LEAST_VARIANCE) & (gray > 0)
    deviation = np.sqrt(np.maximum(variance, _LEAST_VARIANCE))

    best = _Best.of((gray.shape[0], gray.shape[1]))
    product, square = np.empty_like(gray), np.empty_like(gray)
    compare, decide = compiled(_compare), compiled(_decide)
    for k, offset in enumerate(planes.offsets):
        plane = planes.slope + np.array([0, 0, offset])
        for source, other in zip(sources, grays, strict=True):
            warped = _warped(shot, source, other, plane)
            cv2.multiply(gray, warped, product)
            cv2.multiply(warped, warped, square)
            means: list[Array] = [np.asarray(cv2.blur(image, _WINDOW)) for image in (warped, square, product)]
            compare(best, mean, deviation, _Moments(warped, *means), _LEAST_VARIANCE)
        # The better half of the photos counts, two of four, so that a blocked view does not decide.
        decide(k, len(sources) > 2, best)
    return _depth(shot.camera, planes, best) * telling


def _compare(state: _Best, mean: Array, deviation: Array, there: _Moments, least_variance: float) -> None:
    """Compute a source's correlation at every pixel, and store the best two."""
    first, second, warped = state.first, state.second, there.warped
    for y in range(first.shape[0]):
        for x in range(first.shape[1]):
            variance = there.square[y, x] - there.mean[y, x] * there.mean[y, x]
            if warped[y, x] > 0 and variance > least_variance:
                score = (there.product[y, x] - mean[y, x] * there.mean[y, x]) / (deviation[y, x] * math.sqrt(variance))
                if score > first[y, x]:
                    second[y, x] = first[y, x]
                    first[y, x] = score
                elif score > second[y, x]:
                    second[y, x] = score


def _decide(k: int, two: bool, state: _Best) -> None:
    """Take the plane where it is the best so far, with the scores of its neighbours; reset for the next plane."""
    first, second, previous, best, at, before, after = state
    for y in range(first.shape[0]):
        for x in range(first.shape[1]):
            score = 0.5 * (first[y, x] + second[y, x]) if two else first[y, x]
            if k > 0 and at[y, x] == k - 1:
                after[y, x] = score
            if score > best[y, x]:
                best[y, x] = score
                at[y, x] = k
                before[y, x] = previous[y, x]
                after[y, x] = -1.0
            previous[y, x] = score
            first[y, x] = second[y, x] = -1.0


def _warped(shot: Shot, source: Shot, gray: Array, plane: Array) -> Array:
    """The source warped to the photo as if the scene were this plane; 0 outside the source."""
    import cv2

    pose = relative_pose(source.cam_from_world, shot.cam_from_world)
    # A point at pixel p with inverse depth w = plane . p is K_inv p / w, so in the source K (R K_inv p + t plane . p).
    H = source.camera.K @ (pose[:3, :3] @ np.linalg.inv(shot.camera.K) + np.outer(pose[:3, 3], plane))
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV has pixel centres at whole numbers
    H = np.linalg.inv(half) @ H @ half
    size = (shot.camera.width, shot.camera.height)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpPerspective(gray, H, size, flags=flags))


def _depth(camera: Camera, planes: Planes, state: _Best) -> Array:
    """Turn the best plane of each pixel into depth, refined between planes by a parabola through three scores."""
    best, at, before, after = state.best, state.at, state.before, state.after
    curvature = before - 2 * best + after
    inner = (at > 0) & (at < len(planes.offsets) - 1) & (curvature < 0) & (before > -1) & (after > -1)
    between = np.where(inner, 0.5 * (before - after) / np.where(inner, curvature, -1), 0)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    step = planes.offsets[1] - planes.offsets[0]
    w = planes.slope[0] * u + planes.slope[1] * v + planes.slope[2] + planes.offsets[0] + step * (at + between)
    found = inner & (best > _LEAST_LIKENESS) & (w > 0)
    return np.where(found, 1 / np.where(found, w, 1), 0).astype(np.float32)


def agreeing(
    shot: Shot, depth: Array, sources: Sequence[Shot], depth_of: Callable[[int], Array], least: int = 2
) -> Array:
    """Return the depths (H, W) that at least `least` sources confirm (one if there is but one), averaged with theirs.

    depth_of: gives the swept depth map of a source by its place in `sources`. A source confirms a depth when the point
    there projects to a pixel of its own whose depth differs by no more than 1 %.
    """
    least = min(least, len(sources))
    filled = depth > 0
    points = pixel_rays(shot.camera)[filled] * depth[filled][:, None]  # (P, 3)
    confirmed = np.zeros(len(points), dtype=np.int32)
    ratios = np.ones(len(points))
    for place, source in enumerate(sources):
        pose = relative_pose(source.cam_from_world, shot.cam_from_world)
        xy, z = project(source.camera, moved(points, pose))
        stored = depth_at(depth_of(place), xy)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = stored / z
        agrees = (stored > 0) & (np.abs(ratio - 1) < _AGREEMENT)
        confirmed += agrees
        ratios[agrees] += ratio[agrees]
    kept = np.zeros_like(depth)
    kept[filled] = np.where(confirmed >= least, depth[filled] * ratios / (1 + confirmed), 0)
    return kept
