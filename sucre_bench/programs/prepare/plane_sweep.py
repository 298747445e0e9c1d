"""Depth by plane sweep: each pixel takes the plane on which several photos look most alike.

Planes are parallel in inverse depth: w = g . (x, y, 1) + k dw, where the slope g is that of the sparse points, so that
planes lie parallel to a slanted seabed. Collins, A space-sweep approach to true multi-image
matching, CVPR 1996; likeness is normalised cross-correlation (NCC), which water does not change if
its gain and veil are even over a window. A depth counts if the depths of other photos agree with it.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, depth_at, moved, pixel_rays, project, relative_pose
from sucre_bench.machine.compute import compiled
from sucre_bench.programs.prepare.shots import Shot

# degrees: depth is well determined; more only changes the appearance
_TELLING_ANGLE = np.deg2rad(5.0)
_WIDEST_ANGLE = np.deg2rad(45.0)
_WANTED = 2.0  # photos that are to see each point under telling angles
_WINDOW = (7, 7)  # pixels
_LEAST_LIKENESS = 0.5
# standard deviation of 8-bit gray levels in a window; below it is rounding
_LEAST_VARIANCE = 0.6**2
_STEP_PX = 1.0  # pixels that a step may move a pixel in any photo; a parabola through three scores resolves a tenth
_MOST_PLANES = 256
_FEWEST_PLANES = 16
_AGREEMENT = 0.01  # relative difference of depths
# Patches of no more pixels, whose neighbours differ by 2 % at most, are matched by chance, in open water above all.
_SPECK = 10


def neighbours(shots: Sequence[Shot], most: int) -> list[list[int]]:
    """Return, for each photo, the indices of the photos that together determine its depths best, the best first.

    A common point counts by the angle it is seen under, up to 5 degrees in full, beyond 45 not at all. It counts until
    the chosen photos see it twice in full, so they see all parts of the photo.
    """
    from scipy.sparse import csc_array

    firsts = [np.unique(shot.point_ids, return_index=True)[1] for shot in shots]
    seen = [shot.point_ids[first] for shot, first in zip(shots, firsts, strict=True)]
    known, columns = np.unique(np.concatenate(seen), return_inverse=True)
    by = np.repeat(np.arange(len(shots)), [len(first) for first in firsts])
    # a column a point
    seers = csc_array((np.ones(len(by)), (by, columns)), shape=(len(shots), len(known)))
    centres = np.array([shot.centre for shot in shots])
    best = []
    for i, (shot, first) in enumerate(zip(shots, firsts, strict=True)):
        of_points = seers[:, columns[by == i]]
        others = of_points.indices  # who sees which point
        which = np.repeat(np.arange(len(first)), np.diff(of_points.indptr))
        points = shot.points[first][which]
        rays = [centres[i] - points, centres[others] - points]
        lengths = [np.maximum(np.linalg.norm(ray, axis=1), 1e-12) for ray in rays]
        angles = np.arccos(
            np.clip((rays[0] * rays[1]).sum(axis=1) / (lengths[0] * lengths[1]), -1, 1)
        )
        weight = (
            np.minimum(angles / _TELLING_ANGLE, 1) * (angles < _WIDEST_ANGLE) * (others != i)
        )
        # A photo from half or twice the distance shows the same ground with other detail.
        weight *= np.exp(-(np.log(lengths[0] / lengths[1]) ** 2) / (2 * np.log(2) ** 2))
        wanted, chosen = np.full(len(first), _WANTED), list[int]()
        while len(chosen) < most:
            gain = np.bincount(others, np.minimum(weight, wanted[which]), minlength=len(shots))
            if gain.max(initial=0) < 1e-9:
                break
            chosen.append(int(gain.argmax()))
            seen = others == chosen[-1]
            wanted[which[seen]] = np.maximum(wanted[which[seen]] - weight[seen], 0)
            weight[seen] = 0
        best.append(chosen)
    return best


def planes_of(shot: Shot, sources: Sequence[Shot]) -> tuple[Array, Array]:
    """Return the planes to sweep for a photo: parallel to its sparse points, over their range with a margin.

    slope: (3,) g, so that g . (x, y, 1) is an inverse depth at a pixel; offsets: (K,) equally spaced k dw.
    """
    xy, depth = shot.seen_points()
    w = 1 / depth
    slope = _slope(xy, w, shot.camera)
    rest = w - np.column_stack([xy, np.ones(len(xy))]) @ slope
    low, high = np.quantile(rest, [0.01, 0.99])
    margin = 0.25 * (high - low) + 0.05 * np.median(w)
    low, high = low - margin, high + margin
    step = _STEP_PX / max(_motion(shot, source) for source in sources)
    count = int(np.clip(np.ceil((high - low) / step), _FEWEST_PLANES, _MOST_PLANES))
    return slope, np.linspace(low, high, count)


def _slope(xy: Array, w: Array, camera: Camera) -> Array:
    """The plane w = g . (x, y, 1) through the points by least absolute differences; level if there are few."""
    level = np.array([0.0, 0.0, np.median(w)])
    if len(w) < 12:
        return level
    size = np.array([camera.width, camera.height, 1.0])
    g = least_absolute(
        np.column_stack([xy, np.ones(len(xy))]) / size, w, 1e-3 * float(np.median(w))
    )
    corners = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1]]) @ g
    return g / size if corners.max() < 8 * np.median(w) else level


def least_absolute(design: Array, target: Array, least: float) -> Array:
    """Return the x (K,) of least sum of |design x - target|; design: (N, K). Smaller differences count as `least`."""
    weight: Array = np.ones(len(target))
    x: Array = np.zeros(design.shape[1])
    for _ in range(20):
        root = np.sqrt(weight)
        x = np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0]
        weight = 1 / np.maximum(np.abs(design @ x - target), least)
    return x


def _motion(shot: Shot, source: Shot) -> float:
    """How fast points move in the source's image, in pixels per unit of inverse depth (95 % of pixels are slower)."""
    xy, depth = shot.seen_points()
    rays = (np.column_stack([xy, np.ones(len(xy))]) @ np.linalg.inv(shot.camera.K).T).T
    pose = relative_pose(source.cam_from_world, shot.cam_from_world)
    w = 1 / depth
    change = 1e-4 * np.median(w)
    ends = [
        project(source.camera, ((pose[:3, :3] @ rays / at) + pose[:3, 3:]).T)[0]
        for at in (w, w + change)
    ]
    speed = np.linalg.norm(ends[1] - ends[0], axis=1) / change
    speed = speed[np.isfinite(speed)]
    return float(np.quantile(speed, 0.95)) if len(speed) else 1e-9


class _Best(NamedTuple):
    """The best of a sweep so far, each (H, W): numba takes this as a tuple of arrays."""

    # The two best correlations on this plane.
    first: Array
    second: Array

    previous: Array
    """The score of the plane before."""

    best: Array
    """The best score."""

    # The scores of the planes next to the best one.
    before: Array
    after: Array

    at: npt.NDArray[np.int16]
    """The number of the best plane."""


def sweep(
    shot: Shot,
    gray: Array,
    sources: Sequence[Shot],
    grays: Sequence[Array],
    slope: Array,
    offsets: Array,
) -> Array:
    """Return planar depth (H, W) float32 in the model's unit, 0 = not found.

    gray, grays: (H, W) float32, 1 to 256, of the photo and of its sources, 0 where masked out, at their cameras' sizes;
    slope, offsets: the planes, see `planes_of`.
    """
    import cv2

    mean = cv2.blur(gray, _WINDOW)
    variance = cv2.blur(gray * gray, _WINDOW) - mean * mean
    telling = (variance > _LEAST_VARIANCE) & (gray > 0)
    deviation = np.sqrt(np.maximum(variance, _LEAST_VARIANCE))

    scores = [np.full(gray.shape, -1, dtype=np.float32) for _ in range(6)]
    best = _Best._make([*scores, np.zeros(gray.shape, dtype=np.int16)])
    product, square = np.empty_like(gray), np.empty_like(gray)
    compare, decide = compiled(_compare), compiled(_decide)
    # OpenCV has pixel centres at whole numbers
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    whole = np.linalg.inv(half)
    K_inv = np.linalg.inv(shot.camera.K)
    size = shot.camera.size
    poses = [relative_pose(source.cam_from_world, shot.cam_from_world) for source in sources]
    for k, offset in enumerate(offsets):
        plane = slope + np.array([0, 0, offset])
        for source, other, pose in zip(sources, grays, poses, strict=True):
            # A point at pixel p of inverse depth w = plane . p is K_inv p / w: in the source K (R K_inv p + t w)
            H = (
                whole
                @ (source.camera.K @ (pose[:3, :3] @ K_inv + np.outer(pose[:3, 3], plane)))
                @ half
            )
            warped = np.asarray(
                cv2.warpPerspective(
                    other, H, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
                )
            )
            cv2.multiply(gray, warped, product)
            cv2.multiply(warped, warped, square)
            means = tuple(
                np.asarray(cv2.blur(image, _WINDOW)) for image in (warped, square, product)
            )
            compare(best.first, best.second, mean, deviation, warped, *means, _LEAST_VARIANCE)
        decide(k, len(sources) > 2, best)
    return _depth(shot.camera, slope, offsets, best) * telling


def _compare(
    first: Array,
    second: Array,
    mean: Array,
    deviation: Array,
    warped: Array,
    mean_there: Array,
    square_there: Array,
    product: Array,
    least_variance: float,
) -> None:
    """Compute a source's correlation at every pixel, and store the best two.

    mean_there, square_there, product: means over a window of the source's gray levels, of their squares, and of their
    products with the photo's.
    """
    for y in range(first.shape[0]):
        for x in range(first.shape[1]):
            variance = square_there[y, x] - mean_there[y, x] * mean_there[y, x]
            if warped[y, x] > 0 and variance > least_variance:
                score = (product[y, x] - mean[y, x] * mean_there[y, x]) / (
                    deviation[y, x] * math.sqrt(variance)
                )
                if score > first[y, x]:
                    second[y, x] = first[y, x]
                    first[y, x] = score
                elif score > second[y, x]:
                    second[y, x] = score


def _decide(k: int, two: bool, state: _Best) -> None:
    """Take the plane where it is the best so far, with the scores of its neighbours; reset for the next plane."""
    first, second, previous, best, before, after, at = state
    for y in range(first.shape[0]):
        for x in range(first.shape[1]):
            # The better half of the photos counts, two of four, so that a blocked view does not decide.
            score = (
                0.5 * (first[y, x] + second[y, x]) if two and second[y, x] > -1 else first[y, x]
            )
            if k > 0 and at[y, x] == k - 1:
                after[y, x] = score
            if score > best[y, x]:
                best[y, x] = score
                at[y, x] = k
                before[y, x] = previous[y, x]
                after[y, x] = -1.0
            previous[y, x] = score
            first[y, x] = second[y, x] = -1.0


def _depth(camera: Camera, slope: Array, offsets: Array, state: _Best) -> Array:
    """Turn the best plane of each pixel into depth, refined between planes by a parabola through three scores."""
    best, at, before, after = state.best, state.at, state.before, state.after
    curvature = before - 2 * best + after
    inner = (at > 0) & (at < len(offsets) - 1) & (curvature < 0) & (before > -1) & (after > -1)
    between = np.where(inner, 0.5 * (before - after) / np.where(inner, curvature, -1), 0)
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    step = offsets[1] - offsets[0]
    w = slope[0] * u + slope[1] * v + slope[2] + offsets[0] + step * (at + between)
    found = inner & (best > _LEAST_LIKENESS) & (w > 0)
    return np.where(found, 1 / np.where(found, w, 1), 0).astype(np.float32)


def agreeing(
    shot: Shot, depth: Array, sources: Sequence[Shot], depth_of: Callable[[int], Array]
) -> Array:
    """Return the depths (H, W) that two sources confirm, or the only one that sees the place, averaged with theirs.

    depth_of: gives the swept depth map of a source by its place in `sources`. A source confirms a depth when the point
    there projects to a pixel of its own whose depth differs by no more than 1 %. Specks are left out.
    """
    import cv2

    filled = depth > 0
    points = pixel_rays(shot.camera)[filled] * depth[filled][:, None]  # (P, 3)
    seen, confirmed = np.zeros((2, len(points)), dtype=np.int32)
    ratios = np.ones(len(points))
    for place, source in enumerate(sources):
        pose = relative_pose(source.cam_from_world, shot.cam_from_world)
        xy, z = project(source.camera, moved(points, pose))
        stored = depth_at(depth_of(place), xy)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = stored / z
            seen += ((xy >= 0) & (xy < source.camera.size)).all(axis=1)
        agrees = (stored > 0) & (np.abs(ratio - 1) < _AGREEMENT)
        confirmed += agrees
        ratios[agrees] += ratio[agrees]
    kept = np.zeros_like(depth)
    enough = (confirmed > 0) & (confirmed >= np.minimum(seen, 2))
    kept[filled] = np.where(enough, depth[filled] * ratios / (1 + confirmed), 0)
    levels = np.full(kept.shape, -32768, np.int16)
    found = kept > 0
    levels[found] = np.rint(1000 * np.log(kept[found] / kept.max())).clip(-32000)
    cv2.filterSpeckles(levels, -32768, _SPECK, 20)
    return np.where(levels > -32768, kept, 0).astype(np.float32)
