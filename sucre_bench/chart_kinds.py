"""Kinds of colour charts beyond the two that `sucre_bench.charts` lists: the ColorChecker SG, and anyone's own.

A chart of your own is a CSV file, named as the chart's kind by its path:

    # illuminant: D65
    # frame: 120 x 80
    name,x0,y0,x1,y1,L,a,b
    white,2,2,18,18,96.5,-0.4,1.2

frame: width x height of what the four corners are the corners of, in any unit; x0, y0, x1, y1: a patch's left, top,
right and bottom edge in that unit, from the frame's top left; L, a, b: CIE Lab under the illuminant (one of CIE's, 2
degree observer), brought to D50 by Bradford's adaptation. Columns R, G, B, 0 to 255, may give the expected sRGB; else
it is the Lab's, clipped. Patches are numbered as they are listed; those of a chroma of 5 or more count as colours.

The ColorChecker Digital SG is given in the maker's values of charts made after November 2014, as colour-science has
them. Its corners are the outer corners of the four corner patches, A1, N1, N10, A10; patches are taken
as 7/8 of their pitch, like the Classic's, of which only the inner half is read.
"""

from __future__ import annotations

import csv
import functools
import math
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sucre_bench.charts import ChartKind, Patch, Triple
from sucre_bench.cielab import colour_science, lab_d50_from, srgb_of_lab_d50
from sucre_bench.errors import InputError, one_line
from sucre_bench.scene import Array

__all__ = ["colorchecker_sg", "read_kind"]

_CHROMATIC = 5.0  # chroma in Lab: the "neutral" patches of sold charts stay below 2, their dark skin is at 19
_LENGTH = r"\d+\.?\d*|\.\d+"
_COLUMNS = ("name", "x0", "y0", "x1", "y1", "L", "a", "b")


@functools.cache
def colorchecker_sg() -> ChartKind:
    """Return the ColorChecker Digital SG: 14 columns A to N, 10 rows, numbered row by row."""
    colour = colour_science()
    published = colour.CCS_COLOURCHECKERS["ColorCheckerSG - After November 2014"]
    lab = colour.XYZ_to_Lab(colour.xyY_to_XYZ(np.array(list(published.data.values()))), published.illuminant)
    width, height = 14 - 1 / 8, 10 - 1 / 8  # in pitches
    boxes = [(x / width, y / height, (x + 7 / 8) / width, (y + 7 / 8) / height) for y in range(10) for x in range(14)]
    return ChartKind("colorchecker_sg", _patches(list(published.data), boxes, lab), width, height)


def read_kind(path: Path) -> ChartKind:
    """Return the kind that a CSV file describes, see above. Raises InputError naming the line that is wrong."""
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of the CSV file that describes the chart")
    try:
        return _parsed(str(path), path.read_text(encoding="utf-8-sig"))
    except (OSError, UnicodeDecodeError, csv.Error) as fault:
        raise InputError(
            f"{path}: the chart's description cannot be read, {one_line(fault)}; correct its path"
        ) from fault


@functools.lru_cache(maxsize=32)  # asked for with every chart that is measured
def _parsed(place: str, text: str) -> ChartKind:
    lines = [(number, line.strip()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    said = dict(re.findall(r"^#\s*(\w+)\s*:\s*(.+?)\s*$", text, flags=re.MULTILINE))
    frame = re.fullmatch(rf"({_LENGTH})\s*x\s*({_LENGTH})", said.get("frame", ""))
    if "illuminant" not in said or frame is None:
        first = "'# illuminant: D50' and '# frame: WIDTH x HEIGHT'"
        raise InputError(f"{place}: does not say illuminant and frame; begin with the lines {first}")
    width, height = (float(side) for side in frame.groups())
    table = [(number, line) for number, line in lines if not line.startswith("#")]
    rows = list(csv.DictReader(line for _, line in table))
    if len(rows) != len(table) - 1:
        raise InputError(f"{place}: a line ends within quotes; close them")
    missing = [name for name in _COLUMNS if not rows or name not in rows[0]]
    if missing:
        raise InputError(f"{place}: no column '{missing[0]}'; name the columns {','.join(_COLUMNS)}")
    names, boxes, lab, srgb = [], [], [], []
    for (number, _), row in zip(table[1:], rows, strict=True):
        at = f"{place}: line {number}"
        x0, y0, x1, y1, *own = _numbers(at, row, _COLUMNS[1:])
        if not (0 <= x0 < x1 <= width * 1.0001 and 0 <= y0 < y1 <= height * 1.0001):
            raise InputError(
                f"{at}: the patch is not inside the frame of {width:g} x {height:g}; give x0,y0,x1,y1 in it"
            )
        names.append((row["name"] or str(number)).strip().replace("/", "-"))
        boxes.append((x0 / width, y0 / height, min(x1 / width, 1.0), min(y1 / height, 1.0)))
        lab.append(own)
        if {"R", "G", "B"} <= row.keys():
            srgb.append([value / 255 for value in _numbers(at, row, ("R", "G", "B"))])
    try:
        adapted = lab_d50_from(np.array(lab), said["illuminant"])
    except InputError as fault:
        raise InputError(f"{place}: {fault}") from fault
    return ChartKind(place, _patches(names, boxes, adapted, np.array(srgb) if srgb else None), width, height)


def _numbers(at: str, row: dict[str, str], columns: tuple[str, ...]) -> Iterator[float]:
    for column in columns:
        try:
            value = float(row[column])
        except (TypeError, ValueError):
            value = math.nan
        if not math.isfinite(value):
            raise InputError(f"{at}: {column} is '{row[column]}', not a number; write it like 12.5")
        yield value


def _patches(
    names: list[str], boxes: list[tuple[float, float, float, float]], lab: Array, srgb: Array | None = None
) -> tuple[Patch, ...]:
    srgb = srgb_of_lab_d50(lab) if srgb is None else srgb
    chromatic = np.hypot(lab[:, 1], lab[:, 2]) >= _CHROMATIC
    rows = zip(names, boxes, srgb, lab, chromatic, strict=True)
    return tuple(
        Patch(name, number, box, _triple(rgb), _triple(Lab), bool(colour))
        for number, (name, box, rgb, Lab, colour) in enumerate(rows, 1)
    )


def _triple(values: Array) -> Triple:
    one, two, three = (float(value) for value in values)
    return one, two, three
