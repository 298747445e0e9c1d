"""The forecast of a command: its jobs, and their time, memory and disk, from what stored views of each job took."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.preflight import Planned, check, workers_at_once
from sucre_bench.errors import MissingFileError
from sucre_bench.jobs import compose_jobs
from sucre_bench.jobs.run_options import Slurm
from sucre_bench.machine import progress
from sucre_bench.results.rows import restorations

# A process with the libraries of the numerics, and the planes of a view in memory, MB and MB a megapixel.
_PROCESS_MB, _VIEW_MB = 300.0, 28.0


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

    launcher: "slurm", "workers", or "" for jobs one after the other; at_once: how many jobs run side by side;
    timeout_min, mem_gb: what each job gets on SLURM, None where the cluster decides.
    """

    jobs: tuple[Expected, ...]
    launcher: str = ""
    at_once: int = 1
    timeout_min: int | None = None
    mem_gb: float | None = None


def forecast(overrides: Sequence[str], multirun: bool) -> Forecast:
    """Return what a command would do; nothing is written. Raises what the command raises before any work."""
    with progress.live():
        command = compose_jobs.jobs(list(overrides), multirun)
        planned = check(command)
    try:
        rows = restorations(results.read(command.jobs[0].out))
    except MissingFileError:
        rows = results.frame([])
    done = dict(iter(rows.groupby(["dataset", "method", "options_id"])))
    jobs = tuple(_expected(plan, done) for plan in planned)
    launcher = command.launcher
    if isinstance(launcher, Slurm):
        return Forecast(jobs, "slurm", launcher.array_parallelism, launcher.timeout_min, launcher.mem_gb)
    at_once = workers_at_once(command)
    return Forecast(jobs, "workers" if at_once > 1 else "", max(1, at_once))


def _expected(plan: Planned, stored: Mapping[Any, DataFrame]) -> Expected:
    """What a job will take. stored: the rows of restorations by dataset, method and options."""
    import pandas as pd

    job, n_todo = plan.job, len(plan.todo)
    names = (job.dataset.label, job.method.label, len(plan.tasks), len(plan.tasks) - n_todo)
    if not n_todo:
        return Expected(*names, 0.0, 0.0, 0.0)
    done = stored.get((*names[:2], plan.todo[0].base.options_id))
    if done is None:
        reason = "no view by it is stored here; restore some first, with first=3 say"
        return Expected(*names, math.nan, math.nan, math.nan, reason)
    seconds = float(done["seconds"].mean())
    if len(done) > 2:  # from one view's beginning to the next: with its scores and files
        pauses = pd.to_datetime(done["time"], utc=True).sort_values().diff().dt.total_seconds()
        seconds = max(seconds, float(pauses.median()))
    height, width = plan.todo[0].view.rgb.shape[:2]
    memory = _PROCESS_MB + _VIEW_MB * height * width / 1e6 + float(done["peak_mb"].fillna(0).max())
    out, method = job.out, job.method.label
    views = {*zip(done["scene"], done["view"], strict=True)}
    places = [task.place for task in plan.tasks if (task.base.scene, task.view.name) in views]
    # Those of a view, and those beside them with the other suffix of a restoration.
    pictures = {path for place in places for path in (place.restored(out, method), place.original(out))}
    files = {path.with_suffix(suffix) for path in pictures for suffix in (path.suffix, ".npz")}
    size_mb = sum(file.stat().st_size for file in files if file.is_file()) / 1e6
    disk = n_todo * size_mb / len(places) if places else math.nan
    return Expected(*names, n_todo * seconds, memory, disk)
