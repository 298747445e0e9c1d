"""The verdicts of a comparison: in each score, who leads the next, or how methods differ from the baseline."""

import math
from collections.abc import Iterator

from sucre_bench.compare.model import Column, Comparison, Verdict, may_be_chance


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Return the best method's lead over the second for each score; none for scores in which nobody leads.

    With a baseline: a verdict for each method and score, leader or second being the baseline.
    """
    judge = _against_baseline if comparison.baseline else _leader
    return [verdict for column in comparison.columns if column.ranked for verdict in judge(comparison, column)]


def _leader(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    ranked = [
        (cell, name)
        for name in comparison.methods
        if (cell := comparison.cells.get((name, column))) and cell.place  # the photograph has none
    ]
    ranked.sort(key=lambda pair: pair[0].place)
    if len(ranked) < 2:
        return
    (first, best), (next_best, second) = ranked[:2]
    gap, low, high = next_best.behind
    if next_best.place == 1 or not math.isfinite(gap):
        return
    yield Verdict(column, best, second, gap, (low, high), first.wins, abs(next_best.effect), next_best.tie)


def _against_baseline(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    baseline = comparison.baseline
    for name in comparison.methods:
        cell = comparison.cells.get((name, column))
        if cell is None or not math.isfinite(cell.change[0]):
            continue
        change, low, high = cell.change
        size, interval = (change, (low, high)) if change > 0 else (-change, (-high, -low))
        if not change or (change > 0) == (column.better == "higher"):
            pair, wins = (name, baseline), cell.wins
        else:
            pair, wins = (baseline, name), column.n_views - cell.wins
        yield Verdict(column, *pair, size, interval, wins, abs(cell.effect), may_be_chance(cell.change))
