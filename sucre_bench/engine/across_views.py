"""The last stage of a run: metrics of pairs of restored views, once all jobs have restored theirs.

It scores all views of a scene that a method has restored into the results folder, whichever run or process did it.
Options, data and code must be those of this run. The stored pictures are scored, which have 8 bits; J is there if the
run had save=full. Scores that are there are kept, unless a view has been added to or taken from the restored ones.
The score of a view is the mean over its pairs.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from cachetools import LRUCache, cached

from sucre_bench import plugins, results
from sucre_bench.arrays import Array, DataFrame, Mask
from sucre_bench.engine.common_pixels import Source
from sucre_bench.engine.preflight import Planned, Task, open_scenes, tasks
from sucre_bench.engine.score import (
    Scorer,
    check_regions,
    kept_reason,
    row_without_value,
    score_code,
    scorers,
)
from sucre_bench.errors import MissingFileError, NotApplicableError, one_line
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.processes import step
from sucre_bench.machine.text_formats import now
from sucre_bench.multiview.common_points import SharedPoints
from sucre_bench.restored_pair import RestoredPair, RestoredView
from sucre_bench.results.layout import log_path
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import PictureOnly
from sucre_bench.results.rows import Row, restorations, row_objects
from sucre_bench.results.table import Part
from sucre_bench.scene import Scene, Score

# Pairs whose points are in memory at once, 2 MB each at most.
_AT_ONCE = 200

# Bytes of a method's pictures in memory.
_HELD = 1 << 30


def score_across_views(planned: Sequence[Planned]) -> None:
    """Score what the jobs' metrics of pairs lack, and write the rows. Raises OutputError if they cannot be written."""
    chosen = [plan.job for plan in planned if any(m.plugin.is_of_pairs for m in plan.job.metrics)]
    if not chosen:
        return
    out = chosen[0].out
    try:
        rows = results.read(out)
    except MissingFileError:  # nothing was restored
        return
    part = Part(out, "pairs")
    groups: dict[
        str, dict[str, Job]
    ] = {}  # jobs on the same data; of several with one label, shards say, the first
    for job in chosen:
        key = results.fingerprint(
            {**job.dataset.record, **job.degrade.record, "replicate": job.replicate}
        )[1]
        groups.setdefault(f"{job.dataset.label} {key}", {}).setdefault(job.method.label, job)
    for group in groups.values():
        _score_dataset([*group.values()], rows, part)
    part.flush()


def _score_dataset(jobs: Sequence[Job], rows: DataFrame, part: Part) -> None:
    """Score all methods on the scenes of one dataset."""
    scenes = open_scenes(jobs[0].dataset)
    by_job: list[dict[str, list[Task]]] = []
    for job in jobs:
        by_scene: dict[str, list[Task]] = {}
        for task in tasks(job.of_all_views(), scenes):
            by_scene.setdefault(task.scene.name, []).append(task)
        by_job.append(by_scene)
    for name, every in by_job[0].items():
        found = [
            _entrant(job, by_scene[name], rows) for job, by_scene in zip(jobs, by_job, strict=True)
        ]
        if not (entrants := [entrant for entrant in found if entrant]):
            continue
        scene, log = (
            replace(every[0].scene, views=[task.view for task in every]),
            log_path(jobs[0].out),
        )
        with progress.line(f"pairs of views of {scene.name}", len(entrants)) as after_batch:
            for scored in pair_rows(scene, entrants, log, jobs[0].view_timeout_s, after_batch):
                part.add(scored)
        part.flush()


def _entrant(job: Job, every: Sequence[Task], rows: DataFrame) -> Entrant | None:
    """Return what a job has restored of a scene; None if nothing of it is to be scored.

    every: all views of the scene; rows: the score table.
    """
    base = every[0].base
    same = ("dataset", "method", "scene", "options_id", "data_id")
    of_job = rows[np.logical_and.reduce([rows[name] == getattr(base, name) for name in same])]
    wholes = restorations(of_job[of_job["code"] == base.code])
    stored = {row.view: replace(row, time=now()) for row in row_objects(wholes)}
    paths = {
        t.view.name: t.place.restored(job.out, job.method.label)
        for t in every
        if t.view.name in stored
    }
    there = {
        task.view.name: task
        for task in every
        if task.view.name in paths and paths[task.view.name].is_file()
    }

    def opened(name: str) -> RestoredView:
        task = there[name]
        source, shape = Source.stored(job.out, task.place, stored[name]), task.view.rgb.shape[:2]

        def mask() -> Mask:
            some = source.mask()
            return np.ones(shape, np.bool_) if some is None else some

        def computed() -> Array | None:
            kept = source.restoration(mask())
            return None if isinstance(kept, PictureOnly) else kept.image

        return RestoredView(task.view, lambda: source.shown(mask()), computed)

    # A hash of which views are restored, and of which J is stored.
    content = [(name, paths[name].with_suffix(".npz").is_file()) for name in there]
    among = hashlib.blake2b(json.dumps(content).encode(), digest_size=6).hexdigest()
    of_pairs = scorers(metric for metric in job.metrics if metric.plugin.is_of_pairs)
    entrant = Entrant({name: stored[name] for name in there}, opened, of_pairs, among)
    wanted = {
        (name, scorer.plugin.name, variant, entrant.code(whole, scorer))
        for name, whole in entrant.bases.items()
        for scorer in of_pairs
        for variant in scorer.variants
    }
    known = of_job[of_job["status"] != "failed"][["view", "metric", "variant", "code"]]
    scored = set(known.itertuples(index=False, name=None))
    if job.overwrite == "never":
        is_due = not {one[:3] for one in wanted} <= {one[:3] for one in scored}
    else:
        is_due = bool(wanted) and (job.overwrite == "always" or not wanted <= scored)
    return entrant if is_due else None


# -- the scores of pairs: the points that two views share are found once for all methods of a scene -----------------


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
        return score_code(base, scorer.code, self.among)


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
    has = scene.has | {"restored_views"}
    tallies = [
        [_Tally(entrant, scorer, variant, plugins.missing_needs(scorer.plugin, has), log, limit_s)
         for scorer in entrant.scorers for variant in scorer.variants]
        for entrant in entrants
    ]  # fmt: skip
    camera = next((view.camera for view in views if view.camera), None)
    # two images of three float32
    bytes_each = 24 * camera.width * camera.height if camera else _HELD
    shared = SharedPoints(views)
    overlaps = shared.overlaps()
    for start in range(0, len(overlaps), _AT_ONCE):
        batch = overlaps[start : start + _AT_ONCE]
        found = [
            (overlap, points) for overlap in batch if (points := shared.of(overlap)) is not None
        ]
        for entrant, of_entrant in zip(entrants, tallies, strict=True):
            held = cached(LRUCache[Any, RestoredView](max(4, _HELD // bytes_each)))(entrant.open)
            for overlap, points in found:
                first, second = views[overlap.first].name, views[overlap.second].name
                if first in entrant.bases and second in entrant.bases:
                    pair = RestoredPair(held(first), held(second), points, overlap.are_neighbours)
                    for tally in of_entrant:
                        tally.add(pair)
            after_batch()
    return [
        [row for name in entrant.bases for tally in of_entrant for row in tally.rows(name)]
        for entrant, of_entrant in zip(entrants, tallies, strict=True)
    ]


@dataclass(eq=False)
class _Tally:
    """The scores of one method by one variant of a metric, in the making.

    absent: what the scene lacks for it; fault: why it failed; scores: of pairs, by view, then by region; reasons: of
    views that could not be scored; met: the views that share points with another.
    """

    entrant: Entrant
    scorer: Scorer
    variant: str
    absent: str
    log: Path | None
    limit_s: float | None
    fault: str = ""
    scores: dict[str, dict[str, list[Score]]] = field(default_factory=dict)
    reasons: dict[str, str] = field(default_factory=dict)
    met: set[str] = field(default_factory=set)

    def add(self, pair: RestoredPair) -> None:
        """Score a pair, for both of its views."""
        names = (pair.here.view.name, pair.there.view.name)
        self.met.update(names)
        if self.absent or self.fault:
            return
        base, metric = self.entrant.bases[names[0]], f"{self.scorer.plugin.name}:{self.variant}"
        try:
            with step(
                f"metric '{metric}' on views '{names[0]}' and '{names[1]}' by method '{base.method}'",
                self.limit_s,
            ):
                scores = list(self.scorer.metric.score_pair(pair, self.variant))
                check_regions(score.region for score in scores)
        except NotApplicableError as reason:
            self.reasons.update(dict.fromkeys(names, one_line(reason)))
            return
        except BaseException as fault:
            where = f"{base.dataset} / {base.method} / {' and '.join(names)} / {metric}"
            self.fault = kept_reason(fault, self.log, where)
            return
        for name in names:
            for score in scores:
                self.scores.setdefault(name, {}).setdefault(score.region, []).append(score)

    def rows(self, name: str) -> Iterator[Row]:
        """Yield the rows of a view: its scores, or the reason why there is none."""
        plugin, base = self.scorer.plugin, self.entrant.bases[name]
        row = replace(
            base, code=self.entrant.code(base, self.scorer), metric=plugin.name, unit=plugin.unit
        )
        row = replace(row, variant=self.variant, better=plugin.better_of(self.variant))
        by_region = self.scores.get(name, {})
        if self.absent:
            yield row_without_value(row, "skipped", self.absent)
        elif self.fault:
            yield row_without_value(row, "failed", self.fault)
        elif not by_region:
            why = self.reasons.get(name, Reason.NOTHING_TO_SCORE.value)
            why = why if name in self.met else Reason.NO_OVERLAP.value
            yield row_without_value(
                row, "skipped", why if len(self.entrant.bases) > 1 else Reason.ONE_VIEW.value
            )
        else:
            for region, of_pairs in by_region.items():
                known = [
                    score for score in of_pairs if score.weight > 0 and not math.isnan(score.value)
                ]
                if known:
                    value = sum(score.weight * score.value for score in known) / sum(
                        score.weight for score in known
                    )
                    n_pixels = sum(int(score.n_pixels) for score in known)
                    coverage = sum(score.coverage for score in of_pairs) / len(of_pairs)
                    yield replace(
                        row, region=region, value=value, n_pixels=n_pixels, coverage=coverage
                    )
                elif region == "image":
                    yield row_without_value(row, "skipped", Reason.NO_VALUE.value)
