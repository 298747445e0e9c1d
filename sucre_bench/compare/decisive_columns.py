"""Chooses the columns of the short table: a few scores, the share of pixels with a colour, the time.

Metrics declare by their role what they are good for (`Role`). The first of the scores is the main one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sucre_bench.compare.choose_pixels import says_filled
from sucre_bench.compare.model import Column, Comparison
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
