"""The last stage of a run: metrics of pairs of restored views, once all jobs have restored theirs.

It scores all views of a scene that a method has restored into the results folder, whichever run or process did it.
Options, data and code must be those of this run. The stored pictures are scored, which have 8 bits; J is there if the
run had save=full. Scores that are there are kept, unless a view has been added to or taken from the restored ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Array, DataFrame, Mask
from sucre_bench.engine.common_pixels import Source
from sucre_bench.engine.preflight import Planned
from sucre_bench.engine.score import scorers
from sucre_bench.engine.score_pairs import Entrant, pair_rows
from sucre_bench.engine.select_views import Task, open_scenes, tasks
from sucre_bench.errors import MissingFileError
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import now
from sucre_bench.restored_pair import RestoredView
from sucre_bench.results.layout import log_path
from sucre_bench.results.restorations import PictureOnly
from sucre_bench.results.rows import restorations, row_objects
from sucre_bench.results.table import Part


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
    groups: dict[str, dict[str, Job]] = {}  # jobs on the same data; of several with one label, shards say, the first
    for job in chosen:
        key = results.fingerprint({**job.dataset.record, **job.degrade.record, "replicate": job.replicate})[1]
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
        found = [_entrant(job, by_scene[name], rows) for job, by_scene in zip(jobs, by_job, strict=True)]
        if not (entrants := [entrant for entrant in found if entrant]):
            continue
        scene, log = replace(every[0].scene, views=[task.view for task in every]), log_path(jobs[0].out)
        with progress.line(f"pairs of views of {scene.name}", len(entrants)) as step:
            for scored in pair_rows(scene, entrants, log, jobs[0].view_timeout_s, step):
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
    paths = {t.view.name: t.place.restored(job.out, job.method.label) for t in every if t.view.name in stored}
    there = {task.view.name: task for task in every if task.view.name in paths and paths[task.view.name].is_file()}

    def opened(name: str) -> RestoredView:
        task = there[name]
        source, shape = Source.stored(job.out, task.place, stored[name]), task.view.rgb.shape[:2]

        def mask() -> Mask:
            some = source.mask()
            return np.ones(shape, np.bool_) if some is None else some

        def computed() -> Array | None:
            kept = source.restoration(mask())
            return None if isinstance(kept, PictureOnly) else kept.image

        return RestoredView(task.view, lambda: source.shown(mask(), paths[name]), computed)

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
