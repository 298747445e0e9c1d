"""Finds the public variant that gives the numbers of a published table: `sucre-bench score IMAGES --like TABLE.csv`.

A table, CSV or Markdown, has a row an image, or a row a folder of images of which it gives means, and a column a
metric; or rows and columns the other way round. A header "PSNR/SSIM" has two numbers a cell. "psnr=26.36" is a table of
one mean. Every variant of these metrics is computed on the images, also of the images at 256x256, and compared with the
table. Where none fits, also of cropped pictures, of Y, and of other ranges.
"""

import csv
import math
import re
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import groupby
from pathlib import Path

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame, Size
from sucre_bench.errors import InputError
from sucre_bench.imaging.resizing import split_variant
from sucre_bench.loading.find_folders import bare_stems, without_suffix, without_zeros
from sucre_bench.loading.named_sets import Found
from sucre_bench.machine.files import reading, regular
from sucre_bench.machine.text_formats import counted, first_few

Cells = Mapping[str, str]  # of a row, by header

# Words that a column is headed by whose cells name images, or folders of them.
_OF_IMAGES = frozenset(["image", "img", "images", "file", "filename", "picture", "view"])
_NAMES = _OF_IMAGES | {"name", "method", "folder", "model"}
_SHOWN = 3  # names in a warning
_SIDE = 256  # at which papers score
_FILTERS = ("", "-bilinear", "-nearest")  # see `imaging.resizing`
# forms to try where none of the usual ones fits
_FURTHER = (
    "@y",
    "@crop4",
    "@crop4@y",
    "@range2",
    "@minmax",
)
# A variant gives the published numbers if 95 % of them agree to the printed digits or to 2 in 10,000, and all to 1 %:
# rounding inside a program moves single pictures.
_MOST = 0.95
_CLOSE = 2e-4
_NEAR = 1e-2


@dataclass(frozen=True, slots=True)
class Cell:
    """A published number."""

    label: str
    """Of its row."""

    images: tuple[str, ...]
    """Names of the images that it is of, or that it is the mean of."""

    value: float

    rounding: float
    """Half a unit of its last digit."""


@dataclass(frozen=True, slots=True)
class Column:
    """The published numbers of one metric."""

    metric: str

    header: str
    """As the table has it."""

    cells: tuple[Cell, ...]


@dataclass(frozen=True, slots=True)
class PublishedTable:
    """What a table says of images that are at hand."""

    columns: tuple[Column, ...]

    warnings: tuple[str, ...]
    """What of it could not be used, a line each."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """How far a variant is from a column."""

    variant: str

    lacking: int
    """How many cells it has no score for."""

    compared: int = 0
    """How many cells it has a score for."""

    value: float = math.nan
    """Its mean over the compared cells."""

    # The absolute difference over the compared cells.
    mean: float = math.inf
    largest: float = math.inf

    at: str = ""
    """The row of the largest difference."""

    fits: bool = False
    """Whether it gives the published numbers."""


# -- the table ---------------------------------------------------------------------------------------------------


def read_table(
    table: str, root: Path, images: Mapping[str, Path], has_reference: bool
) -> PublishedTable:
    """Read a published table, or numbers as "psnr=26.36,ssim=0.912".

    images: those under `root`, by name; has_reference: whether references are given.
    Raises InputError if it is no table, has no column of a metric, names no image, or names one image twice.
    """
    rows = _rows(table)
    named = {header: _named(header) for header in rows[0]}
    others = [header for header in named if not named[header]]
    headers, images_of = _naming(rows, others, root, images)
    of = [
        ("/".join(row[header] for header in headers) or "the only row", images_of(row), row)
        for row in rows
    ]
    warnings = list[str]()

    def warn(names: Sequence[str], noun: str, after: str = "", before: str = "") -> None:
        if names:
            which = f"{before}{counted(len(names), noun)}{after}: {first_few(names, _SHOWN)}"
            warnings.append(f"{table}: {which}")

    found = {name for _, names, _ in of for name in names}
    if not found:
        raise InputError(
            f"{table}: names none of the {counted(len(images), 'image')} in {root}, as {next(iter(images))};"
            " give a column 'image' with names of files, or of folders for means"
        )
    columns = list(_columns(table, named, of, has_reference, warnings))
    unread = [one for one in others if one not in headers and _number(rows[0][one])]
    if unread:
        warnings.append(f"{table}: not read, since no metric here: {first_few(unread, _SHOWN)}")
    alone = Counter(names[0] for _, names, _ in of if len(names) == 1)
    if len(images) > 1 and (twice := [name for name, n in alone.items() if n > 1]):
        fault = f"several rows name {first_few(twice, _SHOWN)}"
        raise InputError(fault, table, "keep one of each, or add their folder")
    warn([label for label, names, _ in of if not names], "row", f" without an image in {root}")
    warn([name for name in images if name not in found], "image", " without a row")
    for column in columns:
        known = {cell.label for cell in column.cells}
        blank = [label for label, names, _ in of if names and label not in known]
        warn(blank, "row", before=f"column '{column.header}' has no number in ")
    columns = [column for column in columns if column.cells]
    if not columns:
        raise InputError(
            f"{table}: holds no number for the images in {root}; give the scores as plain numbers"
        )
    return PublishedTable(tuple(columns), tuple(warnings))


def _columns(
    table: str,
    named: Mapping[str, Sequence[str]],
    rows: Sequence[tuple[str, tuple[str, ...], Cells]],
    has_reference: bool,
    warnings: list[str],
) -> Iterator[Column]:
    """Yield the numbers of each metric. named: the metrics that headers name; rows: label, images and cells.

    warnings: are added to where one is read as percent, or cannot be compared. Raises InputError if there is none.
    """
    known = plugins.usable("metric")
    has = {"reference"} if has_reference else set()
    is_none = True
    places = [(header, n) for header, names in named.items() for n in range(len(names))]
    for header, place in places:
        metric = named[header][place]
        if lacking := known[metric].needs - has:
            remedy = (
                "give --reference"
                if lacking == {"reference"}
                else "images alone do not have it"
            )
            warnings.append(
                f"{table}: column '{header}' needs {' and '.join(sorted(lacking))}; {remedy}"
            )
            continue
        is_none = False
        factor = 1.0
        numbers = [
            (label, images, _number(_part(row[header], place, len(named[header]))))
            for label, images, row in rows
            if images
        ]
        values = [number[0] for *_, number in numbers if number]
        top = known[metric].range[1]
        if values and math.isfinite(top) and top < min(values) and max(values) <= 100 * top:
            warnings.append(
                f"{table}: column '{header}' is read as percent; divide it by 100 if you copy it"
            )
            factor = 0.01
        cells = tuple(
            Cell(label, images, factor * number[0], factor * number[1])
            for label, images, number in numbers
            if number
        )
        yield Column(metric, header, cells)
    if is_none:
        possible = sorted(
            name for name, plugin in known.items() if plugin.needs <= {"reference"}
        )
        names = f"of {', '.join(named)}; name them as here: {', '.join(possible)}"
        raise InputError(
            warnings[0] if warnings else f"{table}: no column is a metric, {names}"
        )


def _rows(table: str) -> list[Cells]:
    if "=" in table and not Path(table).exists():
        pairs = [
            word.partition("=") for word in re.split(r"[,;\s]\s*(?=[a-zA-Z])", table.strip())
        ]
        return [{name.strip(): value.strip() for name, _, value in pairs}]
    with reading(
        Path(table), "give a table of published numbers, CSV, Markdown or LaTeX, in UTF-8"
    ):
        text = regular(Path(table)).read_text(encoding="utf-8-sig")
        lines = [line.strip() for line in text.splitlines() if line.strip()]
        if r"\\" in text:  # LaTeX
            cells = (line.split(r"\\")[0] for line in lines if "&" in line)
            lines = ["|" + re.sub(r"(?<!\\)&", "|", _plain(row)) for row in cells]
        blocks = [
            [*block]
            for is_block, block in groupby(lines, key=lambda line: line.startswith("|"))
            if is_block
        ]
        tables = [_read(block, "|") for block in blocks]
        if lines and not blocks:
            tables = [_read(lines, max(",;\t", key=lines[0].count))]
    forms = [form for rows in tables if rows for form in (rows, _turned(rows))]
    if not forms:
        raise InputError(f"{table}: has no rows; give a line of headers, then a line an image")
    for rows in forms:
        if any(_number(row[header]) for row in rows for header in row if _named(header)):
            return rows
    return forms[0]


def _plain(latex: str) -> str:
    """LaTeX's text without commands: "PSNR$\\uparrow$" and "\\textbf{26.4}" are "PSNR" and "26.4"."""
    return (
        re.sub(r"\\[a-zA-Z]+\*?|(?<!\\)[{}$]", "", latex)
        .replace(r"\_", "_")
        .replace(r"\%", "%")
    )


def _read(lines: Sequence[str], delimiter: str) -> list[Cells]:
    """The rows of a table, with their cells by header. Of Markdown's, the line below the headers is left out."""
    if delimiter == "|":
        lines = [line.strip("|") for line in lines if set(line) - set("|:- ")]
    reader = csv.DictReader(lines, delimiter=delimiter, restkey="", restval="")
    return [
        {key.strip(" *`"): row[key].strip(" *`") for key in row if key.strip()}
        for row in reader
    ]


def _turned(rows: Sequence[Cells]) -> list[Cells]:
    """A table with rows and columns exchanged: the first column's cells become the headers."""
    first, *others = rows[0]
    return [{first: header} | {row[first]: row[header] for row in rows} for header in others]


def _named(header: str) -> list[str]:
    """The metrics that a header names, in order: whole words, or their parts between "_"."""
    known = plugins.usable("metric")
    words: list[str] = []
    for word in re.findall(r"[a-z0-9_]+", header.lower()):
        words += [word] if word in known else word.split("_")
    return [word for word in dict.fromkeys(words) if word in known]


def _part(cell: str, place: int, n: int) -> str:
    """One of the n numbers of a cell, "23.1/0.87" or "23.1 (0.87)"; empty if it has another number of them."""
    if n == 1:
        return cell
    cell = re.sub(r"(±|\+/?-)\s*[\d.,]+", "", cell).strip()
    for separator in (r"[/|;(&]", r",\s+|\s+|,(?=\d*\.)"):
        if len(parts := re.split(separator, cell)) == n:
            return parts[place].strip()
    return ""


def _number(text: str) -> tuple[float, float] | None:
    """Return the number a cell begins with, and half a unit of its last digit; None if it begins with none.

    A percent sign divides by 100.
    """
    found = re.match(
        r"([+-]?\d*(?:[.,]\d+|\d)(?:[eE][+-]?\d+)?)\s*(%?)", text.replace("\N{MINUS SIGN}", "-")
    )
    if not found:
        return None
    try:
        number = Decimal(found[1].replace(",", ".")).scaleb(-2 if found[2] else 0)
        value = float(number)
        rounding = 0.5 * 10.0 ** int(number.as_tuple().exponent)
    except ArithmeticError:  # of thousands of digits
        return None
    return (value, rounding) if math.isfinite(value) else None


def _naming(
    rows: Sequence[Cells], headers: Sequence[str], root: Path, images: Iterable[str]
) -> tuple[Sequence[str], Callable[[Cells], tuple[str, ...]]]:
    """Return the headers of the cells that name images or their folders, and what finds the images of a row.

    These are one image, or all of the folder that the row names; none if it names none, or several.
    """
    order = tuple(images)
    files: dict[str, set[str]] = defaultdict(set)
    folders: dict[str, set[str]] = defaultdict(set)
    bare = bare_stems(order)
    for name in order:
        path = Path(name)
        files[name.casefold()].add(name)
        for called in (name, path.name, f"{root.resolve().name}/{name}", bare[name]):
            files[_key(called)].add(name)
        files[without_zeros(bare[name])].add(name)
        for folder in (*path.parent.parts, str(path.parent), root.resolve().name):
            folders[folder.casefold()].add(name)
    known = {*files, *folders}
    words = {header: set(re.findall(r"[a-z]+", header.lower())) for header in headers}
    likely = [header for header in headers if _NAMES & words[header]] or headers
    naming = [
        header
        for header in likely
        if any(known.intersection(_keys(row[header])) for row in rows)
    ]
    is_of_all = len(rows) == 1 and not any(_OF_IMAGES & words[header] for header in headers)

    def images_of(row: Cells) -> tuple[str, ...]:
        if not naming:
            return order if is_of_all else ()
        # Of each cell the images, and those of the folders, by its whole text, else by its last part.
        keys = [next((key for key in _keys(row[h]) if key in known), "") for h in naming]
        fitting = set.intersection(*(files[key] | folders[key] for key in keys))
        is_clear = len(fitting) == 1 or not any(fitting & files[key] for key in keys)
        return tuple(name for name in order if name in fitting) if is_clear else ()

    return naming, images_of


def _key(name: str) -> str:
    """A name in small letters, without an image's suffix, its folders parted by a slash."""
    folder, slash, last = name.replace("\\", "/").rpartition("/")
    return f"{folder}{slash}{without_suffix(last) if last else ''}".casefold()


def _keys(cell: str) -> tuple[str, ...]:
    last = _key(cell).rpartition("/")[2]
    return cell.casefold(), _key(cell), last, without_zeros(last)


# -- the comparison ----------------------------------------------------------------------------------------------


def search(
    table: PublishedTable,
    sizes: set[Size | None],
    score: Callable[[Sequence[str]], DataFrame],
) -> DataFrame:
    """Return score rows of variants, tried until each column has one that fits.

    First PSNR, which is quick, then the others at the sizes that fit it: one program made all numbers. Then all, then
    unusual forms. sizes: (width, height) of images and references; they are also scored at the sizes that papers use,
    if any has another. score: returns the rows of variants, named as `score_folder` takes them.
    """
    import pandas as pd

    metrics = dict.fromkeys(column.metric for column in table.columns)
    at = _at(sizes)
    names = [f"{name}{size}" for size in at for metric in metrics for name in _variants(metric)]
    tried = [name for name in names if name.startswith("psnr:")] or names
    scores = score(tried)
    for stage in ("at the fitting sizes", "all", "unusual"):
        found = [(column.metric, compare(column, scores)) for column in table.columns]
        fitting = {_size_of(one.variant) for _, several in found for one in several if one.fits}
        more = list[str]()
        for metric, several in found:
            if several and several[0].fits:
                continue
            of_metric = [name for name in names if name.partition(":")[0] == metric]
            if stage == "at the fitting sizes":
                of_metric = [name for name in of_metric if _size_of(name) in fitting]
            elif stage == "unusual":
                bases = _nearest_bases(metric, several)
                of_metric = [
                    f"{b}{size}{form}" for b in bases for size in at for form in _FURTHER
                ]
            more += [name for name in of_metric if name not in tried]
        if more:
            tried = [*tried, *more]
            new = score(more)
            of_whole = new[~new["view"].isin(new.loc[new["status"] != "ok", "view"])]
            scores = pd.concat([scores, of_whole], ignore_index=True)
    return scores


def _variants(metric: str) -> list[str]:
    """The variants that differ on pictures without holes: of "masked" and "unmasked" the second."""
    variants = plugins.usable("metric")[metric].variants
    whole = {name for name in variants if name.endswith("unmasked")}
    twins = {name.removesuffix("-unmasked") for name in whole}
    if whole:
        twins |= {"masked", "raw"}
    return [f"{metric}:{name}" for name in variants if name in whole or name not in twins]


def _nearest_bases(metric: str, found: Sequence[Candidate]) -> list[str]:
    """The variants of every pixel of which unusual forms are tried: those of the two nearest, or else all."""
    plugin = plugins.usable("metric")[metric]
    if "reference" not in plugin.needs:
        return []
    whole = [name for name in plugin.variants if name.endswith("unmasked")]
    near = {one.variant.partition("@")[0].removesuffix("-unmasked") for one in found[:2]}
    bases = [name for name in whole if name.removesuffix("-unmasked") in near] or whole
    return [f"{metric}:{name}" for name in bases]


def _size_of(name: str) -> str:
    """The size that a variant scores at: "@256-bilinear"; "" for the files' own."""
    base, *words = name.rpartition(":")[2].split("@")
    own = f"@{_SIDE}" if base in ("gray", "funie") else ""
    return next((f"@{word}" for word in words if word[0].isdigit()), own)


def _at(sizes: set[Size | None]) -> list[str]:
    """The sizes to score at: as the files are, and squares of 256 pixels or of the files' side."""
    squares = {size[0] for size in sizes if size and size[0] == size[1] and len(sizes) <= 2}
    if len(sizes) == 1 and squares == {_SIDE}:
        return [""]
    return ["", *(f"@{side}{by}" for side in sorted({_SIDE} | squares) for by in _FILTERS)]


def compare(column: Column, scores: DataFrame) -> list[Candidate]:
    """Return how far each variant is from a column, the nearest first. scores: rows of a score table.

    Images that no variant has a score of, as those that cannot be read, are left out, also of means.
    """
    is_of_column = (scores["metric"] == column.metric) & (scores["region"] == "image")
    ok = scores[is_of_column & (scores["status"] == "ok")]
    values = ok.pivot(index="view", columns="variant", values="value")
    values = values[ok["variant"].unique()]
    of_scored = [
        replace(cell, images=tuple(name for name in cell.images if name in values.index))
        for cell in column.cells
    ]
    known = [cell for cell in of_scored if cell.images]
    published, rounding = (
        np.array([(cell.value, cell.rounding) for cell in known]).reshape(-1, 2).T
    )
    candidates = []
    for variant, of_views in values.items():
        computed = np.array([of_views[list(cell.images)].mean(skipna=False) for cell in known])
        there = np.flatnonzero(~np.isnan(computed))
        candidate = Candidate(str(variant), lacking=len(known) - len(there))
        if len(there):
            off = np.abs(computed - published)[there]
            off[computed[there] == published[there]] = 0  # both infinite
            size = np.abs(published[there])
            close = off <= np.maximum(1.01 * rounding[there], _CLOSE * size)
            near = close | (off <= _NEAR * size)
            candidate = replace(
                candidate,
                compared=len(there),
                value=float(computed[there].mean()),
                mean=float(off.mean()),
                largest=float(off.max()),
                at=known[there[off.argmax()]].label,
                fits=bool(not candidate.lacking and close.mean() >= _MOST and near.all()),
            )
        candidates.append(candidate)
    return sorted(
        candidates,
        key=lambda one: (not one.fits, one.fits and _is_rare(one), one.lacking, one.mean),
    )


def _is_rare(one: Candidate) -> bool:
    """Whether a variant is unusual: among many of these one may give one or two numbers by chance."""
    return any(form in one.variant for form in (*_FURTHER, "wrapped"))


# -- the answer in words -----------------------------------------------------------------------------------------


def answer(
    column: Column, found: Sequence[Candidate], sets: Sequence[Found], size: Size | None
) -> str:
    """Return which variant gives the published numbers, on which set, and what colour gives where they are of gray.

    found: as `compare` returns them; sets: of the references; size: of all files, None if they differ.
    """
    if not found:
        return f"{column.metric}: no variant has a score of these images."
    numbers = [cell.value for cell in column.cells]
    digits = max(0, -math.floor(math.log10(2 * column.cells[0].rounding)))
    best = found[0]
    what = in_words(column.metric, best.variant, size)
    where = f"on {sets[0].place()}" if sets else "on pictures of no named set"
    yours = f"Your {len(numbers)} numbers of '{column.header}' are"
    if len(numbers) == 1:
        yours = f"Your {numbers[0]:.{digits}f} is"
    if best.fits:
        also = [in_words(column.metric, one.variant, size) for one in found[1:3] if one.fits]
        either = f", or {', or '.join(also)}," if also else ""
        text = f"{yours} {what}{either} {where}"
        if _is_rare(best) and len(numbers) < 3:
            text += ", perhaps by chance, as many forms were tried"
    else:
        off = f"{best.mean:.2g} away on average, and {best.largest:.2g} at most"
        text = f"{yours} of no public form; the nearest is {what} {where}: {off}"
    base, at, form = best.variant.partition("@")
    if base.partition("-")[0] in ("gray", "luma"):
        # the variant "gray" resizes by itself
        forms = [f"{at}{form}"] if at else ["@256", ""]
        names = [f"{name}{one}" for name in ("unmasked", "gaussian-unmasked") for one in forms]
        rgb = next((one for one in found if one.variant in names), None)
        if rgb:
            text += f"; in RGB it is {rgb.value:.{digits}f}"
    return f"{text}."


def in_words(metric: str, variant: str, size: Size | None) -> str:
    """Return what a variant is: "gray PSNR at 256x256 (psnr:gray@256)". size: of all files, None if they differ."""
    base, form = split_variant(variant)
    name = metric.upper()
    if metric in ("psnr", "ssim"):
        colours = "gray" if base.partition("-")[0] in ("gray", "luma") else "RGB"
        if form and form.change == "y":
            colours = "Y"
        name = f"{colours} {name}"
    if form and form.resizing:
        size = (form.resizing.side, form.resizing.side)
    elif (metric, base) == ("psnr", "gray"):
        size = (_SIDE, _SIDE)
    at = f"{size[0]}x{size[1]}" if size else "the files' sizes"
    return f"{name} at {at} ({metric}:{variant})"
