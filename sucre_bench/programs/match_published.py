"""Finds the public variant that gives the numbers of a published table: `sucre-bench score IMAGES --like TABLE.csv`.

A table has a row an image, or a row a folder of images of which it gives means, and a column a metric. Every variant of
these metrics is computed on the images, also of the images at 256x256, and compared with the table.
"""

from __future__ import annotations

import csv
import math
import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import image_size
from sucre_bench.machine.files import regular
from sucre_bench.machine.text_formats import counted

# Words that a column is headed by whose cells name images, or folders of them.
_OF_IMAGES = frozenset(["image", "img", "images", "file", "filename", "picture", "view"])
_NAMES = _OF_IMAGES | {"name", "method", "folder", "model"}
_SIZES = ("@256", "@256-bilinear", "@256-nearest")  # at which papers score, see `imaging.resizing`

# A variant gives the published numbers if 95 % of them agree to the printed digits or to 2 in 10,000, and all to 1 %:
# rounding inside a program moves single pictures.
_MOST, _CLOSE, _NEAR = 0.95, 2e-4, 1e-2


@dataclass(frozen=True, slots=True)
class Cell:
    """A published number.

    label: of its row; images: names of the images it is of, or the mean of; rounding: half a unit of its last digit.
    """

    label: str
    images: tuple[str, ...]
    value: float
    rounding: float


@dataclass(frozen=True, slots=True)
class Column:
    """The published numbers of one metric. header: as the table has it."""

    metric: str
    header: str
    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class PublishedTable:
    """What a table says of images that are at hand. warnings: what of it could not be used, a line each."""

    columns: tuple[Column, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Candidate:
    """How far a variant is from a column.

    mean, largest: absolute difference over the cells it has scores for; at: the row of the largest; compared: how many
    cells; lacking: how many it has no score for; fits: whether it gives the published numbers.
    """

    variant: str
    mean: float
    largest: float
    at: str
    compared: int
    lacking: int
    fits: bool


# -- the table ---------------------------------------------------------------------------------------------------


def read_table(table: Path, root: Path, images: Mapping[str, Path], has_reference: bool) -> PublishedTable:
    """Read a published table. images: those under `root`, by name; has_reference: whether references are given.

    Raises InputError if it is no table, has no column of a metric, names no image, or names one image twice.
    """
    rows = _rows(table)
    metrics, warnings = _metrics(table, list(rows[0]), has_reference)
    naming = _Naming(rows, [header for header in rows[0] if header not in metrics], root, images)
    of = [(naming.label(row), naming.images(row), row) for row in rows]
    if not any(found for _, found, _ in of):
        raise InputError(
            f"{table}: names none of the {counted(len(images), 'image')} in {root}, as {next(iter(images))};"
            " give a column 'image' with names of files, or of folders for means"
        )
    alone = Counter(found[0] for _, found, _ in of if len(found) == 1)
    if len(images) > 1 and (twice := [name for name, n in alone.items() if n > 1]):
        raise InputError(
            f"{table}: several rows name {_few(twice)}; keep the rows of these images, or add their folder"
        )
    if unknown := [label for label, found, _ in of if not found]:
        warnings.append(f"{table}: {counted(len(unknown), 'row')} without an image in {root}: {_few(unknown)}")
    if left := [name for name in images if not any(name in found for _, found, _ in of)]:
        warnings.append(f"{table}: {counted(len(left), 'image')} without a row: {_few(left)}")
    columns = []
    for header, metric in metrics.items():
        numbers = [(label, found, _number(row[header])) for label, found, row in of if found]
        if blank := [label for label, _, number in numbers if number is None]:
            warnings.append(f"{table}: column '{header}' has no number in {counted(len(blank), 'row')}: {_few(blank)}")
        if cells := tuple(Cell(label, found, *number) for label, found, number in numbers if number):
            columns.append(Column(metric, header, cells))
    if not columns:
        raise InputError(f"{table}: holds no number for the images in {root}; give the scores as plain numbers")
    return PublishedTable(tuple(columns), tuple(warnings))


def _rows(table: Path) -> list[dict[str, str]]:
    try:
        lines = [line for line in regular(table).read_text(encoding="utf-8-sig").splitlines() if line.strip()]
        delimiter = max(",;\t", key=lines[0].count) if lines else ","
        reader = csv.DictReader(lines, delimiter=delimiter, restkey="", restval="")
        rows = [{key.strip(): row[key].strip() for key in row if key.strip()} for row in reader]
    except OSError as fault:
        raise InputError(f"{table}: cannot be read, {fault.strerror}; give a CSV file of published numbers") from fault
    except (UnicodeDecodeError, csv.Error) as fault:
        raise InputError(f"{table}: is no CSV file in UTF-8; save the table of published numbers as one") from fault
    if not rows:
        raise InputError(f"{table}: has no rows; give a line of headers, then a line an image")
    return rows


def _metrics(table: Path, headers: Sequence[str], has_reference: bool) -> tuple[dict[str, str], list[str]]:
    """Return the metric of each column that is one of images, by header, and warnings about the others."""
    known = plugins.usable("metric")
    metrics: dict[str, str] = {}
    warnings = []
    for header in headers:
        for name in set(re.findall(r"[a-z0-9_]+", header.lower())) & set(known):
            lacking = known[name].needs - ({"reference"} if has_reference else set())
            if not lacking:
                metrics[header] = name
                continue
            remedy = "give --reference" if lacking == {"reference"} else "images alone do not have it"
            warnings.append(f"{table}: column '{header}' needs {' and '.join(sorted(lacking))}; {remedy}")
    if not metrics:
        possible = ", ".join(sorted(name for name, plugin in known.items() if plugin.needs <= {"reference"}))
        none = f"{table}: no column is a metric, of {', '.join(headers)}; name them as here: {possible}"
        raise InputError(warnings[0] if warnings else none)
    return metrics, warnings


def _number(text: str) -> tuple[float, float] | None:
    """Return the number a cell begins with, and half a unit of its last digit; None if it begins with none."""
    found = re.match(r"[+-]?\d+([.,]\d+)?([eE][+-]?\d+)?", text.replace("\N{MINUS SIGN}", "-"))
    if not found:
        return None
    try:
        number = Decimal(found[0].replace(",", "."))
        value, rounding = float(number), 0.5 * 10.0 ** int(number.as_tuple().exponent)
    except ArithmeticError:  # of thousands of digits
        return None
    return (value, rounding) if math.isfinite(value) else None


class _Naming:
    """Finds the images that a row is of, by what its cells call the images or their folders."""

    def __init__(self, rows: Sequence[Mapping[str, str]], headers: Sequence[str], root: Path, images: Iterable[str]):
        self._files, self._folders = defaultdict[str, set[str]](set), defaultdict[str, set[str]](set)
        for name in images:
            path = Path(name)
            for called in (name, path.with_suffix(""), path.name, path.stem, f"{root.resolve().name}/{name}"):
                self._files[str(called).casefold()].add(name)
            for folder in (*path.parent.parts, str(path.parent), root.resolve().name):
                self._folders[folder.casefold()].add(name)
        known = {*self._files, *self._folders}
        words = {header: set(re.findall(r"[a-z]+", header.lower())) for header in headers}
        likely = [header for header in headers if _NAMES & words[header]] or headers
        self._headers = [header for header in likely if any(row[header].casefold() in known for row in rows)]
        is_of_all = len(rows) == 1 and not any(_OF_IMAGES & words[header] for header in headers)
        self._order = tuple(images) if self._headers or is_of_all else ()

    def label(self, row: Mapping[str, str]) -> str:
        """Return how to call a row."""
        return "/".join(row[header] for header in self._headers) or "the only row"

    def images(self, row: Mapping[str, str]) -> tuple[str, ...]:
        """Return the image a row is of, or all of the folder that it names; none if it names none, or several."""
        cells = [row[header].casefold() for header in self._headers]
        if not cells:
            return self._order
        fitting = set.intersection(*(self._files.get(c, set()) | self._folders.get(c, set()) for c in cells))
        of_one = any(fitting & self._files.get(cell, set()) for cell in cells)
        return tuple(name for name in self._order if name in fitting) if len(fitting) == 1 or not of_one else ()


def _few(names: Sequence[str]) -> str:
    return ", ".join(names[:3]) + (", ..." if len(names) > 3 else "")


# -- the comparison ----------------------------------------------------------------------------------------------


def variants_to_try(table: PublishedTable, images: Mapping[str, Path]) -> list[str]:
    """Return every variant of the table's metrics, as `score_folder` takes them.

    Also at the sizes that papers use, if any image has another.
    """
    sizes = {image_size(path) for path in images.values()}
    at = ("",) if sizes == {(256, 256)} else ("", *_SIZES)
    return [f"{metric}:all{size}" for metric in dict.fromkeys(c.metric for c in table.columns) for size in at]


def compare(column: Column, scores: DataFrame) -> list[Candidate]:
    """Return how far each variant is from a column, the nearest first. scores: rows of a score table.

    Images that no variant has a score of, as those that cannot be read, are left out.
    """
    ok = scores[(scores["metric"] == column.metric) & (scores["status"] == "ok") & (scores["region"] == "image")]
    known = [cell for cell in column.cells if set(ok["view"]).issuperset(cell.images)]
    candidates = []
    for variant, rows in ok.groupby("variant", sort=False):
        values = dict(zip(rows["view"], rows["value"], strict=True))
        cells = [cell for cell in known if all(name in values for name in cell.images)]
        lacking, largest, at, mean, fits = len(known) - len(cells), np.inf, "", np.inf, False
        if cells:
            computed = np.array([np.mean([values[name] for name in cell.images]) for cell in cells])
            published = np.array([cell.value for cell in cells])
            off = np.abs(computed - published)
            off[computed == published] = 0  # both infinite
            close = off <= np.maximum([1.01 * cell.rounding for cell in cells], _CLOSE * np.abs(published))
            near = close | (off <= _NEAR * np.abs(published))
            mean, largest, at = float(off.mean()), float(off.max()), cells[int(off.argmax())].label
            fits = bool(not lacking and close.mean() >= _MOST and near.all())
        candidates.append(Candidate(str(variant), mean, largest, at, len(cells), lacking, fits))
    return sorted(candidates, key=lambda c: (not c.fits, c.lacking, c.mean))
