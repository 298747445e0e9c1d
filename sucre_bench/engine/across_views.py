"""The last stage of a run: metrics of pairs of restored views, once all jobs have restored theirs.

It scores all views of a scene that a method has restored into the results folder, whichever run or process did it.
Options, data and code must be those of this run. The stored pictures are scored, rounded to their bits; J is there if
the run had save=full. Scores that are there are kept, unless a view has been added to or taken from the restored ones.
The score of a view is the mean over its pairs.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from cachetools import LRUCache, cached

from sucre_bench import plugins
from sucre_bench.arrays import Array, DataFrame, Mask
from sucre_bench.engine.common_pixels import Source
from sucre_bench.engine.preflight import Planned, Task, open_scenes, stored_rows, tasks_by_scene
from sucre_bench.engine.score import (
    Scorer,
    row_of_fault,
    row_without_value,
    score_code,
    scorers,
)
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import now, short_hash
from sucre_bench.multiview.common_points import SharedPoints
from sucre_bench.restored_pair import RestoredPair, RestoredView
from sucre_bench.results.layout import log_path
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import PictureOnly
from sucre_bench.results.rows import Row, Status, restorations, row_objects, values_of
from sucre_bench.results.table import Part
from sucre_bench.scene import Scene, Score

# Pairs whose points are in memory at once, 2 MB each at most.
_AT_ONCE = 200

# Bytes of a method's pictures in memory.
_HELD = 1 << 30


def score_across_views(planned: Sequence[Planned]) -> None:
    """Score what the jobs' metrics of pairs lack, and write the rows. Raises OutputError if they cannot be written."""
    # jobs on the same data by their methods; of several with one label, shards say, the first
    groups = defaultdict[tuple[str, int], dict[str, Job]](dict)
    for job in (plan.job for plan in planned):
        if any(metric.plugin.is_of_pairs for metric in job.metrics):
            groups[job.dataset.label, job.replicate].setdefault(job.method.label, job)
    rows = stored_rows(planned[0].job)
    part = Part(planned[0].job.out, "pairs")
    for group in groups.values():
        _score_dataset([*group.values()], rows, part)
    part.flush()


def _score_dataset(jobs: Sequence[Job], rows: DataFrame, part: Part) -> None:
    """Score all methods on the scenes of one dataset."""
    scenes = open_scenes(jobs[0].dataset)
    by_job = [tasks_by_scene(job.of_all_views(), scenes) for job in jobs]
    for name, every in by_job[0].items():
        found = [
            _entrant(job, by_scene[name], rows)
            for job, by_scene in zip(jobs, by_job, strict=True)
        ]
        entrants = [entrant for entrant in found if entrant]
        if not entrants:
            continue
        scene = replace(every[0].scene, views=[task.view for task in every])
        with progress.line(f"pairs of views of {scene.name}", len(entrants)) as after_batch:
            for scored in pair_rows(scene, entrants, after_batch):
                part.add(scored)
        part.flush()


def _entrant(job: Job, every: Sequence[Task], rows: DataFrame) -> Entrant | None:
    """Return what a job has restored of a scene; None if nothing of it is to be scored.

    every: all views of the scene; rows: the score table.
    """
    base = every[0].base
    same = ("dataset", "method", "scene", "options_id", "data_id")
    of_job = rows[np.logical_and.reduce([rows[name] == getattr(base, name) for name in same])]
    stored = {
        row.view: replace(row, time=now())
        for row in row_objects(restorations(of_job[of_job["code"] == base.code]))
    }
    there = dict[str, Task]()
    content = list[tuple[str, bool]]()  # which views are restored, and of which J is stored
    for task in every:
        picture = task.place.restored(job.out, job.method.label)
        if task.view.name in stored and picture.is_file():
            there[task.view.name] = task
            content.append((task.view.name, picture.with_suffix(".npz").is_file()))

    def opened(name: str) -> RestoredView:
        task = there[name]
        source = Source.stored(job.out, task.place, stored[name])

        def mask() -> Mask:
            some = source.mask()
            return np.ones(task.view.rgb.shape[:2], np.bool_) if some is None else some

        def computed() -> Array | None:
            kept = source.restoration(mask())
            return None if isinstance(kept, PictureOnly) else kept.image

        return RestoredView(task.view, lambda: source.shown(mask()), computed)

    of_pairs = [metric for metric in job.metrics if metric.plugin.is_of_pairs]
    entrant = Entrant(
        {name: stored[name] for name in there},
        opened,
        scorers(of_pairs, log_path(job.out), job.view_timeout_s),
        short_hash(json.dumps(content)),
    )
    wanted = {
        (name, scorer.plugin.name, variant, entrant.code(whole, scorer))
        for name, whole in entrant.bases.items()
        for scorer in entrant.scorers
        for variant in scorer.variants
    }
    worked = of_job[of_job["status"] != "failed"]
    scored = set(values_of(worked, "view", "metric", "variant", "code"))
    is_due = job.overwrite == "always" or not wanted <= scored
    return entrant if wanted and is_due else None


# -- the scores of pairs: the points that two views share are found once for all methods of a scene -----------------


@dataclass(frozen=True, eq=False)
class Entrant:
    """What one method made of a scene."""

    bases: Mapping[str, Row]
    """What the rows of a restored view say, by the view's name."""

    open: Callable[[str], RestoredView]
    """Returns the restored view of a name."""

    scorers: Sequence[Scorer]
    """Metrics of pairs."""

    among: str = ""
    """A hash of the restored views, which ends the `code` of their rows."""

    def code(self, base: Row, scorer: Scorer) -> str:
        """Return the `code` of a score's rows."""
        return score_code(base, scorer.code, self.among)


def pair_rows(
    scene: Scene, entrants: Sequence[Entrant], after_batch: Callable[[], None] = lambda: None
) -> list[list[Row]]:
    """Return the rows of each method: a score for each of its views, or the reason why there is none.

    after_batch: called when a method has been scored on 200 more pairs, or on all.
    """
    names = {name for entrant in entrants for name in entrant.bases}
    views = [view for view in scene.views if view.name in names]
    has = scene.has | {"restored_views"}
    tallies = [
        [
            _Tally(entrant, scorer, variant, has)
            for scorer in entrant.scorers
            for variant in scorer.variants
        ]
        for entrant in entrants
    ]
    camera = next((view.camera for view in views if view.camera), None)
    # two images of three float32
    bytes_each = 24 * camera.width * camera.height if camera else _HELD
    shared = SharedPoints(views)
    overlaps = shared.overlaps()
    for start in range(0, len(overlaps), _AT_ONCE):
        batch = [
            (overlap, shared.of(overlap)) for overlap in overlaps[start : start + _AT_ONCE]
        ]
        for entrant, of_entrant in zip(entrants, tallies, strict=True):
            held = cached(LRUCache[Any, RestoredView](max(4, _HELD // bytes_each)))(
                entrant.open
            )
            for overlap, points in batch:
                first, second = views[overlap.first].name, views[overlap.second].name
                if points is not None and entrant.bases.keys() >= {first, second}:
                    pair = RestoredPair(
                        held(first), held(second), points, overlap.are_neighbours
                    )
                    for tally in of_entrant:
                        tally.add(pair)
            after_batch()
    return [
        [row for name in entrant.bases for tally in of_entrant for row in tally.rows(name)]
        for entrant, of_entrant in zip(entrants, tallies, strict=True)
    ]


class _Tally:
    """The scores of one method by one variant of a metric, in the making. has: what the scene offers."""

    def __init__(
        self, entrant: Entrant, scorer: Scorer, variant: str, has: frozenset[str]
    ) -> None:
        self.entrant = entrant
        self.scorer = scorer
        self.variant = variant
        # Status and reason of all rows, if there are no scores.
        absent = plugins.missing_needs(scorer.plugin, has)
        self.lost: tuple[Status, str] | None = ("skipped", absent) if absent else None
        # Scores of pairs, by view, then by region.
        self.scores = defaultdict[str, dict[str, list[Score]]](dict)
        # Why a view has none, of those that share points with another.
        self.reasons = dict[str, str]()

    def _base(self, name: str) -> Row:
        """What the rows of a view say."""
        plugin = self.scorer.plugin
        whole = self.entrant.bases[name]
        return replace(
            whole,
            code=self.entrant.code(whole, self.scorer),
            metric=plugin.name,
            unit=plugin.unit,
            variant=self.variant,
            better=plugin.better_of(self.variant),
        )

    def add(self, pair: RestoredPair) -> None:
        """Score a pair, for both of its views."""
        if self.lost:
            return
        names = (pair.here.view.name, pair.there.view.name)
        base = replace(self._base(names[0]), view=" and ".join(names))
        score_pair = self.scorer.metric.score_pair
        try:
            scores = self.scorer.scores(base, f"views {names}", score_pair, pair, self.variant)
        except BaseException as fault:
            row = row_of_fault(base, fault, self.scorer.log)
            if row.status == "failed":
                self.lost = row.status, row.reason
            self.reasons |= dict.fromkeys(names, row.reason)
            return
        for name in names:
            self.reasons.setdefault(name, Reason.NOTHING_TO_SCORE.value)
            for score in scores:
                self.scores[name].setdefault(score.region, []).append(score)

    def rows(self, name: str) -> Iterator[Row]:
        """Yield the rows of a view: its scores, or the reason why there is none."""
        row = self._base(name)
        by_region = self.scores[name]
        if self.lost:
            yield row_without_value(row, *self.lost)
        elif not by_region:
            alone = Reason.NO_OVERLAP if len(self.entrant.bases) > 1 else Reason.ONE_VIEW
            yield row_without_value(row, "skipped", self.reasons.get(name, alone.value))
        else:
            for region, of_pairs in by_region.items():
                known = [
                    score
                    for score in of_pairs
                    if score.weight > 0 and not math.isnan(score.value)
                ]
                if known:
                    weight = sum(score.weight for score in known)
                    yield replace(
                        row,
                        region=region,
                        value=sum(score.weight * score.value for score in known) / weight,
                        n_pixels=sum(int(score.n_pixels) for score in known),
                        coverage=sum(score.coverage for score in of_pairs) / len(of_pairs),
                    )
                elif region == "image":
                    yield row_without_value(row, "skipped", Reason.NO_VALUE.value)
