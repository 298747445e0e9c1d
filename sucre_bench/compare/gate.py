"""A gate for automatic checks: has a method become worse than the baseline, by more than a limit and more than chance?

A gain is the paired difference of a method to the baseline, positive = better, whichever direction of the metric that
is. A method fails if its gain is below the limit, and the 95 % interval of the gain is below 0.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.compare_rows import compare
from sucre_bench.compare.model import NO_DIFFERENCE, Column, Comparison, Difference
from sucre_bench.errors import InputError, did_you_mean

_WORST = 5


@dataclass(frozen=True)
class Gate:
    """A limit."""

    method: str
    """A label, "" for all."""

    metric: str
    """As "name" or "name:variant"."""

    limit: float
    """Of the gain, at most 0."""

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
                f"--fail-below: '{text}' is no limit; write METRIC=NUMBER, 0 or below, psnr=-0.5 say"
            )
        return cls(method, metric, limit)


Outcome = Literal["passed", "failed", "unknown", "no score"]


@dataclass(frozen=True)
class Gated:
    """What a gate says of a method in one column of one dataset."""

    dataset: str
    method: str
    column: Column
    gate: Gate

    gain: Difference
    """Paired difference to the baseline, positive = better, with its interval."""

    outcome: Outcome
    """It is "unknown" where no interval ends, and "no score" where the method has none that the baseline has too."""

    worst: tuple[tuple[str, float], ...] = ()
    """Views with the largest losses, and their gains."""

    @property
    def fails(self) -> bool:
        """Whether the check must not pass: a loss beyond chance, or no score at all."""
        return self.outcome in ("failed", "no score")


def gated(rows: DataFrame, gates: Sequence[Gate], baseline: str) -> list[Gated]:
    """Return what gates say of every method but the baseline.

    Raises InputError for a metric or method that the rows do not have, and for a metric that only describes.
    """
    known = set(rows["method"].unique())
    found: list[Gated] = []
    for gate in gates:
        if gate.method and gate.method not in known:
            raise InputError(
                f"--fail-below: no method '{gate.method}'; {did_you_mean(gate.method, known)}"
            )
        for table in compare(rows, [gate.metric], baseline=baseline):
            if not table.baseline:
                raise InputError(
                    f"{table.title}: {baseline} was not run on these data; run it there"
                )
            ranked = [column for column in table.columns if column.better != "none"]
            if not ranked:
                raise InputError(
                    f"--fail-below: nobody wins by {gate.metric} here; name another metric"
                )
            methods = [
                name for name in table.methods if name != baseline and gate.method in ("", name)
            ]
            found += [
                _judged(table, gate, method, column) for method in methods for column in ranked
            ]
    return found


def _judged(table: Comparison, gate: Gate, method: str, column: Column) -> Gated:
    cell = table.cells.get((method, column))
    gain, low, high = cell.change if cell else NO_DIFFERENCE
    if column.better == "lower":
        gain, low, high = -gain, -high, -low
    worst: list[tuple[str, float]] = []
    outcome: Outcome = "passed"
    if math.isnan(gain):
        outcome = "no score"
    elif not high < column.reach:
        outcome = "unknown"
    elif gain < gate.limit and high < 0:
        outcome = "failed"
        scores = table.measured[column]
        mine, base = (
            scores.views[:, scores.methods.index(name)] for name in (method, table.baseline)
        )
        gains = (base - mine) * column.sign
        names = [
            f"{scene} · {view}" if column.n_scenes > 1 else view
            for scene, view in scores.places
        ]
        for n in np.argsort(gains, kind="stable")[:_WORST]:
            if gains[n] < 0:
                worst.append((names[n], float(gains[n])))
    return Gated(table.title, method, column, gate, (gain, low, high), outcome, tuple(worst))
