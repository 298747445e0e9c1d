"""Colour charts: where each kind's patches lie, what they should look like, and what an image shows there.

Conventions. A chart's frame is the unit square, x right, y down, as the chart is read: its corners (0, 0), (1, 0),
(1, 1), (0, 1) are the top left, top right, bottom right and bottom left in `scene.Chart.corners`. Expected colours are
given twice, as their makers and users publish them: CIE Lab under illuminant D50, and gamma-encoded sRGB (D65). The two
disagree by a few dE00 (DGK: up to 12), so whoever compares must name the list.

Sources. "dgk", DGK Color Tools, the charts of the Sea-thru data set (Akkaynak & Treibitz 2019): the maker's Lab
(taken as D50: patches 13-18 then agree with the sRGB list within dE00 1) and the sRGB list in public use; the corners
are those of the black frame. "colorchecker24", X-Rite ColorChecker Classic as made before November 2014: the maker's
published Lab D50 and sRGB values; the corners are the outer corners of the four corner patches, which every size of
this chart shows. "colorchecker_sg" and charts described by a CSV file: see `sucre_bench.imaging.charts.kinds`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.charts.kinds import Patch, chart_kind
from sucre_bench.scene import Chart

__all__ = ["PatchReading", "check_corners", "image_from_chart", "measure", "scaled_chart"]


@dataclass(frozen=True, slots=True, eq=False)
class PatchReading:
    """What an image shows of a patch.

    rgb: (3,) float64 median over the inner half of the patch, in the image's encoding, NaN when no pixel has a colour;
    n_pixels: pixels with a colour that it is made of; coverage: their share of all pixels there, 0 to 1.
    """

    patch: Patch
    rgb: Array
    n_pixels: int
    coverage: float


def measure(shown: Array, chart: Chart) -> list[PatchReading]:
    """Return what an image shows of each patch of a chart, in the order of the kind's patches.

    shown: (H, W, 3), NaN where there is no colour; chart.corners: (4, 2) pixels, pixel centres at +0.5.
    The image's own pixels are taken, those whose centre lies in the inner half (in x and y) of the patch; where a patch
    is too small to hold one, the pixel at its centre. Pixels beyond the image's edge count as pixels without colour.
    Raises InputError for an unknown kind, and for corners that are not a convex quadrilateral in reading order.
    """
    kind, corners = chart_kind(chart.kind), np.asarray(chart.corners, dtype=np.float64)
    check_corners(chart.name, corners)
    homography = image_from_chart(corners)
    return [_read(shown, patch, homography) for patch in kind.patches]


def image_from_chart(corners: Array) -> Array:
    """Return the homography (3, 3) float64 from a chart's unit square to pixels, of its corners (4, 2)."""
    import cv2

    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    return np.asarray(cv2.getPerspectiveTransform(unit, np.asarray(corners, dtype=np.float32)), dtype=np.float64)


def check_corners(name: str, corners: Array) -> None:
    """Raise InputError unless corners are (4, 2), finite, convex and in reading order."""
    fault = f"chart '{name}': corners are not a quadrilateral; give (4, 2) pixels from the top left on, clockwise"
    if corners.shape != (4, 2) or not np.isfinite(corners).all():
        raise InputError(fault)
    edge = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
    if not (turn > 0).all():  # all turns clockwise (y down): convex, and not mirrored
        raise InputError(fault)


def _read(shown: Array, patch: Patch, homography: Array) -> PatchReading:
    """The median of the pixels in the inner half: a corner that is off by a tenth of a patch does no harm."""
    x0, y0, x1, y1 = patch.box
    x_inner = (0.75 * x0 + 0.25 * x1, 0.25 * x0 + 0.75 * x1)
    y_inner = (0.75 * y0 + 0.25 * y1, 0.25 * y0 + 0.75 * y1)
    outline = _map(homography, np.array([(x, y) for x in x_inner for y in y_inner]))
    (u0, v0), (u1, v1) = np.floor(outline.min(axis=0)).astype(int), np.ceil(outline.max(axis=0)).astype(int)
    u, v = (a.ravel() for a in np.meshgrid(np.arange(u0, u1), np.arange(v0, v1)))
    x, y = _map(np.linalg.inv(homography), np.stack([u, v], axis=-1) + 0.5).T
    inside = (x >= x_inner[0]) & (x <= x_inner[1]) & (y >= y_inner[0]) & (y <= y_inner[1])
    u, v = u[inside], v[inside]
    if u.size == 0:
        centre = np.floor(_map(homography, np.array([[(x0 + x1) / 2, (y0 + y1) / 2]])))
        u, v = centre.astype(int).T
    in_image = (u >= 0) & (u < shown.shape[1]) & (v >= 0) & (v < shown.shape[0])
    pixels = np.asarray(shown[v[in_image], u[in_image]], dtype=np.float64)
    pixels = pixels[np.isfinite(pixels).all(axis=-1)]  # (P, 3)
    rgb = np.median(pixels, axis=0) if len(pixels) else np.full(3, np.nan)
    return PatchReading(patch, rgb, len(pixels), len(pixels) / u.size)


def _map(homography: Array, points: Array) -> Array:
    """Apply a homography (3, 3) to points (N, 2)."""
    mapped = np.c_[points, np.ones(len(points))] @ homography.T
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def scaled_chart(chart: Chart, size: tuple[int, int], target: tuple[int, int]) -> Chart:
    """Return a chart whose corners are in pixels of an image of another size (width, height)."""
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))
