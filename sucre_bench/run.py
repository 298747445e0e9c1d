"""One job: a dataset x a method x metrics, view by view, to rows and pictures. A fault is a row, not the end."""

from __future__ import annotations

import importlib
import io
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins, progress, results
from sucre_bench.colour import display, to_8bit
from sucre_bench.degrade import around, degraded_whole
from sucre_bench.errors import (
    ANY_FAULT,
    InputError,
    NotApplicableError,
    OutputError,
    PluginError,
    SucreBenchError,
    did_you_mean,
    one_line,
)
from sucre_bench.job import Choice, Job
from sucre_bench.layout import Place, file_name, log_path, places
from sucre_bench.restoring import measured_restore
from sucre_bench.results import Part, Row
from sucre_bench.resume import Done
from sucre_bench.scene import Array, Restoration, Scene, View, Water
from sucre_bench.scores import keep_traceback, score_rows, without
from sucre_bench.source import source_hash

__all__ = ["Task", "failed_row", "open_scenes", "run_job", "tasks"]


@dataclass(frozen=True)
class Task:
    """A view to restore: where its results are kept, and what every row of it says."""

    scene: Scene
    view: View
    place: Place
    base: Row


def run_job(job: Job, after_view: Callable[[], None] = lambda: None) -> bool:
    """Restore and score every selected view that is not done yet, writing rows and pictures under job.out.

    after_view: called when a view is done, computed or not. Returns whether there was anything to do.
    Raises OutputError where results cannot be written; every other fault becomes a row.
    """
    part = Part(job.out, file_name(f"{job.dataset.label}-{job.method.label}"))
    try:
        todo = list(tasks(job, open_scenes(job.dataset)))
        method = _ready(job.method)
    except ANY_FAULT as fault:
        part.add([failed_row(job, fault)])
        part.flush()
        return True
    done, worked = Done.of(job), False
    try:
        for task in progress.track(todo, f"{job.method.label} on {job.dataset.label}"):
            if not done.covers(task.base, task.place.restored(job.out, job.method.label)):
                if not worked:
                    worked = True
                    try:
                        _warm_up(method)
                    except ANY_FAULT as fault:
                        part.add([failed_row(job, fault)])
                        break
                part.add(_rows(job, method, replace(task, base=replace(task.base, time=results.now()))))
            after_view()
    finally:
        part.flush()
    return worked


# -- what there is to do -----------------------------------------------------------------------------------


def open_scenes(dataset: Choice) -> list[Scene]:
    """Open every scene of a dataset; pixels stay unread. InputError or PluginError when it cannot be opened."""
    try:
        scenes = list(dataset.make().scenes())
    except SucreBenchError:
        raise
    except (ImportError, OSError) as fault:
        reason = f"dataset '{dataset.label}': {one_line(fault)}"
        raise InputError(f"{reason}; if a library is missing, `sucre-bench doctor` says which") from fault
    except ANY_FAULT as fault:
        raise PluginError(f"dataset '{dataset.label}': {one_line(fault)}; mend the plugin") from fault
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise PluginError(
                f"dataset '{dataset.label}': yields {type(scene).__name__}; scenes() yields Scene objects"
            )
        name, times = Counter(view.name for view in scene.views).most_common(1)[0] if scene.views else ("", 0)
        if times > 1:
            raise PluginError(f"dataset '{dataset.label}': {times} views are called '{name}'; names must be unique")
    name, times = Counter(scene.name for scene in scenes).most_common(1)[0] if scenes else ("", 0)
    if times > 1:
        raise InputError(f"dataset '{dataset.label}': {times} scenes are called '{name}'; rename a folder")
    if not any(len(scene) for scene in scenes):
        raise InputError(f"dataset '{dataset.label}': no views; check its options")
    return scenes


def tasks(job: Job, scenes: Sequence[Scene]) -> Iterator[Task]:
    """Yield the views a job is to restore, degraded, in the dataset's order.

    Raises InputError for a name that no scene has, and for a scene that lacks what is to be degraded.
    """
    base, kept = _base_row(job), places(job.dataset.label, scenes)
    data_ids = {scene.name: job.degrade.data_id(scene.data_id) for scene in scenes}
    for scene, view in _selected([degraded_whole(scene, job.degrade) for scene in scenes], job):
        row = replace(base, scene=scene.name, view=view.name, data_id=data_ids[scene.name])
        yield Task(around(scene, view, job.degrade), view, kept[scene.name, view.name], row)


def _selected(scenes: Sequence[Scene], job: Job) -> list[tuple[Scene, View]]:
    everything = [(scene, view) for scene in scenes for view in scene.views]
    if job.views is not None:
        names = {view.name for _, view in everything}
        unknown = [name for name in job.views if name not in names]
        if unknown:
            hint = did_you_mean(unknown[0], names) if len(names) < 20 else f"there are {len(names)} others"
            raise InputError(f"views: no view is called '{unknown[0]}'; {hint}")
        everything = [(scene, view) for scene, view in everything if view.name in job.views]
    return everything[:: job.every][: job.first]


def _base_row(job: Job) -> Row:
    options, options_id = results.fingerprint(job.method.record)
    return Row(
        dataset=job.dataset.label,
        method=job.method.label,
        options=options,
        options_id=options_id,
        seed=int(job.method.options.get("seed", job.seed)),
        code=source_hash(job.dataset.plugin, job.method.plugin, *job.method.methods, files=job.method.files),
    )


def _ready(choice: Choice) -> Any:
    """Make the method, and import what it needs so that the first view's time is not that of imports."""
    for package in choice.plugin.requires:
        importlib.import_module(package)
    return choice.make()


def _warm_up(method: Any) -> None:
    """Let a method that has a `warm_up()` compile, so that the first view's time is not that of compilers."""
    if hasattr(method, "warm_up"):
        method.warm_up()


# -- doing it ----------------------------------------------------------------------------------------------


def _rows(job: Job, method: Any, task: Task) -> list[Row]:
    """Restore, keep and score one view."""
    scene, view = task.scene, task.view
    if absent := plugins.missing_needs(job.method.plugin, scene.has):
        return [without(task.base, "skipped", absent)]
    try:
        if "depth" in job.method.plugin.needs and not view.has_depth:
            return [without(task.base, "skipped", f"{view.name} has no depth map")]
        measured = measured_restore(method, scene, view)
        shown = display(measured.restoration.image, job.method.display, view.encoding)
        _keep(job, task, measured.restoration, shown)
        base = replace(
            task.base,
            seconds=measured.seconds,
            peak_mb=measured.peak_mb,
            device=str(measured.restoration.info.get("device", "cpu")),
            n_pixels=int(measured.restoration.valid.sum()),
            coverage=float(measured.restoration.valid.mean()),
        )
        return score_rows(measured, shown, view, job.metrics, base, log_path(job.out))
    except OutputError:
        raise
    except NotApplicableError as reason:
        return [without(task.base, "skipped", one_line(reason))]
    except ANY_FAULT as fault:
        return [_failed(job, task.base, fault)]


def _keep(job: Job, task: Task, restoration: Restoration, shown: Array) -> None:
    """Keep the restored picture, and the view and its reference to look at beside it."""
    path, view = task.place.restored(job.out, job.method.label), task.view
    started = time.perf_counter()
    if job.save == "full":
        results.write_atomically(path.with_suffix(".npz"), _as_npz(restoration))
    _write_image(task.place.original(job.out), display(view.rgb, "none", view.encoding))
    if view.reference is not None:
        _write_image(task.place.reference(job.out), display(view.reference, "none", view.encoding))
    _write_image(path, shown)
    results.write_atomically(path.with_suffix(".json"), _as_json(restoration, time.perf_counter() - started))


def _write_image(path: Path, shown: Array) -> None:
    import cv2

    written, encoded = cv2.imencode(path.suffix, to_8bit(shown)[..., ::-1])
    assert written
    results.write_atomically(path, encoded.tobytes())


def _as_npz(restoration: Restoration) -> bytes:
    buffer, water = io.BytesIO(), restoration.water
    arrays: dict[str, Any] = {"image": restoration.image.astype(np.float32)}
    if water is not None:
        arrays |= _water_record(water)
    if restoration.confidence is not None:
        arrays["confidence"] = restoration.confidence.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _water_record(water: Water) -> dict[str, Any]:
    """A water by the names that `sucre_bench.loading.water_file` reads."""
    parameters = {"B": water.veiling_light, "beta": water.attenuation, "gamma": water.backscatter}
    return parameters | {"encoding": water.encoding}


def _as_json(restoration: Restoration, write_seconds: float) -> bytes:
    """The water, what the method tells of its work, the true water where known, and how long writing took."""
    water = restoration.water
    known = {} if water is None else _water_record(water)
    told = known | restoration.info | known | {"write_seconds": write_seconds}  # what is known of the water comes first
    text = json.dumps(told, default=_plain, skipkeys=True)
    return json.dumps(json.loads(text, parse_constant=lambda _: None), indent=1).encode()  # JSON knows no NaN


def _plain(value: Any) -> Any:
    """An array as lists, a water by its parameters, anything else in words: a method may tell what it likes."""
    if isinstance(value, Water):
        return _water_record(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)


def failed_row(job: Job, fault: BaseException) -> Row:
    """Say that a whole job failed, and return the row that says why."""
    return _failed(job, _base_row(job), fault)


def _failed(job: Job, base: Row, fault: BaseException) -> Row:
    """Say so at once, keep the traceback in the log, and return the row that says why."""
    where = " / ".join(name for name in (base.dataset, base.scene, base.view, base.method) if name)
    keep_traceback(log_path(job.out), where)
    progress.say(f"failed  {where}: {one_line(fault)}")
    return without(base, "failed", one_line(fault))
