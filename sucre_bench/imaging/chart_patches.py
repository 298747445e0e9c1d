"""Measures colour charts: the places of patches, their expected colours, and their colours in an image.

Conventions. A chart's frame is the unit square, x right, y down, as the chart is read. Its corners (0, 0), (1, 0), (1,
1), (0, 1) are the top left, top right, bottom right and bottom left in `scene.Chart.corners`. Expected colours are
given twice, as their makers and users publish them: CIE Lab under illuminant D50, and gamma-encoded sRGB (D65). The two
disagree by a few dE00 (DGK: up to 12), so whoever compares must name the list.

Sources. "dgk", DGK Color Tools, the charts of the Sea-thru data set (Akkaynak & Treibitz 2019): the maker's Lab
(taken as D50: patches 13-18 then agree with the sRGB list within dE00 1) and the sRGB list in public use; the corners
are those of the black frame. "colorchecker24", X-Rite ColorChecker Classic as made before November 2014: the maker's
published Lab D50 and sRGB values. The corners are the outer corners of the four corner patches, which every size of
this chart shows. "colorchecker_sg" and charts described by a CSV file: see `sucre_bench.imaging.chart_kinds`.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Mask, Size, locked, once
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import ChartKind, Patch, chart_kind
from sucre_bench.scene import Chart


@dataclass(frozen=True, slots=True, eq=False)
class PatchReading:
    """What an image shows of a patch."""

    patch: Patch

    rgb: Array
    """Median over the inner half of the patch, (3,) float64, in the image's encoding; NaN if no pixel has a colour."""

    n_pixels: int
    """Pixels with a colour, of which the median is taken."""

    coverage: float
    """Share of pixels with a colour among all pixels there, 0 to 1."""


def measure(shown: Array, chart: Chart) -> list[PatchReading]:
    """Return what an image shows of each patch of a chart, in the order of the kind's patches.

    shown: (H, W, 3), NaN where there is no colour; chart.corners: (4, 2) pixels, pixel centres at +0.5.
    The image's own pixels are taken, those whose centre lies in the inner half (in x and y) of the patch. A patch that
    is too small to hold one has the pixel at its centre. Pixels beyond the image's edge count as pixels without colour.
    Raises InputError for an unknown kind, and for corners that are not a convex quadrilateral in reading order.
    """
    kind, corners = chart_kind(chart.kind), np.asarray(chart.corners, dtype=np.float64)
    check_corners(chart.name, corners)
    return list(_readings(shown, kind, corners.tobytes()))


def image_from_chart(corners: Array) -> Array:
    """Return the homography (3, 3) float64 from a chart's unit square to pixels, of its corners (4, 2)."""
    import cv2

    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=np.float32)
    return np.asarray(
        cv2.getPerspectiveTransform(unit, np.asarray(corners, dtype=np.float32)),
        dtype=np.float64,
    )


def chart_mask(chart: Chart, size: Size) -> Mask:
    """Return (H, W) bool: the pixels whose centre lies within a chart's corners; size: (width, height).

    Raises InputError for corners that are not a convex quadrilateral in reading order.
    """
    corners = np.asarray(chart.corners, dtype=np.float64)
    check_corners(chart.name, corners)
    mask = np.zeros(size[::-1], dtype=bool)
    left, top = np.clip(np.floor(corners.min(axis=0)), 0, size).astype(int)
    right, bottom = np.clip(np.ceil(corners.max(axis=0)), 0, size).astype(int)
    v, u = np.mgrid[top:bottom, left:right] + 0.5
    inside = np.ones(u.shape, dtype=bool)
    for (x, y), (dx, dy) in zip(corners, np.roll(corners, -1, axis=0) - corners, strict=True):
        # on the right of each edge: corners go clockwise, y down
        inside &= dx * (v - y) - dy * (u - x) >= 0
    mask[top:bottom, left:right] = inside
    return mask


def check_corners(name: str, corners: Array) -> None:
    """Raise InputError unless corners are (4, 2), finite, convex and in reading order."""
    if not are_corners(corners):
        fault = f"chart '{name}': corners are not a quadrilateral"
        raise InputError(f"{fault}; give (4, 2) pixels from the top left on, clockwise")


def are_corners(corners: Array) -> bool:
    """Whether corners are (4, 2), finite, convex and in reading order: a chart seen from the front."""
    if corners.shape != (4, 2) or not np.isfinite(corners).all():
        return False
    edge = np.roll(corners, -1, axis=0) - corners
    following = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * following[:, 1] - edge[:, 1] * following[:, 0]
    return bool((turn > 0).all())  # all turns clockwise (y down): convex, and not mirrored


@once
def _readings(shown: Array, kind: ChartKind, corners: bytes) -> tuple[PatchReading, ...]:
    """corners: (4, 2) float64. Corners may be off by a tenth of a patch, so its inner half is read."""
    homography = image_from_chart(np.frombuffer(corners).reshape(4, 2))
    inverse = np.linalg.inv(homography)
    height, width = shown.shape[:2]
    readings = []
    for patch in kind.patches:
        near, far = np.array(patch.box).reshape(2, 2)
        (x0, y0), (x1, y1) = 0.75 * near + 0.25 * far, 0.25 * near + 0.75 * far
        x, y, w = homography @ [
            (x0, x0, x1, x1, (x0 + x1) / 2),
            (y0, y1, y0, y1, (y0 + y1) / 2),
            (1, 1, 1, 1, 1),
        ]
        ends = np.stack([x, y]) / w  # (2, 5) pixels: the corners, and the centre
        (left, top), (right, bottom) = (
            np.floor(ends.min(axis=1)).astype(int),
            np.ceil(ends.max(axis=1)).astype(int),
        )
        v, u = np.mgrid[top:bottom, left:right].reshape(2, -1)
        a, b, c = inverse @ np.stack([u + 0.5, v + 0.5, np.ones(len(u))])
        inside = (x0 <= a / c) & (a / c <= x1) & (y0 <= b / c) & (b / c <= y1)
        # Of a patch that is smaller than a pixel, the one at its centre.
        u, v = (u[inside], v[inside]) if inside.any() else np.floor(ends[:, 4:]).astype(int)
        seen = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        colours = shown[v[seen], u[seen]].astype(np.float64)
        colours = colours[np.isfinite(colours).all(axis=1)]
        rgb = np.median(colours, axis=0) if len(colours) else np.full(3, np.nan)
        readings.append(PatchReading(patch, locked(rgb), len(colours), len(colours) / len(u)))
    return tuple(readings)


def scaled_chart(chart: Chart, size: Size, target: Size) -> Chart:
    """Return a chart whose corners are in pixels of an image of another size (width, height)."""
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))


# On eight charts of Sea-thru's D5, 1.5 to 10 m away, the right order explains .69 to .93, any other at most .15.
_LEAST = 0.4
_CLEARLY = 0.2


@dataclass(frozen=True, slots=True)
class Order:
    """How well patches fit."""

    explained: float
    """Share of variance, 0 to 1; NaN where it is not known."""

    turn: int
    """Which corner, 0 to 3, should be the first."""

    @property
    def fault(self) -> str:
        """What is wrong, in words; empty where nothing is."""
        if self.turn:
            first = ("top left", "top right", "bottom right", "bottom left")[self.turn]
            return f"the patches are in order if the corner marked {first} is the top left one"
        if math.isnan(self.explained):
            return "too few patches have a colour to tell whether they are in order"
        if self.explained < _LEAST:
            said = f"{self.explained:.0%} explained"
            return (
                f"the patches' colours do not follow the chart's ({said}): wrong place or kind"
            )
        return ""


def reading_order(shown: Array, chart: Chart) -> Order:
    """Tell how well a chart's patches fit their place. shown: (H, W, 3), NaN where there is no colour.

    Patches without a colour are left out; with fewer than six left nothing is known: explained is NaN, turn 0.
    Raises InputError as `measure` does.
    """
    fits = []
    for turn in range(4):
        readings = measure(shown, replace(chart, corners=np.roll(chart.corners, -turn, axis=0)))
        measured = np.array([reading.rgb for reading in readings])
        expected = np.array([reading.patch.srgb for reading in readings])
        seen = np.isfinite(measured).all(axis=1)
        if seen.sum() < 6:
            return Order(np.nan, 0)
        # The share of what was measured that is a rising line of what is expected, all channels together.
        x, y = (colours[seen] - colours[seen].mean(axis=0) for colours in (expected, measured))
        covariance, total = (x * y).sum(axis=0).clip(0), (y * y).sum()
        fits.append(
            float((covariance**2 / (x * x).sum(axis=0)).sum() / total) if total > 0 else 0.0
        )
    if not np.isfinite(fits).all():
        return Order(np.nan, 0)
    best = int(np.argmax(fits))
    wrong = fits[best] > fits[0] + _CLEARLY and fits[best] >= _LEAST
    return Order(float(fits[0]), best if wrong else 0)
