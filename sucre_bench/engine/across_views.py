"""The last stage of a run: metrics of pairs of restored views, once all jobs have restored theirs.

It scores all views of a scene that a method has restored into the results folder, whichever run or process did it, as
far as options, data and code are those of this run. The stored pictures are scored, which have 8 bits; J is there if
the run had save=full. Scores that are there are kept, unless a view has been added to or taken from the restored ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.engine.preflight import Planned
from sucre_bench.engine.score import Scorer, scorers
from sucre_bench.engine.score_pairs import Entrant, pair_rows
from sucre_bench.engine.select_views import Task, open_scenes, tasks
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.records import now
from sucre_bench.restored_pair import RestoredView
from sucre_bench.results.layout import log_path
from sucre_bench.results.restorations import PictureOnly, masked, stored_mask, stored_picture, stored_restoration
from sucre_bench.results.rows import Row, restorations, row_objects
from sucre_bench.results.table import Part
from sucre_bench.scene import Scene


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
    for jobs in _by_data(chosen):
        _score_dataset(jobs, rows, part)
    part.flush()


def _by_data(jobs: Sequence[Job]) -> Iterator[list[Job]]:
    """Jobs on the same data together; of several with one label, shards for example, the first."""
    groups: dict[str, dict[str, Job]] = {}
    for job in jobs:
        key = results.fingerprint({**job.dataset.record, **job.degrade.record, "replicate": job.replicate})[1]
        groups.setdefault(f"{job.dataset.label} {key}", {}).setdefault(job.method.label, job)
    return (list(group.values()) for group in groups.values())


def _score_dataset(jobs: Sequence[Job], rows: DataFrame, part: Part) -> None:
    """Score all methods on the scenes of one dataset."""
    scenes = open_scenes(jobs[0].dataset)
    by_job = [_by_scene(job, scenes) for job in jobs]
    for name in by_job[0]:
        every = [_Restored.of(job, by_scene[name], rows) for job, by_scene in zip(jobs, by_job, strict=True)]
        todo = [restored for restored in every if restored.is_due]
        if not todo:
            continue
        scene = todo[0].tasks[0].scene
        views = [task.view for task in by_job[0][name]]
        entrants, log = [restored.entrant for restored in todo], log_path(jobs[0].out)
        with progress.line(f"pairs of views of {scene.name}", len(todo)) as step:
            for scored in pair_rows(replace(scene, views=views), entrants, log, jobs[0].view_timeout_s, step):
                part.add(scored)
        part.flush()


def _by_scene(job: Job, scenes: Sequence[Scene]) -> dict[str, list[Task]]:
    """Every view of each scene, also those that the job was not asked for."""
    found: dict[str, list[Task]] = {}
    for task in tasks(job.of_all_views(), scenes):
        found.setdefault(task.scene.name, []).append(task)
    return found


@dataclass(frozen=True, eq=False)
class _Restored:
    """The restored views of a scene by one job.

    tasks: of these views; bases: what their rows say, by view; scored: (view, metric, variant, code) of the scores in
    the table, failed ones left out.
    """

    job: Job
    tasks: tuple[Task, ...]
    bases: Mapping[str, Row]
    scorers: tuple[Scorer, ...]
    scored: frozenset[tuple[str, str, str, str]]

    @classmethod
    def of(cls, job: Job, every: Sequence[Task], rows: DataFrame) -> _Restored:
        """Find what the results folder holds. every: all views of the scene."""
        base = every[0].base
        of_job = rows[
            (rows["dataset"] == base.dataset) & (rows["method"] == base.method) & (rows["scene"] == base.scene)
        ]
        of_job = of_job[(of_job["options_id"] == base.options_id) & (of_job["data_id"] == base.data_id)]
        wholes = restorations(of_job[of_job["code"] == base.code])
        stored = {row.view: row for row in row_objects(wholes)}
        there = [t for t in every if t.view.name in stored and t.place.restored(job.out, job.method.label).is_file()]
        known = of_job[of_job["status"] != "failed"][["view", "metric", "variant", "code"]]
        return cls(
            job,
            tuple(there),
            {task.view.name: replace(stored[task.view.name], time=now()) for task in there},
            scorers(m for m in job.metrics if m.plugin.is_of_pairs),
            frozenset(known.itertuples(index=False, name=None)),
        )

    @property
    def is_due(self) -> bool:
        """Whether there is anything to score that is not scored already."""
        wanted = {
            (name, scorer.plugin.name, variant, self.entrant.code(base, scorer))
            for name, base in self.bases.items()
            for scorer in self.scorers
            for variant in scorer.variants
        }
        if self.job.overwrite == "never":
            there = {one[:3] for one in self.scored}
            return any(one[:3] not in there for one in wanted)
        return bool(wanted) and (self.job.overwrite == "always" or not wanted <= self.scored)

    @cached_property
    def entrant(self) -> Entrant:
        """What `pair_rows` takes."""
        by_name = {task.view.name: task for task in self.tasks}

        def opened(name: str) -> RestoredView:
            of = self.job.out, by_name[name], self.bases[name]
            return RestoredView(by_name[name].view, partial(_shown, *of), partial(_computed, *of))

        return Entrant(self.bases, opened, self.scorers, self._among)

    @property
    def _among(self) -> str:
        """A hash of which views are restored, and of which J is stored."""
        wholes = [task.place.restored(self.job.out, self.job.method.label).with_suffix(".npz") for task in self.tasks]
        content = [(task.view.name, whole.is_file()) for task, whole in zip(self.tasks, wholes, strict=True)]
        return hashlib.blake2b(json.dumps(content).encode(), digest_size=6).hexdigest()


def _shown(out: Path, task: Task, base: Row) -> Array:
    """The stored picture (H, W, 3) in [0, 1], NaN = no colour. Raises InputError if it is gone or damaged."""
    picture = stored_picture(out, task.place, base.method)
    mask = stored_mask(out, task.place, base)
    if not picture.shape[:2] == mask.shape == task.view.rgb.shape[:2]:
        path = task.place.restored(out, base.method)
        raise InputError("is not of the size of its view", path, "repeat its run's command with overwrite=always")
    return masked(picture.astype(np.float32) / np.float32(255), mask)


def _computed(out: Path, task: Task, base: Row) -> Array | None:
    """J (H, W, 3), if it is stored."""
    kept = stored_restoration(out, task.place, base, stored_mask(out, task.place, base))
    return None if isinstance(kept, PictureOnly) else kept.image
