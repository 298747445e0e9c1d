"""The rows of a study with its comparisons, each computed once for all tables and figures.

`along` follows scores through the values of one option: how much worse with fewer frames, noisier depth, other water.
The value of a row is read from the row's options of dataset, degradation and method, never from labels. Everything is
compared on the images that all methods have at all values. Differences are paired: of a method to itself at the
undegraded value (or the first), and of the methods to a baseline at each value.
"""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import (
    By,
    Cell,
    Column,
    Comparison,
    Note,
    against,
    compare,
    only,
    statistics,
)
from sucre_bench.compare.choose_rows import without_replicates
from sucre_bench.compare.documents import Level, ends_of, fields_of
from sucre_bench.compare.model import NO_DIFFERENCE
from sucre_bench.degrade.options import VIEWS, Degradation, read_water
from sucre_bench.errors import InputError, NotApplicableError, did_you_mean
from sucre_bench.jobs.run_options import Study
from sucre_bench.results.table import is_fresh

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# What a figure's function yields: words for the file's name (may be empty), and the figure, or why there is none.
Drawn: TypeAlias = "tuple[Sequence[str], Figure | NotApplicableError]"


@dataclass(frozen=True)
class StudyResults:
    """What tables and figures are made of."""

    study: Study

    rows: DataFrame
    """In the order that methods are to have."""

    out: Path
    """The results folder."""

    @cached_property
    def comparisons(self) -> list[Comparison]:
        """A table for each dataset: methods by the study's metrics."""
        return self._compare("method")

    @cached_property
    def with_baseline(self) -> list[Comparison]:
        """The same tables against the study's baseline; `comparisons` if it has none."""
        name = self.study.baseline
        return [
            against(table, name) if name in table.methods else table
            for table in self.comparisons
        ]

    @cached_property
    def parts(self) -> list[Comparison]:
        """A table for each view or region, if the study asks for them."""
        return self._compare(self.study.by) if self.study.by != "method" else []

    @cached_property
    def followed(self) -> list[Along]:
        """The scores along the study's option. Raises NotApplicableError if no row has a value of it."""
        return along(self.rows, self.study)

    def _compare(self, by: By) -> list[Comparison]:
        order = list(dict.fromkeys(self.rows["method"]))
        return [
            only(table, self.study.metrics)
            for table in compare(self.rows, self.study.metrics, by, order)
        ]


@dataclass(frozen=True)
class Value:
    """A value of the option."""

    word: str
    """As tables have it."""

    number: float | None
    """None where the value is no number."""

    is_given: bool = True
    """Whether anything is done: False if the option is not given or None."""

    full: str = ""
    """As rows have it."""


@dataclass(frozen=True)
class Along:
    """One dataset's scores along an option."""

    title: str
    option: str

    axis: str
    """What figures call the option."""

    values: tuple[Value, ...]
    """In their natural order."""

    reference: Value
    methods: tuple[str, ...]

    lines: Mapping[tuple[Value, str], str]
    """What tables call a method at a value."""

    scores: Comparison
    """A line a value and method."""

    changes: Comparison | None
    """The lines of `scores` against the same method at `reference`."""

    leads: Comparison | None
    """The lines of `scores` against the baseline at the same value, None without one."""

    @property
    def levels(self) -> list[Level]:
        """A comparison of the methods at each value: ranks and leads are of that value alone."""
        made = []
        for value in self.values:
            names = {self.lines[value, method]: method for method in self.methods}
            cells: dict[tuple[str, Column], Cell] = {}
            for column in self.scores.columns:
                if column not in self.scores.measured:
                    continue
                all_lines = self.scores.measured[column]
                here = [n for n, line in enumerate(all_lines.methods) if line in names]
                part = all_lines.of(here)
                holes = [self.scores.cells[line, column].holes for line in part.methods]
                of_level = statistics.cells(
                    column,
                    part,
                    np.array(holes),
                    self.scores.photographs,
                )
                cells |= {
                    (names[line], column): cell
                    for line, cell in zip(part.methods, of_level, strict=True)
                }
            photographs = tuple(
                names[line] for line in self.scores.photographs if line in names
            )
            table = replace(
                self.scores, methods=self.methods, cells=cells, photographs=photographs
            )
            same = {method: method for method in self.methods}
            made.append(Level(f"{self.option}={value.word}", table, same))
        return made

    @property
    def tables(self) -> dict[str, list[Level]]:
        """By title: the scores at each value, and the differences."""
        tables = {self.title: self.levels}
        for differences in (self.changes, self.leads):
            if differences is None:
                continue
            tables[differences.title] = [
                Level(
                    f"{self.option}={value.word}",
                    differences,
                    {method: self.lines[value, method] for method in self.methods},
                )
                for value in self.values
            ]
        return tables

    def records(self) -> Iterator[dict[str, Any]]:
        """Yield what is known of each value, method and score, for CSV; differences are of the score, in its unit."""
        for (value, method), line in self.lines.items():
            for column in self.scores.columns:
                cell = self.scores.cells.get((line, column))
                if cell is None:
                    continue
                record: dict[str, Any] = {"dataset": self.title, self.option: value.word}
                record |= {
                    "method": method,
                    **fields_of(column, "metric", "variant", "unit", "better"),
                }
                record |= fields_of(cell, "mean", "std", "low", "high", "holes")
                for name, table in (("change", self.changes), ("lead", self.leads)):
                    other = table.cells.get((line, column)) if table else None
                    record |= ends_of(name, other.change if other else NO_DIFFERENCE)
                yield record | fields_of(column, "n_units", "n_views", "n_scenes")


def along(rows: DataFrame, study: Study) -> list[Along]:
    """Group rows by dataset, without the followed option in its label, and tabulate scores per value of the option.

    rows: their order sets the order of methods, and of values that are not numbers.
    Raises NotApplicableError where no row says a value.
    """
    group, _, name = study.along.partition(".")
    options = {text: json.loads(text) for text in rows["options"].unique()}
    of_group = {
        text: each if group == "method" else each.get(group, {})
        for text, each in options.items()
    }
    others = ("dataset", "degrade", "replicate", "name")
    parts = {
        text: {k: v for k, v in part.items() if k not in others}
        for text, part in of_group.items()
    }
    values = {text: _value_in(part, group, name) for text, part in parts.items()}
    if not any(values.values()):
        known = {key for part in parts.values() for key in part}
        raise NotApplicableError(
            f"no {group} here has an option '{name}'; {did_you_mean(name, known)}"
        )
    full: dict[str, set[str]] = {}
    for value in filter(None, values.values()):
        full.setdefault(value.word, set()).add(value.full)
    values = {  # different values have different words
        text: replace(value, word=value.full) if value and len(full[value.word]) > 1 else value
        for text, value in values.items()
    }
    label = "method" if group == "method" else "dataset"
    plain = {
        text: ",".join(part for part in text.split(",") if not part.startswith(f"{name}="))
        for text in rows[label].unique()
    }
    # Degraded copies have other data_ids by design: only outdated rows keep theirs.
    rows = without_replicates(rows.assign(data_id=rows["data_id"].mask(is_fresh(rows), "")))
    rows = rows.assign(_value=rows["options"].map(values), **{label: rows[label].map(plain)})
    lacking = rows.loc[rows["_value"].isna(), label].unique()
    notes = tuple(Note(f"{each} is left out: it has no option {name}") for each in lacking)
    rows = rows[rows["_value"].notna()]
    if (
        group == "dataset"
        and (rows.groupby("_value", sort=False)["scene"].nunique() == 1).all()
    ):
        # The option may be part of a scene's name. So a view is known by its own name alone.
        rows = rows.assign(scene="")
    wanted = {metric.partition(":")[0] for metric in study.metrics}
    followed = []
    for title, of_dataset in rows.groupby("dataset", sort=False):
        scored = {*of_dataset.loc[of_dataset["status"] == "ok", "metric"]}
        if scored and wanted <= scored:
            followed.append(_along(str(title), of_dataset, name, study, notes))
    if not followed:
        raise NotApplicableError(f"no scores of {', '.join(study.metrics) or 'anything'}")
    return followed


def _value_in(part: dict[str, Any], group: str, name: str) -> Value | None:
    """The value of an option; None if dataset or method have no such option. A water's number is its mean attenuation.

    That number is in 1/m. What a degradation does not say has its default.
    """
    value = part.get(name)
    is_given = part.get(name) is not None
    if group == "degrade" and not is_given:
        value = next(f.default for f in fields(Degradation) if f.name == name)
    elif name not in part:
        return None
    full = json.dumps(value)
    if value is None:
        return Value("all" if name in VIEWS else "none", None, False, full)
    if name == "add_water":
        with contextlib.suppress(InputError):  # its file may be gone
            value = float(read_water(value).attenuation.mean())
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return Value(
            f"{value:.4g}" if isinstance(value, float) else str(value),
            float(value),
            is_given,
            full,
        )
    word = "_".join(map(str, value)) if isinstance(value, list) else PurePath(str(value)).name
    return Value(word, None, is_given, full)


def _along(
    title: str, rows: DataFrame, option: str, study: Study, notes: tuple[Note, ...]
) -> Along:
    values: list[Value] = list(rows["_value"].unique())
    if all(value.number is not None for value in values if value.is_given):
        # What is not degraded is without limit; words stay as they came.
        values.sort(key=lambda value: math.inf if value.number is None else value.number)
    methods = tuple(dict.fromkeys(rows["method"]))
    reference = next((value for value in values if not value.is_given), values[0])
    lines = {
        (value, method): f"{option}={value.word} · {method}"
        for value in values
        for method in methods
    }
    named = [lines[key] for key in zip(rows["_value"], rows["method"], strict=True)]
    (scores,) = compare(rows.assign(method=named), study.metrics, order=list(lines.values()))
    scores = only(replace(scores, notes=(*scores.notes, *notes)), study.metrics)
    changes = leads = None
    if len(values) > 1:
        each = [([lines[v, m] for v in values], lines[reference, m]) for m in methods]
        changes = _against(scores, each, f"the same method at {option}={reference.word}")
    if study.baseline in methods:
        each = [([lines[v, m] for m in methods], lines[v, study.baseline]) for v in values]
        leads = _against(scores, each, f"{study.baseline} at the same {option}")
    axis = study.axis or option
    return Along(
        title, option, axis, tuple(values), reference, methods, lines, scores, changes, leads
    )


def _against(
    scores: Comparison, each: Sequence[tuple[Sequence[str], str]], baseline: str
) -> Comparison | None:
    """One table of several, each with its own baseline, which is left out. each: lines, and the baseline's line."""
    cells: dict[tuple[str, Column], Cell] = {}
    for lines, reference in each:
        made = against(scores, reference, lines).cells
        cells |= {
            (line, c): cell
            for (line, c), cell in made.items()
            if line != reference and (reference, c) in made
        }
    known = {part for key in cells for part in key}
    lines = tuple(line for line in scores.methods if line in known)
    kept = tuple(column for column in scores.columns if column in known)
    title = f"{scores.title}, against {baseline}"
    return Comparison(title, lines, kept, cells, baseline=baseline) if cells else None
