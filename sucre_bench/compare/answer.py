"""The answer of a comparison: which columns decide, who leads by each, and that in a few sentences."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

from sucre_bench.compare.compare_rows import against
from sucre_bench.compare.model import EQUAL, Column, Comparison, Verdict, may_be_chance, says_filled
from sucre_bench.compare.statistics import undone_by
from sucre_bench.compare.words import by_score, faults, listed, verdict_text, with_unit
from sucre_bench.plugins.plugin import Role
from sucre_bench.results.rows import PREFERENCE, RESTORATION

_MOST = 4
_MOST_BLIND = 2  # metrics that are evidence, and metrics that are taste, in a table without truth
# Roles of scores that know the true colours, in the order in which metrics are taken and then shown.
_TRUE_COLOURS: tuple[Role, ...] = ("colours", "colours", "similarity", "chart-error", "similarity", "colour-difference")


@dataclass(frozen=True)
class Deciding:
    """scores: the main one first; filled: share of pixels with a colour; seconds: a restoration's; None where it was
    not measured; knows_colours: False if no score compares with what is true, and nobody voted.
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

    Scores that know the true colours come first. Without any, people's votes, evidence and scores of the picture alone
    take their place, in this order. If there is room, scores of several views and those without a role follow: those of
    a plugin under test, say.
    """
    scores, filled, seconds = comparison.columns, None, None
    if not every:
        once: dict[str, Column] = {}  # the default variant of each metric, or the first that was scored
        for column in scores:
            is_default = column.plugin is not None and column.variant == column.plugin.default[0]
            if column.directed and (column.metric not in once or is_default):
                once[column.metric] = column
        by_role: dict[Role, list[Column]] = {}
        for column in once.values():
            by_role.setdefault(column.plugin.role if column.plugin else "", []).append(column)
        left = {role: iter(of_role) for role, of_role in by_role.items()}
        found = [(role, one) for role in _TRUE_COLOURS if (one := next(left.get(role, iter(())), None))]
        known = [column for _, column in sorted(found[:_MOST], key=lambda each: _TRUE_COLOURS.index(each[0]))]
        if not known:
            of_people = [column for column in once.values() if column.metric == PREFERENCE]
            evidence = [column for column in once.values() if column.knows == "evidence"]
            taste = [column for column in by_role.get("no-reference", []) if column.knows == "taste"]
            known = [*of_people, *evidence[:_MOST_BLIND], *taste[:_MOST_BLIND]]
        others = [c for c in once.values() if c not in known and (c.plugin.role if c.plugin else "") in _OTHERS]
        filled = next((column for column in scores if says_filled(column.metric, column.variant)), None)
        seconds = next((column for column in scores if column.metric == RESTORATION), None)
        chosen = (known + others)[:_MOST] or [*once.values()][:_MOST]
        scores = tuple(column for column in chosen if column != filled)
    directed = [column for column in scores if column.directed]
    knows = not directed or any(column.knows == "truth" for column in directed)
    return Deciding(tuple(sorted(scores, key=lambda column: column.knows == "taste")), filled, seconds, knows)


_OTHERS: frozenset[Role] = frozenset({"", "change-with-distance"})


def best_first(comparison: Comparison, main: Column | None) -> tuple[str, ...]:
    """Return the methods by their mean of a score, those without it behind them, photographs last; else as asked."""
    names = comparison.restorers or comparison.methods
    if main is not None:
        sign = -1 if main.better == "higher" else 1
        means = {name: sign * cell.mean for name, cell in comparison.of(main).items() if not math.isnan(cell.mean)}
        names = tuple(sorted(names, key=lambda name: means.get(name, math.inf)))
    return (*names, *(name for name in comparison.photographs if name not in names))


def verdicts(comparison: Comparison) -> list[Verdict]:
    """Return the best method's lead over the second for each score; none for scores in which nobody leads.

    With a baseline: a verdict for each method and score, leader or second being the baseline.
    """
    judge = _differences_from_baseline if comparison.baseline else _lead_of_best
    return [verdict for column in comparison.columns if column.ranked for verdict in judge(comparison, column)]


def _lead_of_best(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    cells = {name: cell for name, cell in comparison.of(column).items() if cell.place}  # the photograph has none
    if len(cells) < 2:
        return
    best, second = sorted(cells, key=lambda name: cells[name].place)[:2]
    behind = cells[second]
    gap, low, high = behind.behind
    if behind.place == 1 or not math.isfinite(gap):
        return
    found = Verdict(column, best, second, gap, (low, high), cells[best].wins, abs(behind.effect), behind.tie)
    scores = comparison.measured[column]
    if found.is_lead and scores.independent is not None:
        unit = undone_by(scores.independent, *map(scores.methods.index, (best, second)))
        if unit is not None:
            names = [*dict.fromkeys(scene for scene, _ in scores.places)]
            found = replace(found, undone_by=names[unit] if len(names) > 1 else scores.places[unit][1])
    yield found


def _differences_from_baseline(comparison: Comparison, column: Column) -> Iterator[Verdict]:
    baseline = comparison.baseline
    for name, cell in comparison.of(column).items():
        change, low, high = cell.change
        if not math.isfinite(change):
            continue
        interval = (low, high) if change > 0 else (-high, -low)
        pair, wins = (name, baseline), cell.wins
        if change and (change > 0) != (column.better == "higher"):
            pair, wins = (baseline, name), column.n_views - cell.wins
        yield Verdict(column, *pair, abs(change), interval, wins, abs(cell.effect), may_be_chance(cell.change))


def answer(comparison: Comparison, chosen: Deciding) -> list[str]:
    """Return a few sentences by the chosen columns: what is wrong with the pictures, and who leads.

    Where no score shows which colours are true, the first sentence says that. Evidence is named as that, and the last
    sentence says what to do.
    """
    lines = _against_baseline if comparison.baseline else _leaders
    ranked = [column for column in chosen.scores if column.ranked]
    if chosen.knows_colours:
        said = lines(comparison, ranked) if chosen.main else ()
        return [*faults(comparison), *filter(None, said)]
    by_evidence = (line for column in ranked for line in lines(comparison, [column]))
    return [comparison.blind, *faults(comparison), *filter(None, by_evidence), comparison.advice]


def _leaders(comparison: Comparison, columns: list[Column]) -> Iterator[str]:
    """Who leads in the main score, the first column; who in the others, and where the photograph is better than all."""
    main, found = columns[0], {verdict.column: verdict for verdict in verdicts(comparison)}
    best, beaten = {}, []
    for column in columns:
        cells = comparison.of(column)
        places = {name: cells[name].place for name in comparison.restorers if name in cells}
        best[column] = min(places, key=places.__getitem__, default="")
        sign = -1 if column.better == "lower" else 1
        for photograph in (cells[name] for name in comparison.photographs if name in cells and places):
            gap = sign * (photograph.mean - cells[best[column]].mean)
            if gap > 0 and not math.isclose(photograph.mean, cells[best[column]].mean, rel_tol=EQUAL):
                beaten.append(column.metric)
    if main in found:
        yield verdict_text(comparison, found[main], interval=False)
    else:
        first = [name for name in comparison.restorers if (c := comparison.cells.get((name, main))) and c.place == 1]
        names = " and ".join(first) if len(first) == 2 else listed(first)  # labels may have commas
        gain = "" if main.metric in beaten else _over_photograph(comparison, main, best[main])
        said = "; ".join(filter(None, [f"{names} are equal" if len(first) > 1 else "", gain]))
        yield f"{by_score(main)}: {said}" if said else ""
    leading: dict[str, list[str]] = {}
    for column in columns[1:]:
        if column in found:
            leading.setdefault(best[column], []).append(column.metric)
    also = "; ".join(f"{', '.join(metrics)}: {name}" for name, metrics in leading.items())
    names = listed(comparison.photographs)
    warning = f"no method beats {names}, the photograph, in {listed(dict.fromkeys(beaten))}" if beaten else ""
    yield "; ".join(filter(None, [f"best in {also}" if also else "", warning]))


def _over_photograph(comparison: Comparison, column: Column, best: str) -> str:
    """The best method's gain over the photograph, where there is one beside it."""
    if not comparison.photographs or best in comparison.photographs:
        return ""
    photograph = comparison.photographs[0]
    cell = against(comparison, photograph, (best,)).cells.get((best, column))
    if cell is None or not math.isfinite(cell.change[0]):
        return ""
    if not cell.change[0]:
        return f"{best} equals {photograph}"
    chance = ", which may be chance" if may_be_chance(cell.change) else ""
    return f"{best} is better than {photograph} by {with_unit(abs(cell.change[0]), column)}{chance}"


_SIDES = ("better", "worse", "may be chance", "unknown (no interval)", "equal")


def _against_baseline(comparison: Comparison, columns: list[Column]) -> Iterator[str]:
    """For the main score, and for the others: who is better, who is worse, and who may be either."""
    sides: dict[Column, dict[str, list[str]]] = {column: {side: [] for side in _SIDES} for column in columns}
    for verdict in verdicts(comparison):
        is_behind = verdict.leader == comparison.baseline
        if not verdict.difference:
            side = "equal"
        elif not math.isfinite(verdict.interval[0]):  # over one view
            side = "unknown (no interval)"
        else:
            side = "may be chance" if verdict.may_be_chance else "worse" if is_behind else "better"
        if verdict.column in sides:
            sides[verdict.column][side].append(verdict.second if is_behind else verdict.leader)
    main, *others = columns
    text = "; ".join(f"{side}: {listed(names)}" for side, names in sides[main].items() if names)
    yield f"{by_score(main)}, against {comparison.baseline}: {text}" if text else ""
    alike: dict[str, list[str]] = {}
    for column in others:
        text = ", ".join(f"{len(names)} {side}" for side, names in sides[column].items() if names)
        alike.setdefault(text, []).append(column.metric)
    yield "; ".join(f"{', '.join(metrics)}: {text}" for text, metrics in alike.items() if text)
