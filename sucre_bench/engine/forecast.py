"""The forecast of a command: its jobs, and their time, memory and disk from rates measured on this machine.

A method restores one view of the data, shrunk to 0.1 and to 0.8 megapixels, with a few neighbours. What grows between
the two is taken to grow with the number of pixels, and for methods of several views with the views that may see them.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.degrade import degraded
from sucre_bench.engine.job import make_ready, measured_restore
from sucre_bench.engine.preflight import Planned, check, is_for_cluster, workers_at_once
from sucre_bench.engine.score import Scorer, metric_code, score_rows, scorers
from sucre_bench.engine.select_views import Task
from sucre_bench.errors import InputError, one_line, raise_if_stop
from sucre_bench.imaging.display import displayed
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import encode_png
from sucre_bench.jobs import compose_jobs as config
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.measured_rates import MeasuredRates, Rates, rates_path
from sucre_bench.multiview.pairing import lift, visible_pixels
from sucre_bench.results.rows import fingerprint
from sucre_bench.scene import Scene, View

# The measured views have so many megapixels, so many neighbours on each side, and are restored so many times.
_MEGAPIXELS, _NEIGHBOURS, _TIMES = (0.1, 0.8), 3, 2
# A process with the libraries of the numerics, and the planes of a view in memory, MB and MB a megapixel.
_PROCESS_MB, _VIEW_MB = 300.0, 28.0
# Bytes that a decoded pixel takes on the disk: colours and depth.
_DECODED_BYTES = 7


@dataclass(frozen=True)
class Expected:
    """One job: how many views it selects, how many are stored, and what the others will take.

    seconds, memory_mb, disk_mb: NaN where they are not known, `reason` says why.
    """

    dataset: str
    method: str
    views: int
    stored: int
    seconds: float
    memory_mb: float
    disk_mb: float
    reason: str = ""


@dataclass(frozen=True)
class Forecast:
    """All jobs of a command.

    measured_s: seconds that measuring took now; cache_mb: disk while the run lasts; launcher: "slurm", "joblib" or
    another of Hydra's, "" for jobs one after the other; at_once: how many jobs it runs side by side, 0 if that is not
    known; timeout_min, mem_gb: what each job gets on SLURM, None where the cluster decides.
    """

    jobs: tuple[Expected, ...]
    measured_s: float
    cache_mb: float
    launcher: str = ""
    at_once: int = 1
    timeout_min: int | None = None
    mem_gb: float | None = None


def forecast(overrides: Sequence[str], multirun: bool) -> Forecast:
    """Return what a command would do; nothing is written but rates in the user's cache.

    Raises what the command raises before any work.
    """
    with progress.live():
        command = config.jobs(list(overrides), multirun)
        planned = check(command)
    started = time.perf_counter()
    jobs = tuple(_expected(plan) for plan in planned)
    first = planned[0].job
    cache_mb = min(first.cache_gb * 1e3, _decoded_mb(planned))
    return replace(_launched(command), jobs=jobs, measured_s=time.perf_counter() - started, cache_mb=cache_mb)


def _launched(command: Command) -> Forecast:
    """A forecast of no jobs, with what the command's launcher gives them."""
    empty = Forecast((), 0.0, 0.0)
    if is_for_cluster(command):
        limits: dict[str, Any] = {name: command.launcher.get(name) for name in ("timeout_min", "mem_gb")}
        return replace(empty, launcher="slurm", at_once=int(command.launcher["array_parallelism"]), **limits)
    at_once = workers_at_once(command)
    return replace(empty, launcher="workers" if at_once > 1 else "", at_once=max(1, at_once))


def _expected(plan: Planned) -> Expected:
    job = plan.job
    todo = plan.todo
    names = (job.dataset.label, job.method.label, len(plan.tasks), len(plan.tasks) - len(todo))
    if not todo:
        return Expected(*names, 0.0, 0.0, 0.0)
    try:
        task = todo[len(todo) // 2]
        rates = MeasuredRates(rates_path()).get(_key(job, task), lambda: _measured(job, task))
        return _scaled(names, rates, job, task, len(todo))
    except BaseException as fault:
        raise_if_stop(fault)
        return Expected(*names, math.nan, math.nan, math.nan, one_line(fault))


def _key(job: Job, task: Task) -> str:
    metrics = [(metric.plugin.name, metric.variants, metric_code(metric)) for metric in job.metrics]
    return f"{job.method.plugin.name} {fingerprint({'of': [task.base.options, task.base.code, metrics]})[1]}"


@dataclass(frozen=True)
class _Trial:
    """A small view that was restored and scored.

    work: megapixels, times the views that show a pixel where the method takes several.
    """

    megapixels: float
    work: float
    restore_s: float
    restore_mb: float
    score_s: float
    file_mb: float


def _measured(job: Job, task: Task) -> Rates:
    """Restore and score a view at two small sizes, to tell what grows with the size from what does not."""
    pixels = task.view.pixels
    decode_s = _seconds(lambda: (pixels.load("rgb"), pixels.load("depth"))) / _megapixels(task.view)
    method, metrics = job.method.make(), scorers(job.metrics)
    make_ready(method)
    _try(job, method, metrics, task, _MEGAPIXELS[0])  # what is loaded or compiled at first does not count
    small, large = (_try(job, method, metrics, task, size) for size in _MEGAPIXELS)
    restore_s, of_restoring = _line((small.work, small.restore_s), (large.work, large.restore_s))
    score_s, of_scoring = _line((small.megapixels, small.score_s), (large.megapixels, large.score_s))
    return Rates(
        view_s=of_restoring + of_scoring,
        restore_s=restore_s,
        restore_mb=large.restore_mb / large.work,
        score_s=score_s,
        file_mb=large.file_mb / large.megapixels,
        decode_s=decode_s,
    )


def _try(job: Job, method: Any, metrics: Sequence[Scorer], task: Task, megapixels: float) -> _Trial:
    scene, view = _small(task, megapixels)
    _ = [(other.rgb, other.has_depth) for other in scene.views]
    measured = min((measured_restore(method, scene, view) for _ in range(_TIMES)), key=lambda one: one.seconds)
    restoration, how = measured.restoration, job.method.display.partition("@")[0]
    files: list[bytes] = []

    def score() -> None:
        shown, _ = displayed(restoration, how, view.encoding)
        score_rows(measured, shown, view, metrics, task.base)
        files.extend(encode_png(to_8bit(image)[..., ::-1], 1) for image in (shown, view.rgb))

    score_s, size = _seconds(score), _megapixels(view)
    memory = 0.0 if math.isnan(measured.peak_mb) else measured.peak_mb
    work = size * _views_of_a_pixel(job, scene, view)
    # The view beside the restoration is a JPEG, about a third of a PNG.
    return _Trial(size, work, measured.seconds, memory, score_s, (len(files[0]) + len(files[1]) / 3) / 1e6)


def _line(small: tuple[float, float], large: tuple[float, float]) -> tuple[float, float]:
    """The slope and the offset, neither below 0, of seconds over size, from two points."""
    (x, y), (wide, high) = small, large
    slope = (high - y) / (wide - x) if wide > x else y / x
    slope = min(max(slope, 0.0), high / wide)
    return slope, max(high - slope * wide, 0.0)


def _scaled(names: tuple[str, str, int, int], rates: Rates, job: Job, task: Task, n: int) -> Expected:
    size = _megapixels(task.view)
    work = size * _views_of_a_pixel(job, task.scene, task.view)
    n_decoded = len(task.scene) if "poses" in job.method.plugin.needs else n
    seconds = n * (rates.view_s + rates.restore_s * work + rates.score_s * size) + n_decoded * rates.decode_s * size
    memory = _PROCESS_MB + _VIEW_MB * size + rates.restore_mb * work
    return Expected(*names, seconds, memory, n * size * (rates.file_mb + (12 if job.save == "full" else 0)))


def _small(task: Task, megapixels: float) -> tuple[Scene, View]:
    """The task's view with a few neighbours, shrunk to a size."""
    names = [view.name for view in task.scene.views]
    place = names.index(task.view.name)
    near = task.scene.views[max(0, place - _NEIGHBOURS) : place + _NEIGHBOURS + 1]
    scale = min(1.0, math.sqrt(megapixels / _megapixels(task.view)))
    scene = replace(task.scene, views=near, data_id="")
    scene = degraded(scene, scale=scale) if scale < 1 else scene
    return scene, scene[task.view.name]


def _megapixels(view: View) -> float:
    height, width = view.rgb.shape[:2]
    return height * width / 1e6


def _views_of_a_pixel(job: Job, scene: Scene, view: View) -> float:
    """How many views may see a pixel of this one, by their poses; 1 for methods of single views."""
    if "poses" not in job.method.plugin.needs:
        return 1.0
    surface = lift(view)
    if not len(surface.pixels):
        raise InputError("no pixel has depth", view.name)
    return float(np.sum(visible_pixels(surface, scene.views))) / len(surface.pixels)


def _decoded_mb(planned: Sequence[Planned]) -> float:
    views: dict[tuple[Any, ...], View] = {}
    for plan in planned:
        reads_all = "poses" in plan.job.method.plugin.needs
        for task in plan.tasks:
            for view in task.scene.views if reads_all else (task.view,):
                views.setdefault((task.scene.name, view.name), view)
            if reads_all:
                break
    some = next(iter(views.values()), None)
    return 0.0 if some is None else len(views) * _megapixels(some) * _DECODED_BYTES


def _seconds(work: Any) -> float:
    started = time.perf_counter()
    work()
    return time.perf_counter() - started
