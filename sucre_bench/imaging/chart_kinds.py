"""Kinds of colour charts: DGK, ColorChecker 24 and SG, and charts of your own.

A chart of your own is a CSV file, named as the chart's kind by its path:

    # illuminant: D65
    # frame: 120 x 80
    name,x0,y0,x1,y1,L,a,b
    white,2,2,18,18,96.5,-0.4,1.2

frame: width x height of what the four corners are the corners of, in any unit; x0, y0, x1, y1: a patch's left, top,
right and bottom edge in that unit, from the frame's top left; L, a, b: CIE Lab under the illuminant (one of CIE's, 2
degree observer), brought to D50 by Bradford's adaptation. Columns R, G, B, 0 to 255, may give the expected sRGB; else
it is the Lab's, clipped. Patches are numbered as they are listed; those of a chroma of 5 or more count as colours.

Measured reflectances, in [0, 1], may stand in place of L, a, b. There is one column a wavelength, named by its nm, from
400 or less to 700 or more. The illuminant may then be a CSV file, too, and a third line may name a camera's responses:

    # illuminant: D65
    # frame: 120 x 80
    # camera: responses.csv
    name,x0,y0,x1,y1,400,410,420,...,700

See `imaging.spectra` for these files, whose paths start at the chart's file.

The ColorChecker Digital SG is given in the maker's values of charts made after November 2014, as colour-science has
them. Its corners are the outer corners of the four corner patches, A1, N1, N10, A10. A patch is taken as 7/8 of its
pitch, as for the Classic. Only its inner half is read.
"""

from __future__ import annotations

import csv
import functools
import hashlib
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.cielab import colour_science, lab_d50_from, srgb_of_lab_d50
from sucre_bench.imaging.spectra import colours, on_grid
from sucre_bench.machine.files import fault_of, reading, regular

_CHROMATIC = 5.0  # chroma in Lab: the "neutral" patches of sold charts stay below 2, their dark skin is at 19
_LENGTH = r"\d+\.?\d*|\.\d+"
_COLUMNS = ("name", "x0", "y0", "x1", "y1", "L", "a", "b")


@functools.cache
def colorchecker_sg() -> ChartKind:
    """Return the ColorChecker Digital SG: 14 columns A to N, 10 rows, numbered row by row."""
    colour = colour_science()
    published = colour.CCS_COLOURCHECKERS["ColorCheckerSG - After November 2014"]
    lab = colour.XYZ_to_Lab(
        colour.xyY_to_XYZ(np.array(list(published.data.values()))), published.illuminant
    )
    # in pitches
    width = 14 - 1 / 8
    height = 10 - 1 / 8
    boxes = [
        (x / width, y / height, (x + 7 / 8) / width, (y + 7 / 8) / height)
        for y in range(10)
        for x in range(14)
    ]
    return ChartKind(
        "colorchecker_sg", _patches(list(published.data), boxes, lab), width, height
    )


def read_kind(path: Path) -> ChartKind:
    """Return the kind that a CSV file describes, see above. Raises InputError naming the line that is wrong."""
    if fault := fault_of(path):
        raise InputError(
            f"{path}: {fault}; give the path of the CSV file that describes the chart"
        )
    with reading(path, "correct the path of the chart"):
        return _parsed(str(path), regular(path).read_text(encoding="utf-8-sig"))


@functools.lru_cache(maxsize=32)  # asked for with every chart that is measured
def _parsed(place: str, text: str) -> ChartKind:
    lines = [
        (number, line.strip())
        for number, line in enumerate(text.splitlines(), 1)
        if line.strip()
    ]
    said = dict(re.findall(r"^#\s*(\w+)\s*:\s*(.+?)\s*$", text, flags=re.MULTILINE))
    frame = re.fullmatch(rf"({_LENGTH})\s*x\s*({_LENGTH})", said.get("frame", ""))
    if "illuminant" not in said or frame is None:
        first = "'# illuminant: D50' and '# frame: WIDTH x HEIGHT'"
        raise InputError(
            f"{place}: does not say illuminant and frame; begin with the lines {first}"
        )
    width, height = (float(side) for side in frame.groups())
    table = [(number, line) for number, line in lines if not line.startswith("#")]
    rows = list(csv.DictReader(line for _, line in table))
    if len(rows) != len(table) - 1:
        raise InputError(f"{place}: a line ends within quotes; close them")
    spectral = [name for name in (rows[0] if rows else ()) if re.fullmatch(_LENGTH, name or "")]
    wanted = (*_COLUMNS[:5], *(spectral or _COLUMNS[5:]))
    missing = [name for name in wanted if not rows or name not in rows[0]]
    if missing:
        columns = f"{','.join(_COLUMNS)}, or wavelengths in place of L,a,b"
        raise InputError(f"{place}: no column '{missing[0]}'; name the columns {columns}")
    names, boxes, lab, srgb = [], [], [], []
    for (number, _), row in zip(table[1:], rows, strict=True):
        at = f"{place}: line {number}"
        x0, y0, x1, y1, *colour = _numbers(at, row, wanted[1:])
        if not (0 <= x0 < x1 <= width * 1.0001 and 0 <= y0 < y1 <= height * 1.0001):
            raise InputError(
                f"patch outside the frame of {width:g} x {height:g}",
                at,
                "give x0,y0,x1,y1 in it",
            )
        names.append((row["name"] or str(number)).strip().replace("/", "-"))
        boxes.append((x0 / width, y0 / height, min(x1 / width, 1.0), min(y1 / height, 1.0)))
        lab.append(colour)
        if spectral and not 0 <= min(colour) <= max(colour) <= 1:
            raise InputError(
                f"{at}: a reflectance is outside of 0 to 1; divide percentages by 100"
            )
        if {"R", "G", "B"} <= row.keys() and not spectral:
            srgb.append([value / 255 for value in _numbers(at, row, ("R", "G", "B"))])
    expected = np.array(srgb) if srgb else None
    measured = None
    try:
        if spectral:
            reflectance = on_grid(
                "reflectances", np.array(spectral, dtype=np.float64), np.array(lab)
            )
            adapted, measured = colours(
                reflectance, said["illuminant"], said.get("camera"), Path(place).parent
            )
            expected = measured
        else:
            adapted = lab_d50_from(np.array(lab), said["illuminant"])
    except InputError as fault:
        raise InputError(f"{place}: {fault}") from fault
    return ChartKind(place, _patches(names, boxes, adapted, expected, measured), width, height)


def _numbers(at: str, row: dict[str, str], columns: tuple[str, ...]) -> Iterator[float]:
    for column in columns:
        try:
            value = float(row[column])
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise InputError(
                f"{at}: {column} is '{row[column]}', not a number; write it like 12.5"
            )
        yield value


def _patches(
    names: Sequence[str],
    boxes: Sequence[Box],
    lab: Array,
    srgb: Array | None = None,
    measured: Array | None = None,
) -> tuple[Patch, ...]:
    chromatic = (np.hypot(lab[:, 1], lab[:, 2]) >= _CHROMATIC).tolist()
    listed = (srgb_of_lab_d50(lab) if srgb is None else srgb).tolist()
    spectra = (
        [None] * len(lab)
        if measured is None
        else [tuple(of_one) for of_one in measured.tolist()]
    )
    rows = zip(
        names,
        boxes,
        map(tuple, listed),
        map(tuple, lab.tolist()),
        chromatic,
        spectra,
        strict=True,
    )
    return tuple(Patch(name, number, *row) for number, (name, *row) in enumerate(rows, 1))


_SG = "colorchecker_sg"

# The charts whose tables stand in this file.
KINDS = ("dgk", "colorchecker24")

Triple = tuple[float, float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Patch:
    """One patch of a chart."""

    # As printed on the chart or in its data sheet. Numbers count from 1, row by row.
    name: str
    number: int

    box: Box
    """(x0, y0, x1, y1) in the chart's unit square."""

    srgb: Triple
    """Expected colour, in [0, 1], gamma-encoded."""

    lab: Triple
    """Expected colour, CIE Lab under D50."""

    is_chromatic: bool
    """False for grays."""

    measured: Triple | None = None
    """The colour of its measured reflectance, as `srgb` is given; None where nobody has measured it."""

    @property
    def label(self) -> str:
        """What regions of scores call it: "7-orange"."""
        return f"{self.number}-{self.name}"


def read_label(label: str) -> tuple[int, str]:
    """Return number and name of a patch by its label; 0 for a label without a number."""
    number, dash, name = label.partition("-")
    return (int(number), name) if dash and number.isdecimal() else (0, label)


@dataclass(frozen=True, slots=True)
class ChartKind:
    """A layout and its reference colours."""

    name: str
    patches: tuple[Patch, ...]

    # Of the frame, in any one unit: only the aspect matters.
    width: float
    height: float


def chart_kind(name: str) -> ChartKind:
    """Return the kind of that name, or the one that the CSV file of that path describes.

    Raises InputError, with the nearest name where there is none, and for a file that describes no chart.
    """
    if name in KINDS:
        return _printed(name)
    if name == _SG:
        return colorchecker_sg()
    if name.lower().endswith(".csv"):
        return read_kind(Path(name))
    known = did_you_mean(name, [*KINDS, _SG])
    raise InputError(f"chart kind '{name}': unknown; {known}, or the path of a CSV file")


def kind_id(name: str) -> str:
    """Return what tells one kind from another wherever its file lies: a CSV file's content, else the name."""
    if not name.lower().endswith(".csv"):
        return name
    try:
        content = regular(Path(name)).read_bytes()
        for other in re.findall(
            rb"^#\s*(?:illuminant|camera)\s*:\s*(.+\.csv)\s*$",
            content,
            flags=re.MULTILINE | re.I,
        ):
            content += regular(Path(name).parent / other.decode()).read_bytes()
        return f"csv-{hashlib.blake2b(content, digest_size=6).hexdigest()}"
    except (OSError, ValueError, InputError):
        return "csv-unreadable"


# sRGB list, maker's Lab, and the sRGB under D65 of reflectances that D. Akkaynak's course in underwater colorimetry
# publishes (2025; 400 to 700 nm by 10). Whether the boards of Sea-thru's D5 have these reflectances is not known.
_DGK = (
    ("white", (255, 255, 255), (97, 0, 1), (212, 219, 221)),
    ("light-gray", (176, 180, 183), (73, 0, 0), (121, 139, 135)),
    ("gray", (150, 151, 155), (62, 0, 0), (108, 123, 115)),
    ("middle-gray", (119, 120, 124), (50, 0, 0), (87, 102, 95)),
    ("dark-gray", (88, 89, 91), (38, 0, 0), (73, 82, 76)),
    ("black", (1, 1, 1), (23, 0, 0), (48, 51, 47)),
    ("red", (235, 28, 36), (48, 59, 39), (155, 55, 47)),
    ("yellow", (254, 242, 0), (92, 1, 95), (178, 180, 52)),
    ("green", (106, 189, 71), (64, -40, 54), (67, 144, 62)),
    ("light-blue", (0, 173, 239), (57, -41, -42), (29, 119, 147)),
    ("dark-blue", (1, 27, 84), (18, -3, -25), (39, 74, 88)),
    ("magenta", (239, 2, 142), (49, 60, -3), (126, 37, 72)),
    ("brick", (175, 51, 59), (41, 51, 26), (101, 57, 48)),
    ("orange", (209, 127, 41), (61, 29, 57), (125, 85, 44)),
    ("turquoise", (7, 136, 165), (52, -24, -24), (30, 98, 96)),
    ("purple", (188, 86, 149), (52, 47, -14), (107, 65, 84)),
    ("beige", (200, 159, 139), (69, 14, 17), (105, 94, 68)),
    ("brown", (183, 147, 126), (64, 12, 17), (82, 78, 54)),
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


def _grid(
    name: str,
    table: Sequence[tuple[str, Triple, Triple]] | Sequence[tuple[str, Triple, Triple, Triple]],
    columns: Sequence[tuple[float, float]],
    rows: Sequence[tuple[float, float]],
    size: tuple[float, float],
) -> ChartKind:
    """Lay a table (name, sRGB of 0 to 255, Lab, perhaps sRGB of reflectances) on a grid of (x0, x1) and (y0, y1)."""
    names, srgb, lab, *measured = zip(*table, strict=True)
    boxes = [(x0, y0, x1, y1) for y0, y1 in rows for x0, x1 in columns]
    spectra = np.array(measured[0]) / 255 if measured else None
    return ChartKind(
        name,
        _patches(names, boxes, np.array(lab, np.float64), np.array(srgb) / 255, spectra),
        *size,
    )


@functools.cache
def _printed(name: str) -> ChartKind:
    """The kind of `KINDS` with that name."""
    if name == "dgk":
        return _grid(
            name,
            _DGK,
            # measured on a rectified image
            columns=[(0.045 + 0.157 * k, 0.185 + 0.157 * k) for k in range(6)],
            rows=[(0.05, 0.48), (0.51, 0.71), (0.75, 0.95)],
            size=(6, 4),
        )
    return _grid(
        name,
        _COLORCHECKER,
        # patches of 40 mm, 6 mm apart
        columns=[(46 * k / 270, (46 * k + 40) / 270) for k in range(6)],
        rows=[(46 * k / 178, (46 * k + 40) / 178) for k in range(4)],
        size=(270, 178),
    )
