"""Runs views of one job to rows and pictures. A fault becomes a row, and the next view follows.

This runs in a worker, as a rule; `engine.workers` gives it the views and keeps the rows.
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
from sucre_bench.engine.preflight import Planned, Task, base_row, names_hash
from sucre_bench.engine.score import Scorer, row_of_fault, score_rows, scorers
from sucre_bench.errors import (
    InputError,
    NotApplicableError,
    OutputError,
    PluginError,
    raise_if_stop,
)
from sucre_bench.imaging.colour_profiles import restoration_in_srgb, view_in_srgb
from sucre_bench.imaging.display import displayed
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.cache import ArrayStore, storing
from sucre_bench.machine.compute import PeakMemory
from sucre_bench.machine.files import writing
from sucre_bench.machine.processes import Send, step
from sucre_bench.machine.provenance import load
from sucre_bench.machine.text_formats import now
from sucre_bench.plugins.call_method import (
    checked_restore,
    shown_with,
    with_truth,
)
from sucre_bench.results.layout import decoded_path, log_path, pairs_path
from sucre_bench.results.restorations import (
    Measured,
    read_full,
    write_full,
    write_pictures,
    write_view,
)
from sucre_bench.results.rows import Row
from sucre_bench.scene import Scene, View

_PIXELS_OF_A_VIEW = 50_000  # of each view, for a scene's percentiles and means


def serve(planned: Planned, send: Send, take: Callable[[], Sequence[int]]) -> None:
    """Restore and score views of a job, as places in `planned.todo`, which `take` gives until none is left.

    Sends "ready" whenever it takes some, or "unfit" and a row if the method cannot be made; then "rows", a view's place
    and its rows. Raises OutputError.
    """
    job = planned.job
    try:
        at = f"the start of method '{job.method.label}'"
        with step(at):
            method = job.method.make()
            of_views = [metric for metric in job.metrics if not metric.plugin.is_of_pairs]
            metrics = scorers(of_views, log_path(job.out), job.view_timeout_s)
            make_ready(method)
    except BaseException as fault:
        send("unfit", row_of_fault(base_row(job), fault, log_path(job.out)))
        return
    with ExitStack() as block:
        if job.shared_pairs:
            from sucre_bench.multiview.stored_pairs import sharing

            block.enter_context(
                sharing(pairs_path(job.out) / job.shared_pairs, job.pairs_gb * 2**30)
            )
        if planned.shares_decoded:
            block.enter_context(
                storing(ArrayStore(decoded_path(job.out), job.cache_gb * 2**30))
            )
        scenes: dict[str, _SceneColours] = {}
        while True:
            send("ready")
            places = take()
            if not places:
                return
            for place in places:
                task = planned.todo[place]
                scene = task.base.scene
                if scene not in scenes and (over := planned.shown_over.get(scene)):
                    scenes[scene] = _SceneColours.of(job, method, over)
                timed = replace(task, base=replace(task.base, time=now()))
                rows = _restored_and_scored(job, method, metrics, timed, scenes.get(scene))
                send("rows", place, rows)
            if not _can_open_files():
                return


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


def measured_restore(method: Any, scene: Scene, view: View, in_srgb: bool = True) -> Measured:
    """Restore a view and measure it. PluginError when the result is not what a method must return.

    The view's own planes are decoded before the clock starts: reading the target is not restoring it. Where a method
    says of itself in `info` what it took ("seconds", "peak_mb"), since its work was done elsewhere, that counts.
    """
    _ = view.rgb.shape, view.has_depth
    with PeakMemory() as memory:
        started = time.perf_counter()
        restoration = checked_restore(method, scene, view)
        seconds = time.perf_counter() - started
    took = {"seconds": seconds, "peak_mb": memory.peak_mb}
    took |= {
        name: float(restoration.info[name]) for name in took.keys() & restoration.info.keys()
    }
    restoration = restoration_in_srgb(restoration, view) if in_srgb else restoration
    return Measured(with_truth(restoration, scene, view), **took)


def _restored_and_scored(
    job: Job,
    method: Any,
    metrics: Sequence[Scorer],
    task: Task,
    over: _SceneColours | None = None,
) -> list[Row]:
    """Restore, store and score one view. over: colours of its scene, where all views of a scene are shown alike."""
    view = task.view
    # its colours are among them, so it is restored already
    decides = over is not None and view.name in over.views
    try:
        with step(f"view '{view.name}' by method '{job.method.label}'"):
            afresh = job.overwrite == "always" and not decides
            measured = _stored_or_restored(job, method, task, afresh, job.save == "full")
            write_view(job.out, task.place, view_in_srgb(view))
            restoration = measured.restoration
            colours = over.colours if over and over.colours.size else None
            shown, filled = displayed(restoration, job.method.display, view.encoding, colours)
            look = (job.bits, over.hash if over else "")
            write_pictures(
                job.out, task.place, job.method.label, restoration, shown, filled, *look
            )
            base = replace(task.base, seconds=measured.seconds, peak_mb=measured.peak_mb)
            return score_rows(restoration, shown, view, metrics, base)
    except BaseException as fault:
        raise_if_stop(fault)
        told = fault
        if not _can_open_files():
            remedy = "see that the method closes its files"
            told = PluginError("no file can be opened after it", remedy=remedy)
        elif isinstance(fault, OutputError):
            # a row would stand for the stored restoration, which could not be replaced
            raise
        return [row_of_fault(task.base, told, log_path(job.out), is_said=True)]


def _stored_or_restored(
    job: Job, method: Any, task: Task, afresh: bool, is_stored: bool
) -> Measured:
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
        wanted = shown_with(job.method.display, in_full=is_stored, in_run=True)
        with step(at, job.view_timeout_s), wanted:
            measured = measured_restore(method, scene, view, job.colours == "srgb")
    except OutputError as fault:
        # of its own files, in a full TMPDIR for example: results can still be written
        raise InputError(fault.fault, fault.place, fault.remedy) from fault
    if is_stored:
        write_full(whole, measured, task.base)
    else:
        with writing(whole):
            # it is of another restoration than the picture that is now beside it
            whole.unlink(missing_ok=True)
    return measured


@dataclass(frozen=True, eq=False)
class _SceneColours:
    """Colours of a scene, by which all its views are shown."""

    colours: Array
    """Shape (N, 1, 3)."""

    views: frozenset[str]
    """Those that have these colours."""

    hash: str
    """A hash of the names of these views."""

    @classmethod
    def of(cls, job: Job, method: Any, tasks: Sequence[Task]) -> _SceneColours:
        """Restore the views that decide how a scene is shown, and store them for later jobs; so many fit in memory.

        A view that cannot be restored is left out; it gets its row when it is to be shown.
        """
        colours = [np.zeros((0, 3), np.float32)]
        names = list[str]()
        for task in progress.track(tasks, "before showing"):
            try:
                image = _stored_or_restored(
                    job, method, task, job.overwrite == "always", True
                ).restoration.image
            except OutputError:
                raise
            except BaseException as fault:
                raise_if_stop(fault)
                continue
            names.append(task.view.name)
            pixels = image[coloured(image)]
            colours.append(pixels[:: max(1, len(pixels) // _PIXELS_OF_A_VIEW)])
        return cls(np.concatenate(colours)[:, None], frozenset(names), names_hash(names))
