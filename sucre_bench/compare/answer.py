"""What a comparison comes to, in two sentences: who leads by the main score, and what the other columns say."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

from sucre_bench.compare.deciding import Deciding
from sucre_bench.compare.model import FEWEST_VIEWS, Column, Comparison, Verdict
from sucre_bench.compare.numbers import number
from sucre_bench.compare.tables import against
from sucre_bench.compare.verdicts import verdicts
from sucre_bench.compare.words import listed

__all__ = ["answer", "blind", "too_few"]


def answer(comparison: Comparison, chosen: Deciding) -> list[str]:
    """Return one or two sentences by the chosen columns; none where there is nothing to decide."""
    if chosen.main is None:
        return []
    lines = _against_baseline if comparison.baseline else _leaders
    return [line for line in lines(comparison, chosen) if line]


def too_few(comparison: Comparison) -> str:
    """Return what says that the views do not suffice for intervals; "" where they do."""
    counts = [column.n_views for column in comparison.columns if column.n_units]
    if not counts or max(counts) >= FEWEST_VIEWS:
        return ""
    return f"{max(counts)} view{'s' * (max(counts) != 1)}: too few for intervals"


def blind(chosen: Deciding) -> str:
    """Return what says that no score knows the true colours; "" where one does."""
    if chosen.knows_colours or not chosen.scores:
        return ""
    return f"{', '.join(column.metric for column in chosen.scores)}: scores of the picture alone, without true colours"


def _leaders(comparison: Comparison, chosen: Deciding) -> Iterator[str]:
    found = {verdict.column: verdict for verdict in verdicts(comparison)}
    (main, *others) = _main_first(chosen)
    best = {column: _best(comparison, column) for column in (main, *others)}
    gain = "" if main in found else _over_photograph(comparison, main, best[main])
    yield f"{main.metric}: {_lead(found[main]) if main in found else gain}" if main in found or gain else ""
    leading: dict[str, list[str]] = {}
    for column in others:
        if column in found:
            leading.setdefault(best[column], []).append(column.metric)
    also = "; ".join(f"{', '.join(metrics)}: {name}" for name, metrics in leading.items())
    beaten = [column.metric for column in (main, *others) if _photograph_leads(comparison, column, best[column])]
    warning = f"no method beats {listed(comparison.photographs)}, the photograph, in {listed(beaten)}" if beaten else ""
    yield "; ".join(filter(None, [f"best in {also}" if also else "", warning]))


def _main_first(chosen: Deciding) -> list[Column]:
    """The scores that methods win by."""
    return [column for column in chosen.scores if column.ranked]


def _best(comparison: Comparison, column: Column) -> str:
    """The competitor with the best mean, "" without any score."""
    places = {name: cell.place for name in comparison.restorers if (cell := comparison.cells.get((name, column)))}
    return min(places, key=places.__getitem__, default="")


def _lead(verdict: Verdict) -> str:
    by = " ".join(filter(None, [number(verdict.difference), verdict.column.unit]))
    return f"{verdict.leader} leads {verdict.second} by {by}{_chance(verdict, 'best')}"


def _chance(verdict: Verdict, wins: str) -> str:
    views = verdict.column.n_views
    if views < 2:
        return ", on one view"
    if views < FEWEST_VIEWS:
        return f", {wins} in {round(verdict.wins, 1):g} of {views} views"
    return ", which may be chance" if verdict.may_be_chance else ", more than chance"


def _photograph_leads(comparison: Comparison, column: Column, best: str) -> bool:
    """Whether the photograph itself scores better than every method."""
    sign = -1 if column.better == "lower" else 1
    first = comparison.cells.get((best, column))
    shown = [cell for name in comparison.photographs if (cell := comparison.cells.get((name, column)))]
    return bool(first and any(sign * (cell.mean - first.mean) > 0 for cell in shown))


def _over_photograph(comparison: Comparison, column: Column, best: str) -> str:
    """The best method's gain over the photograph, where there is one beside it."""
    if not comparison.photographs or best in comparison.photographs:
        return ""
    photograph = comparison.photographs[0]
    cell = against(comparison, photograph, (best,)).cells.get((best, column))
    if cell is None or not math.isfinite(cell.change[0]):
        return ""
    if _photograph_leads(comparison, column, best):
        return ""
    by = " ".join(filter(None, [number(abs(cell.change[0])), column.unit]))
    surely = column.n_views < FEWEST_VIEWS or not cell.change[1] <= 0 <= cell.change[2]
    return f"{best} is better than {photograph} by {by}{'' if surely else ', which may be chance'}"


def _against_baseline(comparison: Comparison, chosen: Deciding) -> Iterator[str]:
    """For the main score, and for the others: who is better, who is worse, and who may be either."""
    (main, *others) = _main_first(chosen)
    baseline, found = comparison.baseline, verdicts(comparison)
    sides = _sides(baseline, [verdict for verdict in found if verdict.column == main])
    yield f"{main.metric}, against {baseline}: {sides}" if sides else ""
    lines = ((column, _sides(baseline, [v for v in found if v.column == column], short=True)) for column in others)
    yield "; ".join(f"{column.metric}: {sides}" for column, sides in lines if sides)


def _sides(baseline: str, found: Sequence[Verdict], short: bool = False) -> str:
    sides: dict[str, list[str]] = {"better": [], "worse": [], "may be chance": []}
    for verdict in found:
        name = verdict.second if verdict.leader == baseline else verdict.leader
        unsure = verdict.may_be_chance and verdict.column.n_views >= FEWEST_VIEWS
        side = "may be chance" if unsure else "worse" if verdict.leader == baseline else "better"
        sides[side].append(name)
    if short:
        return ", ".join(f"{len(names)} {side}" for side, names in sides.items() if names)
    return "; ".join(f"{side}: {listed(names)}" for side, names in sides.items() if names)
