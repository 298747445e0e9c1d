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

import functools
import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask, locked, once
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import ChartKind, Patch, chart_kind
from sucre_bench.machine.compute import compiled
from sucre_bench.scene import Chart


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
    return np.asarray(cv2.getPerspectiveTransform(unit, np.asarray(corners, dtype=np.float32)), dtype=np.float64)


def chart_mask(chart: Chart, size: tuple[int, int]) -> Mask:
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
        inside &= dx * (v - y) - dy * (u - x) >= 0  # on the right of each edge: corners go clockwise, y down
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
    """corners: (4, 2) float64."""
    homography = image_from_chart(np.frombuffer(corners).reshape(4, 2))
    n = len(kind.patches)
    rgb, n_pixels, n_inside = np.empty((n, 3)), np.empty(n, np.int64), np.empty(n, np.int64)
    inner = _inner_halves(kind)
    compiled(_read_patches)(locked(shown), homography, np.linalg.inv(homography), inner, rgb, n_pixels, n_inside)
    read = zip(kind.patches, locked(rgb), n_pixels.tolist(), (n_pixels / n_inside).tolist(), strict=True)
    return tuple(PatchReading(*reading) for reading in read)


@functools.lru_cache(maxsize=32)
def _inner_halves(kind: ChartKind) -> Array:
    """The box (x0, y0, x1, y1) of each patch's inner half (N, 4): corners may be off by a tenth of a patch."""
    boxes = np.array([patch.box for patch in kind.patches])
    near, far = boxes[:, :2], boxes[:, 2:]
    return np.concatenate([0.75 * near + 0.25 * far, 0.25 * near + 0.75 * far], axis=1)


def _read_patches(
    shown: Array,
    homography: Array,
    inverse: Array,
    inner: Array,
    rgb: Array,
    n_pixels: npt.NDArray[np.int64],
    n_inside: npt.NDArray[np.int64],
) -> None:
    """Write each patch's median (N, 3), the pixels with a colour it is made of, and all pixels that lie in it."""
    height, width, _ = shown.shape
    for patch in range(len(inner)):
        x0, y0, x1, y1 = inner[patch]
        left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
        for x in (x0, x1):
            for y in (y0, y1):
                u, v, w = homography[:, 0] * x + homography[:, 1] * y + homography[:, 2]
                left, right = min(left, u / w), max(right, u / w)
                top, bottom = min(top, v / w), max(bottom, v / w)
        columns = max(min(int(np.ceil(right)), width) - max(int(np.floor(left)), 0), 1)
        rows = max(min(int(np.ceil(bottom)), height) - max(int(np.floor(top)), 0), 1)
        found = np.empty((3, rows * columns))
        n, inside = 0, 0
        for v in range(int(np.floor(top)), int(np.ceil(bottom))):
            for u in range(int(np.floor(left)), int(np.ceil(right))):
                a = inverse[0, 0] * (u + 0.5) + inverse[0, 1] * (v + 0.5) + inverse[0, 2]
                b = inverse[1, 0] * (u + 0.5) + inverse[1, 1] * (v + 0.5) + inverse[1, 2]
                c = inverse[2, 0] * (u + 0.5) + inverse[2, 1] * (v + 0.5) + inverse[2, 2]
                if not (x0 <= a / c <= x1 and y0 <= b / c <= y1):
                    continue
                inside += 1
                if 0 <= u < width and 0 <= v < height:
                    for channel in range(3):
                        found[channel, n] = shown[v, u, channel]
                    n += int(np.isfinite(found[0, n] + found[1, n] + found[2, n]))
        if inside == 0:  # smaller than a pixel: the one at its centre
            inside = 1
            x, y = (x0 + x1) / 2, (y0 + y1) / 2
            a, b, c = homography[:, 0] * x + homography[:, 1] * y + homography[:, 2]
            u, v = int(np.floor(a / c)), int(np.floor(b / c))
            if 0 <= u < width and 0 <= v < height:
                for channel in range(3):
                    found[channel, 0] = shown[v, u, channel]
                n += int(np.isfinite(found[0, 0] + found[1, 0] + found[2, 0]))
        n_pixels[patch], n_inside[patch] = n, inside
        for channel in range(3):
            rgb[patch, channel] = np.median(found[channel, :n]) if n else np.nan


def scaled_chart(chart: Chart, size: tuple[int, int], target: tuple[int, int]) -> Chart:
    """Return a chart whose corners are in pixels of an image of another size (width, height)."""
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))


# On eight charts of Sea-thru's D5, 1.5 to 10 m away, the right order explains .69 to .93, any other at most .15.
_LEAST, _CLEARLY = 0.4, 0.2


@dataclass(frozen=True, slots=True)
class Order:
    """How well patches fit.

    explained: share of variance, 0 to 1, NaN where it is not known; turn: which corner, 0 to 3, should be the first.
    """

    explained: float
    turn: int

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
            return f"the patches' colours do not follow the chart's ({said}): wrong place or kind"
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
        fits.append(float((covariance**2 / (x * x).sum(axis=0)).sum() / total) if total > 0 else 0.0)
    if not np.isfinite(fits).all():
        return Order(np.nan, 0)
    best = int(np.argmax(fits))
    wrong = fits[best] > fits[0] + _CLEARLY and fits[best] >= _LEAST
    return Order(float(fits[0]), best if wrong else 0)
