"""The answer of a comparison in two sentences: who leads by the main score, and what the other columns say."""

import math
from collections.abc import Iterator

from sucre_bench.compare.compare_rows import against
from sucre_bench.compare.decisive_columns import Deciding
from sucre_bench.compare.model import EQUAL, Cell, Column, Comparison, Verdict, may_be_chance
from sucre_bench.compare.verdicts import verdicts
from sucre_bench.compare.words import BLIND, ahead, listed, with_unit


def answer(comparison: Comparison, chosen: Deciding) -> list[str]:
    """Return one or two sentences by the chosen columns; none where there is nothing to decide.

    Where no score shows which colours are true, the sentence says that.
    """
    if not chosen.knows_colours:
        return [BLIND]
    if chosen.main is None:
        return []
    lines = _against_baseline if comparison.baseline else _leaders
    return [line for line in lines(comparison, chosen) if line]


def _leaders(comparison: Comparison, chosen: Deciding) -> Iterator[str]:
    found = {verdict.column: verdict for verdict in verdicts(comparison)}
    (main, *others) = _main_first(chosen)
    best = {column: _best(comparison, column) for column in (main, *others)}
    gain = "" if main in found else _over_photograph(comparison, main, best[main])
    said = [_lead(found[main])] if main in found else [_equals(comparison, main), gain]
    yield f"{main.metric}: {'; '.join(filter(None, said))}" if any(said) else ""
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


def _equals(comparison: Comparison, column: Column) -> str:
    """The competitors that share the best mean; "" for one alone."""
    first = [name for name in comparison.restorers if (c := comparison.cells.get((name, column))) and c.place == 1]
    names = " and ".join(first) if len(first) == 2 else listed(first)  # labels may have commas
    return f"{names} are equal" if len(first) > 1 else ""


def _lead(verdict: Verdict) -> str:
    by = with_unit(verdict.difference, verdict.column)
    return f"{ahead(verdict)} by {by}{_chance(verdict)}"


def _chance(verdict: Verdict) -> str:
    views = verdict.column.n_views
    if views < 2:
        return ", on one view"
    chance = ", which may be chance" if verdict.may_be_chance else ", more than chance"
    if verdict.column.has_few_views:
        return f", best in {round(verdict.wins, 1):g} of {views} views{chance * verdict.may_be_chance}"
    return chance


def _photograph_leads(comparison: Comparison, column: Column, best: str) -> bool:
    """Whether the photograph itself scores better than every method."""
    sign = -1 if column.better == "lower" else 1
    first = comparison.cells.get((best, column))
    shown = [cell for name in comparison.photographs if (cell := comparison.cells.get((name, column)))]
    return bool(first and any(sign * cell.mean > sign * first.mean and not _is_equal(cell, first) for cell in shown))


def _is_equal(cell: Cell, other: Cell) -> bool:
    return math.isclose(cell.mean, other.mean, rel_tol=EQUAL)


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
    if not cell.change[0]:
        return f"{best} equals {photograph}"
    chance = ", which may be chance" if may_be_chance(cell.change) else ""
    return f"{best} is better than {photograph} by {with_unit(abs(cell.change[0]), column)}{chance}"


def _against_baseline(comparison: Comparison, chosen: Deciding) -> Iterator[str]:
    """For the main score, and for the others: who is better, who is worse, and who may be either."""
    (main, *others) = _main_first(chosen)
    sides = _sides(comparison, main)
    text = "; ".join(f"{side}: {listed(names)}" for side, names in sides.items())
    yield f"{main.metric}, against {comparison.baseline}: {text}" if sides else ""
    alike: dict[str, list[str]] = {}
    for column in others:
        text = ", ".join(f"{len(names)} {side}" for side, names in _sides(comparison, column).items())
        alike.setdefault(text, []).append(column.metric)
    yield "; ".join(f"{', '.join(metrics)}: {text}" for text, metrics in alike.items() if text)


def _sides(comparison: Comparison, column: Column) -> dict[str, list[str]]:
    """The other methods by how they compare with the baseline."""
    sides: dict[str, list[str]] = {}
    for verdict in verdicts(comparison):
        if verdict.column == column:
            is_leader = verdict.leader == comparison.baseline
            sides.setdefault(_side(verdict, is_leader), []).append(verdict.second if is_leader else verdict.leader)
    return {side: sides[side] for side in _SIDES if side in sides}


_SIDES = ("better", "worse", "may be chance", "unknown (no interval)", "equal")


def _side(verdict: Verdict, is_behind: bool) -> str:
    """Which of `_SIDES` a method is on. is_behind: whether the baseline has the better mean."""
    if not verdict.difference:
        return "equal"
    if not math.isfinite(verdict.interval[0]):  # over one view
        return "unknown (no interval)"
    return "may be chance" if verdict.may_be_chance else "worse" if is_behind else "better"
