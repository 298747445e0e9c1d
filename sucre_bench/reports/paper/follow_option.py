"""Scores followed through the values of one option: how much worse with fewer frames, noisier depth, other water.

The value of a row is read from the row's options of dataset, degradation and method, never from labels. Everything
is compared on the images that all methods have at all values. Differences are paired: of a method to itself at the
undegraded value (or the first), and of the methods to a baseline at each value.
"""

import contextlib
import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import PurePath
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Cell, Column, Comparison, Note, against, compare, only
from sucre_bench.compare.compare_rows import without_replicates
from sucre_bench.degrade.options import VIEWS, Degradation, read_water
from sucre_bench.errors import InputError, NotApplicableError, did_you_mean
from sucre_bench.jobs.run_options import Study
from sucre_bench.results.table import is_fresh


@dataclass(frozen=True)
class Value:
    """A value of the option.

    word: as tables have it; number: None where it is none; is_given: whether anything is done; full: as rows say it.
    """

    word: str
    number: float | None
    is_given: bool = True
    full: str = ""


@dataclass(frozen=True)
class Along:
    """One dataset's scores along an option.

    axis: what figures call the option; values: in their natural order; scores: a line a value and method, see `line`;
    changes: the same lines against the same method at `reference`; leads: the same lines against the baseline at the
    same value, None without one.
    """

    title: str
    option: str
    axis: str
    values: tuple[Value, ...]
    reference: Value
    methods: tuple[str, ...]
    scores: Comparison
    changes: Comparison | None
    leads: Comparison | None

    @property
    def comparisons(self) -> list[Comparison]:
        """The tables there are."""
        return [table for table in (self.scores, self.changes, self.leads) if table is not None]

    def line(self, value: Value, method: str) -> str:
        """What the tables call a method at a value."""
        return _line(self.option, value, method)


def _line(option: str, value: Value, method: str) -> str:
    return f"{option}={value.word} · {method}"


def along(rows: DataFrame, study: Study) -> list[Along]:
    """Group rows by dataset, without the followed option in its label, and tabulate scores per value of the option.

    rows: their order sets the order of methods, and of values that are not numbers.
    Raises NotApplicableError where no row says a value.
    """
    group, _, name = study.along.partition(".")
    values_of = _with_distinct_words(
        {text: _value_in(json.loads(text), group, name) for text in rows["options"].unique()}
    )
    if not any(values_of.values()):
        known = {key for text in values_of for key in _part(json.loads(text), group)}
        raise NotApplicableError(f"no {group} here has an option '{name}'; {did_you_mean(name, known)}")
    label = "method" if group == "method" else "dataset"
    plain = {text: _without(text, name) for text in rows[label].unique()}
    # Degraded copies have other data_ids by design: only outdated rows keep theirs.
    rows = without_replicates(rows.assign(data_id=rows["data_id"].mask(is_fresh(rows), "")))
    rows = rows.assign(_value=rows["options"].map(values_of), **{label: rows[label].map(plain)})
    lacking = rows.loc[rows["_value"].isna(), label].unique()
    notes = tuple(Note("no option", (str(each),), option=name) for each in lacking)
    rows = rows[rows["_value"].notna()]
    if group == "dataset" and (rows.groupby("_value", sort=False)["scene"].nunique() == 1).all():
        rows = rows.assign(scene="")  # a scene may be called after the value: views are told apart by name
    groups = [(str(title), of_dataset) for title, of_dataset in rows.groupby("dataset", sort=False)]
    followed = [
        _along(title, of_dataset, name, study, notes) for title, of_dataset in groups if _is_scored(of_dataset, study)
    ]
    if not followed:
        raise NotApplicableError(f"no scores of {', '.join(study.metrics) or 'anything'}")
    return followed


def _is_scored(rows: DataFrame, study: Study) -> bool:
    """Whether a dataset has scores of every metric that the study asks for."""
    ok = rows[rows["status"] == "ok"]
    return len(ok) > 0 and {metric.partition(":")[0] for metric in study.metrics} <= {*ok["metric"]}


def _value_in(options: dict[str, Any], group: str, name: str) -> Value | None:
    """The value in a row's options; None if its dataset or method has no such option."""
    part = _part(options, group)
    value, is_given = part.get(name), True
    if group == "degrade" and value is None:
        value, is_given = next(f.default for f in fields(Degradation) if f.name == name), False
    if value is None and not (group == "degrade" or name in part):
        return None
    word, number = _read(name, value)
    return Value(word, number, is_given and value is not None, json.dumps(value))


def _read(name: str, value: Any) -> tuple[str, float | None]:
    """A value in a word, and as a number where it is one; a water by its attenuation in 1/m, the channels' mean."""
    if value is None:
        return ("all" if name in VIEWS else "none"), None
    if name == "add_water":
        with contextlib.suppress(InputError):  # its file may be gone
            value = float(read_water(value).attenuation.mean())
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return f"{value:.4g}" if isinstance(value, float) else str(value), float(value)
    return "_".join(map(str, value)) if isinstance(value, list) else PurePath(str(value)).name, None


def _with_distinct_words(values_of: dict[str, Value | None]) -> dict[str, Value | None]:
    """Give different values different words."""
    full: dict[str, set[str]] = {}
    for value in filter(None, values_of.values()):
        full.setdefault(value.word, set()).add(value.full)
    return {
        text: value and (value if len(full[value.word]) == 1 else replace(value, word=value.full))
        for text, value in values_of.items()
    }


def _part(options: dict[str, Any], group: str) -> dict[str, Any]:
    """A row's options of its dataset, degradation or method."""
    part = options if group == "method" else options.get(group, {})
    return {key: value for key, value in part.items() if key not in ("dataset", "degrade", "replicate", "name")}


def _without(label: str, option: str) -> str:
    """A label without what it says of an option."""
    return ",".join(part for part in label.split(",") if not part.startswith(f"{option}="))


def _along(title: str, rows: DataFrame, option: str, study: Study, notes: tuple[Note, ...]) -> Along:
    values = _ordered(rows["_value"].unique())
    methods = tuple(dict.fromkeys(rows["method"]))
    reference = next((value for value in values if not value.is_given), values[0])
    lines = {(v, m): _line(option, v, m) for v in values for m in methods}
    named = [lines[pair] for pair in zip(rows["_value"], rows["method"], strict=True)]
    rows = rows.assign(_method=rows["method"], method=named)
    (scores,) = compare(rows, study.metrics, order=list(lines.values()))
    scores = only(replace(scores, notes=(*scores.notes, *notes)), study.metrics)
    changes = leads = None
    if len(values) > 1:
        each = [([lines[v, m] for v in values], lines[reference, m]) for m in methods]
        changes = _against(scores, each, f"the same method at {option}={reference.word}")
    if study.baseline in methods:
        each = [([lines[v, m] for m in methods], lines[v, study.baseline]) for v in values]
        leads = _against(scores, each, f"{study.baseline} at the same {option}")
    return Along(title, option, study.axis or option, values, reference, methods, scores, changes, leads)


def _ordered(values: Iterable[Value]) -> tuple[Value, ...]:
    """Numbers ascend, and what is not degraded comes after them, being without limit; words stay as they came."""
    values = list(values)
    if all(value.number is not None for value in values if value.is_given):
        values = sorted(values, key=lambda value: math.inf if value.number is None else value.number)
    return tuple(values)


def _against(scores: Comparison, each: Sequence[tuple[Sequence[str], str]], baseline: str) -> Comparison | None:
    """One table of several, each with its own baseline, which is left out. each: lines, and the baseline's line."""
    cells: dict[tuple[str, Column], Cell] = {}
    for lines, reference in each:
        made = against(scores, reference, lines).cells
        cells |= {(line, c): cell for (line, c), cell in made.items() if line != reference and (reference, c) in made}
    lines = tuple(line for line in scores.methods if any(line == known for known, _ in cells))
    kept = tuple(c for c in scores.columns if any(c == known for _, known in cells))
    title = f"{scores.title}, against {baseline}"
    return Comparison(title, lines, kept, cells, baseline=baseline) if cells else None


def records(followed: Along) -> Iterator[dict[str, Any]]:
    """Yield what is known of each value, method and score, for CSV; differences are of the score, in its unit."""
    for value in followed.values:
        for method in followed.methods:
            for column in followed.scores.columns:
                key = (followed.line(value, method), column)
                if cell := followed.scores.cells.get(key):
                    yield {
                        "dataset": followed.title,
                        followed.option: value.word,
                        "method": method,
                        **{name: getattr(column, name) for name in ("metric", "variant", "unit", "better")},
                        **{name: getattr(cell, name) for name in ("mean", "std", "low", "high", "holes")},
                        **_ends("change", followed.changes, key),
                        **_ends("lead", followed.leads, key),
                        **{name: getattr(column, name) for name in ("n_units", "n_views", "n_scenes")},
                    }


def _ends(name: str, table: Comparison | None, key: tuple[str, Column]) -> dict[str, float]:
    cell = None if table is None else table.cells.get(key)
    ends = (math.nan,) * 3 if cell is None else cell.change
    return dict(zip((name, f"{name}_low", f"{name}_high"), ends, strict=True))
