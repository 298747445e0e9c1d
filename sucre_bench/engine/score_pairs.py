"""Scores pairs of restored views of a scene: the score of a view is the mean over its pairs.

The points that two views share do not depend on the method, so they are found once for all methods of a scene.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from cachetools import LRUCache

from sucre_bench import plugins
from sucre_bench.engine.score import Scorer, kept_reason, row_without_value, score_code
from sucre_bench.errors import NotApplicableError, one_line
from sucre_bench.machine.forked import step
from sucre_bench.multiview.common_points import SharedPoints
from sucre_bench.restored_pair import RestoredPair, RestoredView
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import Row
from sucre_bench.scene import Scene, Score, View

# Pairs whose points are in memory at once, 2 MB each at most.
_AT_ONCE = 200

# Bytes of a method's pictures in memory.
_HELD = 1 << 30


@dataclass(frozen=True, eq=False)
class Entrant:
    """What one method made of a scene.

    bases: what the rows of a restored view say, by the view's name; open: returns the restored view of a name; scorers:
    metrics of pairs; among: a hash of the restored views, which ends the `code` of their rows.
    """

    bases: Mapping[str, Row]
    open: Callable[[str], RestoredView]
    scorers: Sequence[Scorer]
    among: str = ""

    def code(self, base: Row, scorer: Scorer) -> str:
        """Return the `code` of a score's rows."""
        return f"{score_code(base, scorer.code)}.{self.among}"


def pair_rows(
    scene: Scene,
    entrants: Sequence[Entrant],
    log: Path | None = None,
    limit_s: float | None = None,
    after_batch: Callable[[], None] = lambda: None,
) -> list[list[Row]]:
    """Return the rows of each method: a score for each of its views, or the reason why there is none.

    log: keeps tracebacks; limit_s: how long a score of a pair may take; after_batch: called when a method has been
    scored on 200 more pairs, or on all.
    """
    names = {name for entrant in entrants for name in entrant.bases}
    views = [view for view in scene.views if view.name in names]
    tallies = [_Tally(entrant, scene, log, limit_s) for entrant in entrants]
    shared = SharedPoints(views)
    overlaps = shared.overlaps()
    for start in range(0, len(overlaps), _AT_ONCE):
        batch = overlaps[start : start + _AT_ONCE]
        found = [(overlap, points) for overlap in batch if (points := shared.of(overlap)) is not None]
        for tally in tallies:
            held = _Held(tally.entrant.open, views)
            for overlap, points in found:
                first, second = views[overlap.first].name, views[overlap.second].name
                if first in tally.entrant.bases and second in tally.entrant.bases:
                    tally.add(RestoredPair(held.open(first), held.open(second), points, overlap.are_neighbours))
            after_batch()
    return [list(tally.rows()) for tally in tallies]


class _Held:
    """A method's restored views, of which as many stay in memory as there is room for."""

    def __init__(self, read: Callable[[str], RestoredView], views: Sequence[View]) -> None:
        camera = next((view.camera for view in views if view.camera), None)
        bytes_each = 24 * camera.width * camera.height if camera else _HELD  # two images of three float32
        self._read, self._views = read, LRUCache[str, RestoredView](max(4, _HELD // bytes_each))

    def open(self, name: str) -> RestoredView:
        if name not in self._views:
            self._views[name] = self._read(name)
        return self._views[name]


@dataclass(slots=True)
class _Mean:
    """A mean over pairs, in the making."""

    total: float = 0.0
    weight: float = 0.0
    n_pixels: int = 0
    coverage: float = 0.0
    pairs: int = 0

    def add(self, score: Score) -> None:
        self.pairs += 1
        self.coverage += score.coverage
        if score.weight > 0 and not math.isnan(score.value):
            self.total += score.weight * score.value
            self.weight += score.weight
            self.n_pixels += int(score.n_pixels)


_Variant = tuple[int, str]  # the scorer's place, and the variant


@dataclass(frozen=True, eq=False)
class _Tally:
    """The scores of one method, in the making."""

    entrant: Entrant
    scene: Scene
    log: Path | None
    limit_s: float | None
    means: dict[tuple[_Variant, str], dict[str, _Mean]] = field(default_factory=dict)  # by view, then by region
    reasons: dict[tuple[_Variant, str], str] = field(default_factory=dict)  # of views that could not be scored
    faults: dict[_Variant, str] = field(default_factory=dict)
    met: set[str] = field(default_factory=set)  # views that share points with another

    def add(self, pair: RestoredPair) -> None:
        """Score a pair by every metric, for both of its views."""
        names = (pair.here.view.name, pair.there.view.name)
        self.met.update(names)
        for place, scorer in enumerate(self.entrant.scorers):
            if plugins.missing_needs(scorer.plugin, self._has):
                continue
            for variant in scorer.variants:
                self._add((place, variant), pair, names)

    def _add(self, variant: _Variant, pair: RestoredPair, names: tuple[str, str]) -> None:
        if variant in self.faults:
            return
        scorer = self.entrant.scorers[variant[0]]
        at = f"metric '{scorer.plugin.name}:{variant[1]}' on views '{names[0]}' and '{names[1]}'"
        at = f"{at} by method '{self.entrant.bases[names[0]].method}'"
        try:
            with step(at, self.limit_s):
                scores = list(scorer.metric.score_pair(pair, variant[1]))
        except NotApplicableError as reason:
            self.reasons.update({(variant, name): one_line(reason) for name in names})
            return
        except BaseException as fault:
            base = self.entrant.bases[names[0]]
            where = f"{base.dataset} / {base.method} / {' and '.join(names)} / {scorer.plugin.name}:{variant[1]}"
            self.faults[variant] = kept_reason(fault, self.log, where)
            return
        for name in names:
            means = self.means.setdefault((variant, name), {})
            for score in scores:
                means.setdefault(score.region, _Mean()).add(score)

    @property
    def _has(self) -> frozenset[str]:
        return self.scene.has | {"restored_views"}

    def rows(self) -> Iterator[Row]:
        """Yield the rows of every view."""
        for name, base in self.entrant.bases.items():
            for place, scorer in enumerate(self.entrant.scorers):
                plugin = scorer.plugin
                code = self.entrant.code(base, scorer)
                of_metric = replace(base, code=code, metric=plugin.name, unit=plugin.unit)
                for variant in scorer.variants:
                    row = replace(of_metric, variant=variant, better=plugin.better_of(variant))
                    yield from self._rows((place, variant), name, row)

    def _rows(self, variant: _Variant, name: str, row: Row) -> Iterator[Row]:
        scorer = self.entrant.scorers[variant[0]]
        if absent := plugins.missing_needs(scorer.plugin, self._has):
            yield row_without_value(row, "skipped", absent)
            return
        if variant in self.faults:
            yield row_without_value(row, "failed", self.faults[variant])
            return
        means = self.means.get((variant, name), {})
        if not means:
            yield row_without_value(row, "skipped", self._why_not(variant, name))
        for region, mean in means.items():
            if mean.weight > 0:
                value, coverage = mean.total / mean.weight, mean.coverage / mean.pairs
                yield replace(row, region=region, value=value, n_pixels=mean.n_pixels, coverage=coverage)
            elif region == "image":
                yield row_without_value(row, "skipped", Reason.NO_VALUE.value)

    def _why_not(self, variant: _Variant, name: str) -> str:
        if len(self.entrant.bases) < 2:
            return Reason.ONE_VIEW.value
        if name not in self.met:
            return Reason.NO_OVERLAP.value
        return self.reasons.get((variant, name), Reason.NOTHING_TO_SCORE.value)
