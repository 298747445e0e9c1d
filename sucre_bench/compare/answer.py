"""The answer of a comparison: which columns decide, who leads by each, and that in two sentences."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sucre_bench.compare.compare_rows import against
from sucre_bench.compare.model import EQUAL, Cell, Column, Comparison, Verdict, may_be_chance, says_filled
from sucre_bench.compare.words import BLIND, ahead, listed, with_unit
from sucre_bench.plugins.plugin import Role
from sucre_bench.results.rows import PREFERENCE, RESTORATION

_MOST = 4
# Roles of scores that know the true colours, and how many metrics of each are taken.
_TRUE_COLOURS: tuple[tuple[Role, int], ...] = (("similarity", 2), ("chart-error", 1), ("colour-difference", 1))
_WITHOUT: tuple[tuple[Role, int], ...] = (("no-reference", 2),)
_OTHERS: frozenset[Role] = frozenset({"", "change-with-distance"})


@dataclass(frozen=True)
class Deciding:
    """scores: the main one first; filled: share of pixels with a colour; seconds: a restoration's; None where it was
    not measured; knows_colours: False if scores of the picture alone stand in a table without any that compares with
    true colours, and nobody voted.
    """

    scores: tuple[Column, ...]
    filled: Column | None
    seconds: Column | None
    knows_colours: bool = True

    @property
    def main(self) -> Column | None:
        """The score that sorts the methods; None if no score shows which colours are true."""
        return next((column for column in self.scores if column.ranked), None) if self.knows_colours else None

    @property
    def first(self) -> Column | None:
        """The main score; the first one if none sorts the methods."""
        return self.main or next((column for column in self.scores if column.directed), None)

    @property
    def columns(self) -> tuple[Column, ...]:
        """All of them, in the order of a table."""
        return (*self.scores, *(column for column in (self.filled, self.seconds) if column))


def deciding(comparison: Comparison, every: bool = False) -> Deciding:
    """Return the columns of a comparison that decide; every: all of them, which someone has asked for.

    Scores that know the true colours come first. Without any, people's votes and scores of the picture alone take their
    place. If there is room, scores of several views and those without a role follow: those of a plugin under test, say.
    """
    if every:
        return Deciding(comparison.columns, None, None, _may_know_colours(comparison.columns))
    directed = _one_a_metric([column for column in comparison.columns if column.directed])
    roles: dict[Column, Role] = {column: column.plugin.role if column.plugin else "" for column in directed}
    of_people = [column for column in directed if column.metric == PREFERENCE]
    known = [*_of_roles(directed, roles, _TRUE_COLOURS)] or [*of_people, *_of_roles(directed, roles, _WITHOUT)]
    others = [column for column in directed if roles[column] in _OTHERS and column not in known]
    chosen = (known + others)[:_MOST] or directed[:_MOST]
    filled = next((column for column in comparison.columns if says_filled(column.metric, column.variant)), None)
    seconds = next((column for column in comparison.columns if column.metric == RESTORATION), None)
    scores = tuple(column for column in chosen if column != filled)
    return Deciding(scores, filled, seconds, _may_know_colours(scores))


def decisive(comparison: Comparison) -> Comparison:
    """Return the comparison with only the columns that decide."""
    return replace(comparison, columns=deciding(comparison).columns)


def _of_roles(
    directed: Sequence[Column], roles: dict[Column, Role], wanted: Sequence[tuple[Role, int]]
) -> Iterator[Column]:
    for role, most in wanted:
        yield from [column for column in directed if roles[column] == role][:most]


def _may_know_colours(columns: Sequence[Column]) -> bool:
    """Whether all directed scores compete, or people judged, or a metric is not installed here: it may know them."""
    directed = [column for column in columns if column.directed]
    return all(column.competes for column in directed) or any(column.plugin is None for column in directed)


def _one_a_metric(columns: Sequence[Column]) -> list[Column]:
    """The default variant of each metric, or the first that was scored."""
    chosen: dict[str, Column] = {}
    for column in columns:
        is_default = column.plugin is not None and column.variant == column.plugin.default[0]
        if column.metric not in chosen or is_default:
            chosen[column.metric] = column
    return list(chosen.values())


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Return the best method's lead over the second for each score; none for scores in which nobody leads.

    With a baseline: a verdict for each method and score, leader or second being the baseline.
    """
    judge = _differences_from_baseline if comparison.baseline else _lead_of_best
    return [verdict for column in comparison.columns if column.ranked for verdict in judge(comparison, column)]


def _lead_of_best(comparison: Comparison, column: Column) -> Iterator[Verdict]:
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


def _differences_from_baseline(comparison: Comparison, column: Column) -> Iterator[Verdict]:
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
