"""Runs one job, view by view, to rows and pictures. A fault becomes a row, and the next view follows."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, coloured
from sucre_bench.engine.done_views import Done
from sucre_bench.engine.failed_rows import failed_row, row_of_fault
from sucre_bench.engine.guard import limited, unharmed
from sucre_bench.engine.measured_restore import make_ready, measured_restore
from sucre_bench.engine.method_hints import hints_of
from sucre_bench.engine.score import Scorer, score_rows, scorers
from sucre_bench.engine.select_views import Task, open_scenes, tasks
from sucre_bench.engine.share_decoded import sharing_decoded
from sucre_bench.errors import (
    DiskFullError,
    InputError,
    NotApplicableError,
    OutputError,
    SucreBenchError,
    raise_if_stop,
)
from sucre_bench.imaging.display import displayed, is_of_scene
from sucre_bench.jobs.job import Job
from sucre_bench.loading.shared_pixels import with_shared_pixels
from sucre_bench.machine import progress
from sucre_bench.machine.current_step import earlier_start, step
from sucre_bench.machine.files import remove
from sucre_bench.machine.records import now
from sucre_bench.multiview.stored_pairs import sharing
from sucre_bench.plugins.call_method import shown_with, with_truth
from sucre_bench.results.layout import file_name, log_path, pairs_path
from sucre_bench.results.restorations import Measured, read_full, write_full, write_pictures
from sucre_bench.results.rows import Row
from sucre_bench.results.table import FLUSH_S, Part


def run_job(job: Job, after_view: Callable[[], None] = lambda: None, flush_s: float = FLUSH_S) -> None:
    """Restore and score every selected view that is not done yet, writing rows and pictures under job.out.

    after_view: called when a view is done, computed or not; flush_s: most seconds until rows are on the disk.
    Faults become rows. If rows cannot be written, a line says so; DiskFullError is raised, since no job can write then.
    """
    try:
        _run_views(job, after_view, flush_s)
    except DiskFullError:
        raise
    except SucreBenchError as fault:
        progress.say(f"failed  {job.dataset.label} / {job.method.label}: {fault}", is_fault=True)


def _run_views(job: Job, after_view: Callable[[], None], flush_s: float) -> None:
    part = Part(job.out, file_name(f"{job.dataset.label}-{job.method.label}"), flush_s)
    try:
        every = list(tasks(job, [with_shared_pixels(scene) for scene in open_scenes(job.dataset)]))
        done = Done.of(job, earlier_start())
    except BaseException as fault:
        part.add([failed_row(job, fault)])
        part.flush()
        return
    todo = [task for task in every if not done.covers(task.base, task.place.restored(job.out, job.method.label))]
    if is_of_scene(job.method.display):  # one more view changes how all are shown
        todo = [task for task in every if task.base.scene in {other.base.scene for other in todo}]
    for _ in range(len(every) - len(todo)):
        after_view()
    if not todo:
        return
    try:
        with step(f"the start of method '{job.method.label}'"):
            method, metrics = job.method.make(), scorers(m for m in job.metrics if not m.plugin.is_of_pairs)
            make_ready(method)
    except BaseException as fault:
        whole = failed_row(job, fault)
        part.add([replace(whole, scene=t.base.scene, view=t.view.name, data_id=t.base.data_id) for t in todo])
        part.flush()
        return
    try:
        views = {task.view.name for task in todo}
        with _shared_pairs(job), sharing_decoded(job), hints_of(job, views):
            over = _scene_colours(job, method, todo) if is_of_scene(job.method.display) else None
            for task in progress.track(todo, f"{job.method.label} on {job.dataset.label}"):
                part.add(_rows(job, method, metrics, replace(task, base=replace(task.base, time=now())), over))
                after_view()
    finally:
        part.flush()


def _shared_pairs(job: Job) -> AbstractContextManager[None]:
    """Where the job's method shares pairs with those of other jobs."""
    return sharing(pairs_path(job.out) / job.shared_pairs, job.pairs_gb * 2**30) if job.shared_pairs else nullcontext()


# -- doing it ----------------------------------------------------------------------------------------------


def _rows(
    job: Job, method: Any, metrics: Sequence[Scorer], task: Task, over: Mapping[str, Array] | None = None
) -> list[Row]:
    """Restore, keep and score one view. over: colours of each scene, where all views of a scene are shown alike."""
    try:
        measured = _measured(job, method, task, afresh=job.overwrite == "always" and over is None)
        return _scored(job, metrics, task, measured, None if over is None else over.get(task.base.scene))
    except OutputError:
        raise
    except BaseException as fault:
        return [row_of_fault(task.base, fault, log_path(job.out), is_said=True)]


def _measured(job: Job, method: Any, task: Task, *, afresh: bool) -> Measured:
    """Return the restoration of one view, stored with save=full. afresh: also where it is stored already.

    Raises NotApplicableError where the method needs more than the view has, and what the method raises.
    """
    scene, view = task.scene, task.view
    if absent := plugins.missing_needs(job.method.plugin, scene.has):
        raise NotApplicableError(absent)
    if "depth" in job.method.plugin.needs and not view.has_depth:
        raise NotApplicableError(f"{view.name} has no depth map")
    whole = task.place.restored(job.out, job.method.label).with_suffix(".npz")
    if not afresh and (kept := read_full(whole, task.base)):
        return replace(kept, restoration=with_truth(kept.restoration, scene, view))
    name = "/".join(filter(None, (task.base.dataset, task.base.scene, view.name)))
    at, limit_s = f"method '{job.method.label}' on view '{name}'", job.view_timeout_s
    try:
        with step(at, limit_s), limited(limit_s), unharmed(), shown_with(job.method.display):
            measured = measured_restore(method, scene, view)
    except OutputError as fault:  # of its own files, in a full TMPDIR for example: results can still be written
        raise InputError(fault.fault, fault.place, fault.remedy) from fault
    if job.save == "full":
        write_full(whole, measured, task.base)
    else:
        remove(whole)  # of another restoration than the picture that is now beside it
    return measured


# Pixels of each view that a scene's percentiles and means are taken of.
_PIXELS_OF_A_VIEW = 50_000


def _scene_colours(job: Job, method: Any, todo: Sequence[Task]) -> dict[str, Array]:
    """Restore all views, and return colours (N, 1, 3) of each scene, evenly from its views.

    A view that cannot be restored is left out; it gets its row when it is to be shown.
    """
    colours: dict[str, list[Array]] = {}
    for task in progress.track(todo, f"{job.method.label} on {job.dataset.label}, before showing"):
        try:
            image = _measured(job, method, task, afresh=job.overwrite == "always").restoration.image
        except OutputError:
            raise
        except BaseException as fault:
            raise_if_stop(fault)
            continue
        pixels = image[coloured(image)]
        colours.setdefault(task.base.scene, []).append(pixels[:: max(1, len(pixels) // _PIXELS_OF_A_VIEW)])
    return {scene: np.concatenate(kept)[:, None] for scene, kept in colours.items()}


def _scored(
    job: Job, metrics: Sequence[Scorer], task: Task, measured: Measured, over: Array | None = None
) -> list[Row]:
    """Keep the picture, and score it."""
    restoration, view = measured.restoration, task.view
    shown, filled = displayed(restoration, job.method.display, view.encoding, over)
    write_pictures(job.out, task.place, job.method.label, view, restoration, shown, filled)
    return score_rows(measured, shown, view, metrics, task.base, log_path(job.out), job.view_timeout_s)
