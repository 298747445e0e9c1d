"""One job: a dataset x a method x metrics, view by view, to rows. A fault is a row, never the end of the job."""

from __future__ import annotations

import importlib
import io
import math
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import plugins, progress, results
from sucre_bench.colour import display, to_8bit
from sucre_bench.config import Choice, Job, MetricChoice
from sucre_bench.errors import InputError, PluginError, SucreBenchError, did_you_mean
from sucre_bench.layout import Place, file_name, log_path, place
from sucre_bench.results import Part, Row
from sucre_bench.scene import Array, Restoration, Scene, View

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["measured_restore", "open_scenes", "run_job", "score_rows", "selected"]


# -- what a job works on -----------------------------------------------------------------------------------


def open_scenes(dataset: Choice) -> list[Scene]:
    """Open every scene of a dataset; pixels stay unread. InputError or PluginError when it cannot be opened."""
    try:
        scenes = list(dataset.make().scenes())
    except SucreBenchError:
        raise
    except (ImportError, OSError) as fault:
        reason = f"dataset '{dataset.label}': {_one_line(fault)}"
        raise InputError(f"{reason}; if a library is missing, `sucre-bench doctor` says which") from fault
    except Exception as fault:
        raise PluginError(f"dataset '{dataset.label}': {_one_line(fault)}; mend the plugin") from fault
    if not scenes or not all(len(scene) for scene in scenes):
        raise InputError(f"dataset '{dataset.label}': no views; check its options")
    return scenes


def selected(scenes: Sequence[Scene], job: Job) -> list[tuple[Scene, View]]:
    """Return the views to restore. InputError for a name no scene has."""
    everything = [(scene, view) for scene in scenes for view in scene.views]
    if job.views is not None:
        names = {view.name for _, view in everything}
        unknown = [name for name in job.views if name not in names]
        if unknown:
            hint = did_you_mean(unknown[0], names) if len(names) < 20 else f"there are {len(names)} others"
            raise InputError(f"views: no view is called '{unknown[0]}'; {hint}")
        everything = [(scene, view) for scene, view in everything if view.name in job.views]
    return everything[:: job.every][: job.first]


# -- restoring ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Measured:
    """A restoration, and what it took: wall seconds, MB of memory above what was held before."""

    restoration: Restoration
    seconds: float
    peak_mb: float


def measured_restore(method: Any, name: str, scene: Scene, view: View) -> Measured:
    """Restore a view and measure it. PluginError when the result is not what a method must return.

    The view's own planes are decoded before the clock starts: reading the target is not restoring it.
    """
    _ = view.rgb, view.has_depth
    with _PeakMemory() as memory:
        started = time.perf_counter()
        restoration = method.restore(scene, view)
        seconds = time.perf_counter() - started
    if not isinstance(restoration, Restoration):
        raise PluginError(f"{name}: returned {type(restoration).__name__}; a method returns a Restoration")
    image = np.asarray(restoration.image)
    if image.shape != view.rgb.shape or not np.issubdtype(image.dtype, np.floating):
        raise PluginError(
            f"{name}: returned an image {image.shape} {image.dtype}; it must be {view.rgb.shape} and floating"
        )
    if not np.isfinite(image).all(axis=-1).any():
        raise PluginError(f"{name}: gave no pixel of {view.name} a colour; its result is all NaN or infinite")
    info = {**restoration.info, "true_water": scene.water} if scene.water else restoration.info
    return Measured(replace(restoration, info=dict(info)), seconds, memory.peak_mb)


class _PeakMemory:
    """The highest resident memory in a `with`, in MB above that at its start; GPU memory where torch holds some.

    Linux keeps the high-water mark and lets a process reset its own; elsewhere it is unknown (NaN).
    """

    _STATUS = Path("/proc/self/status")

    def __enter__(self) -> _PeakMemory:
        self.peak_mb = math.nan
        try:
            Path("/proc/self/clear_refs").write_text("5")
            self._before = self._read("VmRSS")
        except OSError:
            self._before = math.nan
        if gpu := self._gpu():
            gpu.reset_peak_memory_stats()
        return self

    def __exit__(self, *_: object) -> None:
        if not math.isnan(self._before):
            self.peak_mb = max(0.0, self._read("VmHWM") - self._before)
        if gpu := self._gpu():
            self.peak_mb = float(np.nansum([self.peak_mb, gpu.max_memory_allocated() / 2**20]))

    def _read(self, name: str) -> float:
        line = next(line for line in self._STATUS.read_text().splitlines() if line.startswith(name))
        return int(line.split()[1]) / 1024

    @staticmethod
    def _gpu() -> Any:
        torch = sys.modules.get("torch")
        return torch.cuda if torch and torch.cuda.is_initialized() else None


# -- scoring -----------------------------------------------------------------------------------------------


def score_rows(
    measured: Measured, shown: Array, view: View, metrics: Iterable[MetricChoice], base: Row, log: Path | None = None
) -> list[Row]:
    """Score a restoration: a row a score, a skipped or failed row where a metric gives none.

    shown: the picture made of it; base: everything a row says that is not the score's; log: keeps tracebacks.
    """
    resources = {"seconds": (measured.seconds, "s", "wall"), "peak_mb": (measured.peak_mb, "MB", "resident")}
    rows = [
        replace(base, metric=name, value=value, unit=unit, variant=variant, better="lower")
        for name, (value, unit, variant) in resources.items()
    ]
    for choice in metrics:
        plugin = choice.plugin
        own = replace(base, metric=plugin.name, unit=plugin.unit, better=plugin.better, code=_code(base, plugin))
        for variant in choice.variants:
            row = replace(own, variant=variant)
            rows += _variant_rows(choice, measured.restoration, shown, view, row, log)
    return rows


def _code(base: Row, metric: plugins.Plugin) -> str:
    return f"{base.code.split('.')[0]}.{plugins.source_hash(metric)}"


def _variant_rows(
    choice: MetricChoice, restoration: Restoration, shown: Array, view: View, base: Row, log: Path | None
) -> list[Row]:
    if absent := plugins.missing_needs(choice.plugin, _view_has(view, restoration)):
        return [_without(base, "skipped", absent.replace("the scene", "the view"))]
    try:
        scores = list(choice.choice.make().score(restoration, shown, view, base.variant))
    except Exception as fault:
        _log_traceback(log, f"{base.dataset} {base.method} {view.name} {choice.plugin.name}:{base.variant}")
        return [_without(base, "failed", _one_line(fault))]
    if not scores:
        return [_without(base, "skipped", "nothing to score in this view")]
    return [
        replace(base, value=float(s.value), region=s.region, n_pixels=int(s.n_pixels), coverage=float(s.coverage))
        for s in scores
    ]


def _view_has(view: View, restoration: Restoration) -> frozenset[str]:
    """What this view offers to a metric; the scene may offer it in other views only."""
    offers = {
        "depth": view.has_depth,
        "poses": view.cam_from_world is not None,
        "reference": view.reference is not None,
        "charts": bool(view.charts),
        "truth": "true_water" in restoration.info,
        "restoration": True,
    }
    return frozenset(name for name, there in offers.items() if there)


def _without(base: Row, status: results.Status, reason: str) -> Row:
    return replace(base, value=math.nan, coverage=0.0, status=status, reason=reason)


# -- the job -----------------------------------------------------------------------------------------------


def run_job(job: Job, after_view: Callable[[], None] = lambda: None) -> bool:
    """Restore and score every selected view that is not done yet, writing rows and pictures under job.out.

    after_view: called when a view is done, computed or not. Returns whether there was anything to do.

    Expected faults become rows. InputError is raised only where nothing can go on: the output cannot be written.
    """
    part = Part(job.out, file_name(f"{job.dataset.label}-{job.method.label}")[:80])
    base = _base_row(job)
    try:
        scenes = open_scenes(job.dataset)
        views = selected(scenes, job)
        method = _ready(job.method)
    except SucreBenchError as fault:
        _failed(job, base, str(fault))
        part.add([_without(base, "failed", str(fault))])
        part.flush()
        return True
    done, worked = _done(job), False
    try:
        for scene, view in progress.track(views, f"{job.method.label} on {job.dataset.label}"):
            row = replace(base, scene=scene.name, view=view.name, data_id=scene.data_id, time=results.now())
            kept = place(job.dataset.label, scenes, scene, view)
            if not done.covers(row, job, kept.restored(job.out, job.method.label)):
                worked = True
                part.add(_view_rows(job, method, scene, view, kept, row))
            after_view()
    finally:
        part.flush()
    return worked


def _base_row(job: Job) -> Row:
    options, options_id = results.fingerprint(job.method.record)
    return Row(
        dataset=job.dataset.label, scene="", view="", method=job.method.label,
        options=options, options_id=options_id,
        metric="seconds", variant="wall", region="image", value=math.nan, unit="s", better="lower",
        n_pixels=0, coverage=1.0, status="ok", reason="", seconds=math.nan, peak_mb=math.nan,
        device="cpu", seed=int(job.method.options.get("seed", job.seed)),
        code=plugins.source_hash(job.method.plugin), data_id="", time=results.now(),
    )  # fmt: skip


def _ready(choice: Choice) -> Any:
    """Make the method, and import what it needs so that the first view's time is not that of imports."""
    for package in choice.plugin.requires:
        importlib.import_module(package)
    return choice.make()


def _view_rows(job: Job, method: Any, scene: Scene, view: View, kept: Place, base: Row) -> list[Row]:
    if absent := plugins.missing_needs(job.method.plugin, scene.has):
        return [_without(base, "skipped", absent)]
    try:
        if "depth" in job.method.plugin.needs and not view.has_depth:
            return [_without(base, "skipped", f"{view.name} has no depth map")]
        measured = measured_restore(method, job.method.label, scene, view)
        shown = display(measured.restoration.image, job.method.display, view.encoding)
    except Exception as fault:
        reason = str(fault) if isinstance(fault, SucreBenchError) else _one_line(fault)
        _failed(job, base, reason)
        return [_without(base, "failed", reason)]
    _save(job, kept, view, measured.restoration, shown)
    base = replace(
        base,
        seconds=measured.seconds,
        peak_mb=measured.peak_mb,
        device=str(measured.restoration.info.get("device", "cpu")),
        n_pixels=int(measured.restoration.valid.sum()),
        coverage=float(measured.restoration.valid.mean()),
    )
    return score_rows(measured, shown, view, job.metrics, base, log_path(job.out))


def _save(job: Job, kept: Place, view: View, restoration: Restoration, shown: Array) -> None:
    """Keep the restored picture, and once the view and its reference to look at beside it."""
    path = kept.restored(job.out, job.method.label)
    _write_image(path, shown)
    if job.save == "full":
        results.write_atomically(path.with_suffix(".npz"), _as_npz(restoration))
    for seen, image in ((kept.original(job.out), view.rgb), (kept.reference(job.out), view.reference)):
        if image is not None and not seen.is_file():
            _write_image(seen, display(image, "none", view.encoding))


def _write_image(path: Path, shown: Array) -> None:
    import cv2

    written, encoded = cv2.imencode(path.suffix, to_8bit(shown)[..., ::-1])
    assert written
    results.write_atomically(path, encoded.tobytes())


def _as_npz(restoration: Restoration) -> bytes:
    buffer, water = io.BytesIO(), restoration.water
    arrays: dict[str, Any] = {"image": restoration.image.astype(np.float32)}
    if water is not None:
        arrays |= {"B": water.veiling_light, "beta": water.attenuation, "gamma": water.backscatter}
    if restoration.confidence is not None:
        arrays["confidence"] = restoration.confidence.astype(np.float32)
    np.savez_compressed(buffer, **arrays)
    return buffer.getvalue()


def _failed(job: Job, base: Row, reason: str) -> None:
    """Say so at once, and keep the traceback in the log."""
    where = " / ".join(name for name in (base.dataset, base.scene, base.view, base.method) if name)
    _log_traceback(log_path(job.out), where)
    progress.say(f"failed  {where}: {reason}")


# -- resuming ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class _Done:
    """What the table already holds for this job's dataset and method."""

    rows: pd.DataFrame | None

    def covers(self, base: Row, job: Job, picture: Path) -> bool:
        """Whether a view needs no work: picture and every score are there, from the same options, data and code."""
        if job.overwrite == "always" or self.rows is None:
            return False
        rows = self.rows
        mine = rows[(rows["scene"] == base.scene) & (rows["view"] == base.view) & (rows["status"] != "failed")]
        if job.overwrite == "never":
            return len(mine) > 0
        mine = mine[(mine["options_id"] == base.options_id) & (mine["data_id"] == base.data_id)]
        there = {(str(r.metric), str(r.variant), str(r.code)) for r in mine.itertuples()}
        if (mine.loc[mine["metric"] == "seconds", "status"] == "skipped").any():
            return (base.metric, base.variant, base.code) in there
        files = [picture, *([picture.with_suffix(".npz")] if job.save == "full" else [])]
        scores = {(c.plugin.name, variant, _code(base, c.plugin)) for c in job.metrics for variant in c.variants}
        return all(f.is_file() for f in files) and scores | {(base.metric, base.variant, base.code)} <= there


def _done(job: Job) -> _Done:
    try:
        rows = results.read(job.out)
    except InputError:
        return _Done(None)
    return _Done(rows[(rows["dataset"] == job.dataset.label) & (rows["method"] == job.method.label)])


# -- faults ------------------------------------------------------------------------------------------------


def _log_traceback(log: Path | None, where: str) -> None:
    if log is None:
        return
    log.parent.mkdir(parents=True, exist_ok=True)
    with log.open("a", encoding="utf-8") as file:
        file.write(f"--- {results.now()} {where} (process {os.getpid()})\n{traceback.format_exc()}\n")


def _one_line(fault: BaseException) -> str:
    text = " ".join(str(fault).split())
    return f"{type(fault).__name__}: {text}" if text else type(fault).__name__
