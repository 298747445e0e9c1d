"""Runs one job, view by view, to rows and pictures. A fault becomes a row, and the next view follows.

The process of the command keeps the rows; a worker restores and scores, as a rule (`engine.workers`).
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, coloured
from sucre_bench.engine.preflight import Planned, Task, base_row, names_hash, plan
from sucre_bench.engine.score import Scorer, row_of_fault, score_rows, scorers
from sucre_bench.engine.workers import Emit, Work
from sucre_bench.errors import InputError, NotApplicableError, OutputError, PluginError, raise_if_stop
from sucre_bench.imaging.display import displayed
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.cache import ArrayStore, shorten_records, storing
from sucre_bench.machine.compute import PeakMemory
from sucre_bench.machine.files import remove
from sucre_bench.machine.processes import step
from sucre_bench.machine.provenance import load
from sucre_bench.machine.text_formats import now
from sucre_bench.plugins.call_method import checked_restore, shown_with, with_truth
from sucre_bench.results.layout import decoded_path, file_name, log_path, pairs_path, restored_path
from sucre_bench.results.restorations import Measured, read_full, write_full, write_pictures, write_view
from sucre_bench.results.rows import Row
from sucre_bench.results.table import Part
from sucre_bench.scene import Scene, View

_FLUSH_S = 0.3  # most seconds until rows are on the disk
_PIXELS_OF_A_VIEW = 50_000  # of each view, for a scene's percentiles and means


class JobAtWork(Work):
    """A planned job: `work` restores and scores its views in a worker, which sends their rows to `keep`.

    `keep` and the other functions run in the process of the command and write the score table.

    after_view: called when a view is done.
    """

    def __init__(self, planned: Planned, after_view: Callable[[], None] = lambda: None) -> None:
        super().__init__(planned.name)
        self._planned, self._after_view = planned, after_view
        job = planned.job
        self._part = Part(job.out, file_name(f"{job.dataset.label}-{job.method.label}"), _FLUSH_S)
        self._n_done = 0
        self._shown = ExitStack()

    def begin(self) -> bool:
        """Show the progress; return whether there are views to do."""
        job = self._planned.job
        if self._planned.tasks and not self._planned.tasks[0].base.code.startswith(base_row(job).code):
            self._planned = plan(job)  # an earlier job has made files that this one reads
        n_todo = len(self._planned.todo)
        if n_todo:
            line = progress.line(f"{job.method.label} on {job.dataset.label}", n_todo)
            self._advance = self._shown.enter_context(line)
        return n_todo > 0

    def work(self, emit: Emit) -> None:
        """Restore and score the views that are left. It ends early if this process can open no more files."""
        job, todo = self._planned.job, self._planned.todo
        left = todo[self._n_done :]
        try:
            with step(f"the start of method '{job.method.label}'"):
                method, metrics = job.method.make(), scorers(m for m in job.metrics if not m.plugin.is_of_pairs)
                make_ready(method)
        except BaseException as fault:
            whole = row_of_fault(base_row(job), fault, log_path(job.out), is_said=True)
            for task in left:
                emit([replace(whole, scene=task.base.scene, view=task.view.name, data_id=task.base.data_id)])
            return
        with ExitStack() as block:
            if job.shared_pairs:
                from sucre_bench.multiview.stored_pairs import sharing

                block.enter_context(sharing(pairs_path(job.out) / job.shared_pairs, job.pairs_gb * 2**30))
            if job.cache_gb and decoded_path(job.out).is_dir():
                block.enter_context(storing(ArrayStore(decoded_path(job.out), job.cache_gb * 2**30)))
            shown_over = {task.base.scene: self._planned.shown_over.get(task.base.scene, ()) for task in left}
            scenes = {scene: _SceneColours.of(job, method, views) for scene, views in shown_over.items() if views}
            for task in left:
                timed, over = replace(task, base=replace(task.base, time=now())), scenes.get(task.base.scene)
                emit(_restored_and_scored(job, method, metrics, timed, over))
                if not _can_open_files():
                    return

    def keep(self, rows: Sequence[Row]) -> None:
        """Keep the rows of the next view; without rows, write those that have waited. OutputError if that fails."""
        self._n_done += bool(rows)
        self._part.add(rows)
        if rows:
            self._advance()
            self._after_view()

    def is_left(self) -> bool:
        """Whether views are left."""
        return self._n_done < len(self._planned.todo)

    def fail(self, fault: Exception) -> None:
        """Give up: the job's row says why."""
        job = self._planned.job
        self._part.add([row_of_fault(base_row(job), fault, log_path(job.out), is_said=True)])

    def end(self) -> None:
        """Write what is not written yet."""
        self._shown.close()
        self._part.flush()
        job = self._planned.job
        shorten_records(restored_path(job.out, file_name(job.dataset.label), job.method.label))


def _can_open_files() -> bool:
    """Whether the method has left this process room for files."""
    try:
        os.close(os.open(os.devnull, os.O_RDONLY))
    except OSError:
        return False
    return True


def make_ready(method: Any) -> None:
    """Let a method import and compile, so that the first view's time is not that of imports.

    One that has a `warm_up()` imports there what its options need. For others all that they require is imported.
    """
    if hasattr(method, "warm_up"):
        method.warm_up()
        return
    for package in method.__plugin__.requires:
        load(f"method '{method.__plugin__.name}'", package)


def measured_restore(method: Any, scene: Scene, view: View, word: str = "method") -> Measured:
    """Restore a view and measure it. PluginError when the result is not what a method must return.

    word: see `checked_restore`. The view's own planes are decoded before the clock starts: reading the target is not
    restoring it. Where a method says of itself in `info` what it took ("seconds", "peak_mb"), since its work was done
    elsewhere, that counts.
    """
    _ = view.rgb.shape, view.has_depth
    with PeakMemory() as memory:
        started = time.perf_counter()
        restoration = checked_restore(method, scene, view, word)
        seconds = time.perf_counter() - started
    info = restoration.info
    took = (float(info.get(name, measured)) for name, measured in (("seconds", seconds), ("peak_mb", memory.peak_mb)))
    return Measured(with_truth(restoration, scene, view), *took)


def _restored_and_scored(
    job: Job, method: Any, metrics: Sequence[Scorer], task: Task, over: _SceneColours | None = None
) -> list[Row]:
    """Restore, store and score one view. over: colours of its scene, where all views of a scene are shown alike."""
    view, log = task.view, log_path(job.out)
    decides = over is not None and view.name in over.views  # its colours are among them, so it is restored already
    try:
        with step(f"view '{view.name}' by method '{job.method.label}'"):
            afresh = job.overwrite == "always" and not decides
            measured = _stored_or_restored(job, method, task, afresh, job.save == "full")
            write_view(job.out, task.place, view)
            colours = over.colours if over and over.colours.size else None
            shown, filled = displayed(measured.restoration, job.method.display, view.encoding, colours)
            look = (job.bits, over.hash if over else "")
            write_pictures(job.out, task.place, job.method.label, measured.restoration, shown, filled, *look)
            base = replace(task.base, seconds=measured.seconds, peak_mb=measured.peak_mb)
            return score_rows(measured.restoration, shown, view, metrics, base, log, job.view_timeout_s)
    except BaseException as fault:
        raise_if_stop(fault)
        if _can_open_files():
            if isinstance(fault, OutputError):
                raise
            return [row_of_fault(task.base, fault, log, is_said=True)]
        no_files = PluginError("no file can be opened after it; see that the method closes its files")
        return [row_of_fault(task.base, no_files, log, is_said=True)]


def _stored_or_restored(job: Job, method: Any, task: Task, afresh: bool, is_stored: bool) -> Measured:
    """Return the restoration of one view. afresh: also where it is stored already; is_stored: whether to store it.

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
    at = f"method '{job.method.label}' on view '{name}'"
    try:
        with step(at, job.view_timeout_s), shown_with(job.method.display, in_full=is_stored):
            measured = measured_restore(method, scene, view, job.method.word)
    except OutputError as fault:  # of its own files, in a full TMPDIR for example: results can still be written
        raise InputError(fault.fault, fault.place, fault.remedy) from fault
    if is_stored:
        write_full(whole, measured, task.base)
    else:
        remove(whole)  # of another restoration than the picture that is now beside it
    return measured


@dataclass(frozen=True, eq=False)
class _SceneColours:
    """Colours (N, 1, 3) of a scene, by which all its views are shown; the views that have them; the hash of these."""

    colours: Array
    views: frozenset[str]
    hash: str

    @classmethod
    def of(cls, job: Job, method: Any, tasks: Sequence[Task]) -> _SceneColours:
        """Restore the views that decide how a scene is shown, and store them for later jobs; so many fit in memory.

        A view that cannot be restored is left out; it gets its row when it is to be shown.
        """
        colours, names = [np.zeros((0, 3), np.float32)], list[str]()
        for task in progress.track(tasks, "before showing"):
            try:
                image = _stored_or_restored(job, method, task, job.overwrite == "always", True).restoration.image
            except OutputError:
                raise
            except BaseException as fault:
                raise_if_stop(fault)
                continue
            names.append(task.view.name)
            pixels = image[coloured(image)]
            colours.append(pixels[:: max(1, len(pixels) // _PIXELS_OF_A_VIEW)])
        return cls(np.concatenate(colours)[:, None], frozenset(names), names_hash(names))
