"""A gate for automatic checks: has a method become worse than the baseline, by more than a limit and more than chance?

A gain is the paired difference of a method to the baseline, positive = better, whichever direction of the metric that
is. A method fails if its gain is below the limit, and the 95 % interval of the gain is below 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.compare_rows import asked_for, compare
from sucre_bench.compare.model import Column, Comparison, Difference
from sucre_bench.errors import InputError, did_you_mean

_WORST = 5


@dataclass(frozen=True)
class Gate:
    """A limit. method: a label, "" for all; metric: "name" or "name:variant"; limit: of the gain, at most 0."""

    method: str
    metric: str
    limit: float

    @classmethod
    def read(cls, text: str) -> Gate:
        """Read "[METHOD/]METRIC[:VARIANT]=LIMIT". Raises InputError for anything else, and for a limit above 0."""
        name, _, number = text.rpartition("=")
        method, _, metric = name.rpartition("/")
        try:
            limit = float(number)
        except ValueError:
            limit = math.nan
        if not metric or not -math.inf < limit <= 0:
            raise InputError(
                f"--fail-below: '{text}' is no limit; write METRIC=NUMBER, the number 0 or below, psnr=-0.5 say"
            )
        return cls(method, metric, limit)


@dataclass(frozen=True)
class Gated:
    """What a gate says of a method in one column of one dataset.

    gain: with its interval; outcome: "unknown" where there is no interval, "no score" where the method has none that
    the baseline has too; worst: views with the largest losses, and their gains.
    """

    dataset: str
    method: str
    column: Column
    gate: Gate
    gain: Difference
    outcome: Literal["passed", "failed", "unknown", "no score"]
    worst: tuple[tuple[str, float], ...] = ()

    @property
    def fails(self) -> bool:
        """Whether the check must not pass: a loss beyond chance, or no score at all."""
        return self.outcome in ("failed", "no score")


def gated(rows: DataFrame, gates: Sequence[Gate], baseline: str) -> list[Gated]:
    """Return what gates say of every method but the baseline.

    Raises InputError for a metric or method that the rows do not have, and for a metric that only describes.
    """
    known = set(rows["method"].unique()) if gates else set()
    found: list[Gated] = []
    for gate in gates:
        if gate.method and gate.method not in known:
            raise InputError(f"--fail-below: no method '{gate.method}'; {did_you_mean(gate.method, known)}")
        if not (asked_for(rows, [gate.metric]) & (rows["status"] == "ok")).any():
            raise InputError(f"--fail-below: no scores of {gate.metric}; run with metrics=[{gate.metric}]")
        for table in compare(rows, [gate.metric], baseline=baseline):
            found += _of_table(rows, table, gate, baseline)
    return found


def _of_table(rows: DataFrame, table: Comparison, gate: Gate, baseline: str) -> Iterator[Gated]:
    if not table.baseline:
        raise InputError(f"{table.title}: {baseline} was not run on these data; run it there")
    ranked = [column for column in table.columns if column.better != "none"]
    if not ranked:
        raise InputError(f"--fail-below: {gate.metric} has no better or worse; name another metric")
    for method in table.methods:
        if method == baseline or gate.method not in ("", method):
            continue
        for column in ranked:
            cell = table.cells.get((method, column))
            gain = _gain(column, cell.change) if cell else (math.nan,) * 3
            outcome = _outcome(gain, gate.limit)
            worst = tuple(_worst(rows, table.title, column, method, baseline)) if outcome == "failed" else ()
            yield Gated(table.title, method, column, gate, gain, outcome, worst)


def _gain(column: Column, change: Difference) -> Difference:
    value, low, high = change
    return change if column.better == "higher" else (-value, -high, -low)


def _outcome(gain: Difference, limit: float) -> Literal["passed", "failed", "unknown", "no score"]:
    value, _, high = gain
    if math.isnan(value):
        return "no score"
    if math.isnan(high):
        return "unknown"
    return "failed" if value < limit and high < 0 else "passed"


def _worst(rows: DataFrame, dataset: str, column: Column, method: str, baseline: str) -> list[tuple[str, float]]:
    """The views with the largest losses, the largest first."""
    of_pair = rows[(rows["dataset"] == dataset) & rows["method"].isin([method, baseline])]
    gains = []
    for table in compare(of_pair, [f"{column.metric}:{column.variant}"], by="view", baseline=baseline):
        cells = [cell for (name, _), cell in table.cells.items() if name == method]
        gains += [(table.title.removeprefix(f"{dataset} · "), _gain(column, cell.change)[0]) for cell in cells]
    return sorted((one for one in gains if one[1] < 0), key=lambda one: one[1])[:_WORST]
