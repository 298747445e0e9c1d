"""Observations whose colours average the same ground, for the fit of the water.

A pixel records the mean over its footprint. The same point seen from farther away is averaged over a larger piece of
ground, so it has less contrast. A fit books that loss as attenuation. Here the images are blurred so that all
observations of a point average the same ground as the coarsest of them.

Near a point the surface is a plane. A, a (2, 2) matrix, maps steps in the target to steps in a view, both in
pixels. The view with the smallest |det A| is the coarsest, c. A square pixel has the covariance 1/12 in both directions
(its own pixels). In view c the common footprint is a Gaussian of k pixels over one pixel's square: (k^2 + 1/12) 1. In
another view, with M = A A_c^-1, the same ground has the covariance (k^2 + 1/12) M M^T. Its own pixels bring 1/12, so
its image is averaged with a Gaussian of covariance

    S = (k^2 + 1/12) M M^T - 1/12.

Seen from the same direction at depths of the ratio rho, M = rho 1 and sigma = sqrt((k^2 + 1/12) rho^2 - 1/12) pixels.
Colours are averaged around the sub-pixel place where the point lies. Large Gaussians read an image of smaller size,
made of means over blocks of 2^l pixels. These bring (4^l - 1) / 12 of the covariance themselves.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask, evenly, locked
from sucre_bench.camera import relative_pose
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.machine.compute import compiled, usable_cores
from sucre_bench.multiview.observations import Observations, Seen, arrange
from sucre_bench.multiview.observe import Kept, rays_at
from sucre_bench.multiview.pairing import Matches, Surface, lift, match, own_matches
from sucre_bench.scene import View

# k: standard deviation of the common Gaussian, in pixels of the coarsest view. From .5 to 1.5 the water of made scenes
# changes by less than 1 %; less leaves differences between square pixels, more rejects points near outlines.
_K = 1.0

# JPEG files store colours at half size: the finest detail of red is that of brightness, mostly of green, and water does
# not take it away. Where a view is such a file, the common Gaussian is wider than that detail.
_K_JPEG = 3.0

# Intensities from here on are cut off, and so are footprints that hold them. A channel that is mostly cut off does not
# count, unless all channels are.
_WHITE = 253.5 / 255
_MOSTLY = 0.5

# The variance of a square pixel, in pixels^2.
_SQUARE = 1 / 12

# Variances in px^2 of a view's Gaussian. Whole pixels average a narrower one badly.
_LEAST = 0.1
# A wider one, of a view that is 16 times as close as the farthest, takes too long.
_MOST = 256.0

# Where the variance is larger than this along all directions, a smaller image serves as well, px^2.
_ENOUGH = 2.5

# The window reaches to so many standard deviations. Points are left out when less than this share of their window lies
# in the image and on the same plane, within a share of the depth.
_REACH = 3.0
_SHARE = 0.99
_PLANE = 0.03

# The plane is fitted to inverse depths of 5 x 5 pixels. Where their rms distance to it is larger (relative), the
# surface is rough and is taken to face the camera.
_HALF = 2
_ROUGH = 0.005

# Views of a target that are read; more add little to a water.
_VIEWS = 32


def matched_footprints(
    target: View,
    views: Sequence[View],
    pixels: Indices,
    *,
    encoding: Kept = "view",
    with_view: bool = False,
    with_ray: bool = False,
) -> Observations:
    """Return observations of some pixels of a target, with colours that average the same ground in every view.

    views: those that show the target, itself among them; of more than 32 some are chosen evenly. pixels: flat indices
    into the target, with depth. encoding, with_view, with_ray: see `observe`; colours are float32.
    Views without a pose or depth, and files that cannot be read, are left out. Pixels at outlines, at the border of an
    image, or seen in one view only are left out, so that the result may be empty.
    """
    surface = lift(target).only(pixels)
    chosen = [views[k] for k in evenly(len(views), _VIEWS)]
    if all(view.name != target.name for view in chosen):
        chosen = [target, *chosen]
    k = _K_JPEG if any(view.is_jpeg for view in chosen) else _K
    steps = _steps_on_planes(target, surface)
    place = np.full(surface.camera.width * surface.camera.height, -1, dtype=np.int32)
    place[surface.pixels] = np.arange(len(surface.pixels))

    def land(view: View) -> _Landing | None:
        with suppress(InputError):  # pairing has told about damaged files
            return _land(view, target, surface, steps, place)
        return None

    def colours(landing: _Landing) -> Seen:
        return _seen(landing, common[landing.places], k, encoding, with_ray)

    with ThreadPoolExecutor(min(usable_cores(), len(chosen))) as pool:
        landings = [landing for landing in pool.map(land, chosen) if landing is not None]
        smallest, coarsest = (
            np.full(len(surface.pixels), np.inf),
            np.tile(np.eye(2), (len(surface.pixels), 1, 1)),
        )
        for landing in landings:
            area = np.abs(np.linalg.det(landing.to_view))
            smaller = area < smallest[landing.places]
            smallest[landing.places[smaller]] = area[smaller]
            coarsest[landing.places[smaller]] = landing.to_view[smaller]
        # A_c^-1 (P, 2, 2); the identity for points that no view shows
        common = np.linalg.inv(coarsest)
        seen = list(pool.map(colours, landings))
    shape = surface.camera.height, surface.camera.width
    observations = arrange(shape, [one for one in seen if len(one.pixels)], with_view=with_view)
    return observations.take(np.arange(observations.n_repeated))


def _steps_on_planes(target: View, surface: Surface) -> list[Array]:
    """Return the steps on the surface at P points that lead to the next pixel to the right and below: each (3, P).

    They are metres in the target camera's frame. A plane is fitted to the inverse depth around each point; inverse
    depth is linear in the image on any plane.
    """
    height, width = target.depth.shape
    y, x = np.divmod(surface.pixels.astype(np.int64), width)
    step = np.arange(-_HALF, _HALF + 1)
    v, u = (grid.ravel() for grid in np.meshgrid(step, step, indexing="ij"))
    inside = (x >= _HALF) & (x < width - _HALF) & (y >= _HALF) & (y < height - _HALF)
    around = target.depth[
        (y[:, None] + v).clip(0, height - 1), (x[:, None] + u).clip(0, width - 1)
    ]
    known = inside & (around > 0).all(axis=1)
    here = 1 / surface.points[2].astype(np.float64)
    # (P, 25)
    inverse = np.where(known[:, None], 1 / np.where(around > 0, around, 1), here[:, None])
    squares = float((u * u).sum())
    slope = np.stack([inverse @ u, inverse @ v]) / squares  # (2, P) of 1 / depth, a pixel
    plane = inverse.mean(axis=1)[:, None] + slope[0][:, None] * u + slope[1][:, None] * v
    rough = np.sqrt(((inverse - plane) ** 2).mean(axis=1)) > _ROUGH * here
    slope[:, rough] = 0
    K_inv = np.linalg.inv(surface.camera.K)
    depth = surface.points[2].astype(np.float64)
    # X = K^-1 (u, v, 1) d, and d' = -d^2 (1 / d)'
    return [
        K_inv[:, axis, None] * depth - surface.points * (depth * slope[axis])
        for axis in range(2)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _Landing:
    """Where M points of a target lie in a view."""

    view: View
    matches: Matches

    places: Indices
    """Indices of the points, (M,) int."""

    at: Array
    """Pixel coordinates x, y, (M, 2)."""

    depth: Array
    """In metres, planar, (M,)."""

    to_view: Array
    """A, the steps in the view over steps in the target, (M, 2, 2)."""

    slope: Array
    """Metres of depth a pixel of the view, on the plane, (M, 2)."""

    def only(self, which: Mask) -> _Landing:
        fields = {
            name: getattr(self, name)[which]
            for name in ("places", "at", "depth", "to_view", "slope")
        }
        return replace(self, matches=self.matches.only(which), **fields)


def _land(
    view: View,
    target: View,
    surface: Surface,
    sides: Sequence[Array],
    place: Indices,
) -> _Landing | None:
    is_target = view.name == target.name
    matches = own_matches(surface) if is_target else match(surface, view)
    if (
        matches is None
        or not len(matches.pixels)
        or view.camera is None
        or view.cam_from_world is None
    ):
        return None
    places = place[matches.pixels]
    pose = relative_pose(view.cam_from_world, surface.cam_from_world)
    points = pose[:3, :3] @ surface.points[:, places] + pose[:3, 3:]
    at = (view.camera.K @ points / points[2])[:2]
    # d (X / Z) = (dX - X / Z dZ) / Z
    steps = np.stack([pose[:3, :3] @ side[:, places] for side in sides], axis=-1)  # (3, M, 2)
    rays = points[:2] / points[2]
    A = np.einsum(
        "ij,jmk->mik",
        view.camera.K[:2, :2],
        (steps[:2] - rays[:, :, None] * steps[2]) / points[2][:, None],
    )
    is_seen = np.abs(np.linalg.det(A)) > 1e-6  # a plane seen from its edge has no area
    landing = _Landing(view, matches, places, at.T, points[2], A, np.zeros_like(at.T)).only(
        is_seen
    )
    slope = np.linalg.solve(landing.to_view.swapaxes(1, 2), steps[2][is_seen][..., None])[
        ..., 0
    ]
    return replace(landing, slope=slope)


def _seen(landing: _Landing, common: Array, k: float, encoding: Kept, with_ray: bool) -> Seen:
    """Return the colours of a view averaged over the common footprint, of k pixels of the coarsest view."""
    M = landing.to_view @ common
    S = (k**2 + _SQUARE) * M @ M.swapaxes(1, 2) - _SQUARE * np.eye(2)
    variances = np.linalg.eigvalsh(S)  # (M, 2), rising
    usable = (variances[:, 0] > _LEAST) & (variances[:, 1] < _MOST)
    landing = landing.only(usable)
    S = S[usable]
    least = variances[usable, 0]
    view = landing.view
    rgb = (
        srgb_decode(view.rgb) if encoding == "linear" and view.encoding == "gamma" else view.rgb
    )
    colour, share = (
        np.full((len(S), 3), np.nan, dtype=np.float32),
        np.zeros(len(S), dtype=np.float32),
    )
    levels = np.maximum(np.floor(np.log2(np.maximum(least / _ENOUGH, 1)) / 2), 0).astype(
        np.int64
    )
    uncut = np.array(view.depth, np.float32)
    white = view.rgb >= _WHITE
    is_full = white.mean(axis=(0, 1)) >= _MOSTLY
    uncut[(white if is_full.all() else white & ~is_full).any(axis=-1)] = 0
    for level, image, depth in _smaller(rgb, uncut, int(levels.max(initial=0))):
        here = np.flatnonzero(levels == level)
        if not len(here):
            continue
        block = 2**level
        spread = S[here] / block**2 - (1 - 1 / block**2) * _SQUARE * np.eye(2)
        places = landing.at[here] / block, landing.depth[here], landing.slope[here] * block
        means, used = np.empty((len(here), 3), np.float32), np.empty(len(here), np.float32)
        compiled(_average)(
            locked(image), locked(depth), *places, np.linalg.inv(spread), means, used
        )
        colour[here], share[here] = means, used
    enough = (share >= _SHARE) & np.isfinite(colour).all(axis=1)
    kept = landing.only(enough)
    matches = replace(kept.matches, at=kept.at.astype(np.float32))
    ray = rays_at(matches, view.camera) if with_ray and view.camera is not None else None
    return Seen(view.name, matches.pixels, matches.distance, colour[enough], ray)


def _smaller(rgb: Array, depth: Array, last: int) -> Iterator[tuple[int, Array, Array]]:
    """Yield an image and its depth as means over blocks of 2^level pixels; depth is 0 where a block has an outline."""
    image, mean = np.ascontiguousarray(rgb, np.float32), np.ascontiguousarray(depth, np.float32)
    low, high = mean, mean
    yield 0, image, mean
    for level in range(1, last + 1):
        image, mean = (np.stack(_quarters(plane)).mean(axis=0) for plane in (image, mean))
        low, high = (
            functools.reduce(np.minimum, _quarters(low)),
            functools.reduce(np.maximum, _quarters(high)),
        )
        whole = (low > 0) & (high - low <= 2 * _PLANE * low)
        if mean.size:
            yield level, image, np.where(whole, mean, 0)


def _quarters(plane: Array) -> list[Array]:
    """Return the four images (H // 2, W // 2, ...) that have one pixel of each block of 2 x 2."""
    height, width = (side // 2 * 2 for side in plane.shape[:2])
    return [plane[y:height:2, x:width:2] for y in (0, 1) for x in (0, 1)]


def _average(
    rgb: Array,
    depth: Array,
    at: Array,
    Z: Array,
    slope: Array,
    precision: Array,
    means: Array,
    share: Array,
) -> None:
    """Write Gaussian means (M, 3) of an image around places `at`, and the share (M,) of each window that they used.

    precision: (M, 2, 2), the inverse covariance. Pixels off the plane Z + slope (x - at) do not count.
    """
    rows, columns = depth.shape
    reach = _REACH * _REACH
    for i in range(len(at)):
        a, b, c = precision[i, 0, 0], precision[i, 0, 1], precision[i, 1, 1]
        x, y = at[i, 0] - 0.5, at[i, 1] - 0.5
        tall = math.sqrt(reach * a / (a * c - b * b))
        total = used = red = green = blue = 0.0
        most = _PLANE * Z[i]
        for v in range(math.ceil(y - tall), math.floor(y + tall) + 1):
            t = v - y
            middle = x - b / a * t
            half = math.sqrt(max(0.0, (reach - t * t * (c - b * b / a)) / a))
            for u in range(math.ceil(middle - half), math.floor(middle + half) + 1):
                s = u - x
                w = math.exp(-0.5 * (a * s * s + 2 * b * s * t + c * t * t))
                total += w
                if u < 0 or v < 0 or u >= columns or v >= rows:
                    continue
                if abs(depth[v, u] - Z[i] - slope[i, 0] * s - slope[i, 1] * t) > most:
                    continue
                used += w
                red += w * rgb[v, u, 0]
                green += w * rgb[v, u, 1]
                blue += w * rgb[v, u, 2]
        share[i] = used / total if total > 0 else 0
        means[i, 0], means[i, 1], means[i, 2] = red / used, green / used, blue / used
