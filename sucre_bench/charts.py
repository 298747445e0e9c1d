"""Colour charts: where each kind's patches lie, what they should look like, and what an image shows there.

Conventions. A chart's frame is the unit square, x right, y down, as the chart is read: its corners (0, 0), (1, 0),
(1, 1), (0, 1) are the top left, top right, bottom right and bottom left in `scene.Chart.corners`. Expected colours are
given twice, as their makers and users publish them: CIE Lab under illuminant D50, and gamma-encoded sRGB (D65). The two
disagree by a few dE00 (DGK: up to 12), so whoever compares must name the list.

Sources. "dgk", DGK Color Tools, the charts of the Sea-thru data set (Akkaynak & Treibitz 2019): the maker's Lab
(taken as D50: patches 13-18 then agree with the sRGB list within dE00 1) and the sRGB list in public use; the corners
are those of the black frame. "colorchecker24", X-Rite ColorChecker Classic as made before November 2014: the maker's
published Lab D50 and sRGB values; the corners are the outer corners of the four corner patches, which every size of
this chart shows. "colorchecker_sg" and charts described by a CSV file: see `sucre_bench.chart_kinds`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.scene import Array, Chart

__all__ = [
    "KINDS",
    "ChartKind",
    "Patch",
    "PatchReading",
    "Triple",
    "chart_kind",
    "check_corners",
    "image_from_chart",
    "kind_id",
    "measure",
]

_SG = "colorchecker_sg"

Triple = tuple[float, float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Patch:
    """One patch of a chart.

    name, number: as printed on the chart or in its data sheet, numbered from 1 row by row;
    box: (x0, y0, x1, y1) in the chart's unit square; srgb: expected colour, [0, 1], gamma-encoded;
    lab: expected colour, CIE Lab under D50; colour: whether it is chromatic, not one of the grays.
    """

    name: str
    number: int
    box: Box
    srgb: Triple
    lab: Triple
    colour: bool


@dataclass(frozen=True, slots=True)
class ChartKind:
    """A layout and its reference colours. width, height: of the frame, in any one unit (the aspect matters)."""

    name: str
    patches: tuple[Patch, ...]
    width: float
    height: float


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


def chart_kind(name: str) -> ChartKind:
    """Return the kind of that name, or the one that the CSV file of that path describes.

    Raises InputError, with the nearest name where there is none, and for a file that describes no chart.
    """
    if name in KINDS:
        return KINDS[name]
    if name == _SG or name.lower().endswith(".csv"):
        from sucre_bench import chart_kinds

        return chart_kinds.colorchecker_sg() if name == _SG else chart_kinds.read_kind(Path(name))
    known = did_you_mean(name, [*KINDS, _SG])
    raise InputError(f"chart kind '{name}': unknown; {known}, or the path of a CSV file")


def kind_id(name: str) -> str:
    """Return what tells one kind from another wherever its file lies: a CSV file's content, else the name."""
    if not name.lower().endswith(".csv"):
        return name
    try:
        return f"csv-{hashlib.blake2b(Path(name).read_bytes(), digest_size=6).hexdigest()}"
    except OSError:
        return "csv-unreadable"


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


# -- the kinds: number and name, sRGB in 8 bit, Lab under D50 -------------------------------------------------

_DGK = (
    ("white", (255, 255, 255), (97, 0, 1)),
    ("light-gray", (176, 180, 183), (73, 0, 0)),
    ("gray", (150, 151, 155), (62, 0, 0)),
    ("middle-gray", (119, 120, 124), (50, 0, 0)),
    ("dark-gray", (88, 89, 91), (38, 0, 0)),
    ("black", (1, 1, 1), (23, 0, 0)),
    ("red", (235, 28, 36), (48, 59, 39)),
    ("yellow", (254, 242, 0), (92, 1, 95)),
    ("green", (106, 189, 71), (64, -40, 54)),
    ("light-blue", (0, 173, 239), (57, -41, -42)),
    ("dark-blue", (1, 27, 84), (18, -3, -25)),
    ("magenta", (239, 2, 142), (49, 60, -3)),
    ("brick", (175, 51, 59), (41, 51, 26)),
    ("orange", (209, 127, 41), (61, 29, 57)),
    ("turquoise", (7, 136, 165), (52, -24, -24)),
    ("purple", (188, 86, 149), (52, 47, -14)),
    ("beige", (200, 159, 139), (69, 14, 17)),
    ("brown", (183, 147, 126), (64, 12, 17)),
)

_COLORCHECKER = (
    ("dark-skin", (115, 82, 68), (37.986, 13.555, 14.059)),
    ("light-skin", (194, 150, 130), (65.711, 18.130, 17.810)),
    ("blue-sky", (98, 122, 157), (49.927, -4.880, -21.925)),
    ("foliage", (87, 108, 67), (43.139, -13.095, 21.905)),
    ("blue-flower", (133, 128, 177), (55.112, 8.844, -25.399)),
    ("bluish-green", (103, 189, 170), (70.719, -33.397, -0.199)),
    ("orange", (214, 126, 44), (62.661, 36.067, 57.096)),
    ("purplish-blue", (80, 91, 166), (40.020, 10.410, -45.964)),
    ("moderate-red", (193, 90, 99), (51.124, 48.239, 16.248)),
    ("purple", (94, 60, 108), (30.325, 22.976, -21.587)),
    ("yellow-green", (157, 188, 64), (72.532, -23.709, 57.255)),
    ("orange-yellow", (224, 163, 46), (71.941, 19.363, 67.857)),
    ("blue", (56, 61, 150), (28.778, 14.179, -50.297)),
    ("green", (70, 148, 73), (55.261, -38.342, 31.370)),
    ("red", (175, 54, 60), (42.101, 53.378, 28.190)),
    ("yellow", (231, 199, 31), (81.733, 4.039, 79.819)),
    ("magenta", (187, 86, 149), (51.935, 49.986, -14.574)),
    ("cyan", (8, 133, 161), (51.038, -28.631, -28.638)),
    ("white", (243, 243, 242), (96.539, -0.425, 1.186)),
    ("neutral-8", (200, 200, 200), (81.257, -0.638, -0.335)),
    ("neutral-6.5", (160, 160, 160), (66.766, -0.734, -0.504)),
    ("neutral-5", (122, 122, 121), (50.867, -0.153, -0.270)),
    ("neutral-3.5", (85, 85, 85), (35.656, -0.421, -1.231)),
    ("black", (52, 52, 52), (20.461, -0.079, -0.973)),
)


def _kind(
    name: str,
    colours: Sequence[tuple[str, Triple, Triple]],
    columns: Sequence[tuple[float, float]],
    rows: Sequence[tuple[float, float]],
    gray_row: int,
    size: tuple[float, float],
) -> ChartKind:
    """Lay a table of colours out on a grid of columns (x0, x1) and rows (y0, y1), one row of which is gray."""
    patches = []
    for i, (patch, srgb, lab) in enumerate(colours):
        row, column = divmod(i, len(columns))
        (x0, x1), (y0, y1) = columns[column], rows[row]
        red, green, blue = (v / 255 for v in srgb)
        patches.append(Patch(patch, i + 1, (x0, y0, x1, y1), (red, green, blue), lab, row != gray_row))
    return ChartKind(name, tuple(patches), *size)


KINDS: dict[str, ChartKind] = {
    "dgk": _kind(
        "dgk",
        _DGK,
        columns=[(0.045 + 0.157 * k, 0.185 + 0.157 * k) for k in range(6)],  # measured on a rectified image
        rows=[(0.05, 0.48), (0.51, 0.71), (0.75, 0.95)],
        gray_row=0,
        size=(6, 4),
    ),
    "colorchecker24": _kind(
        "colorchecker24",
        _COLORCHECKER,
        columns=[(46 * k / 270, (46 * k + 40) / 270) for k in range(6)],  # patches of 40 mm, 6 mm apart
        rows=[(46 * k / 178, (46 * k + 40) / 178) for k in range(4)],
        gray_row=3,
        size=(270, 178),
    ),
}
