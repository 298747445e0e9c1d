"""`sucre-bench run --dry-run`: prints the jobs of a run, and their expected time, memory and disk."""

import math
from collections.abc import Iterator, Sequence

import click

from sucre_bench.engine.forecast import Expected, Forecast
from sucre_bench.machine import terminal
from sucre_bench.machine.progress import duration


def show(found: Forecast) -> None:
    """Print a line for each dataset and method, their sum, and what the numbers rest on."""
    groups: dict[tuple[str, str], list[Expected]] = {}  # with several jobs if the views are parted, or repeated
    for job in found.jobs:
        groups.setdefault((job.dataset, job.method), []).append(job)
    has_parts = len(groups) < len(found.jobs)
    numbers = (*(("jobs",) if has_parts else ()), "views", "stored", "to do", "time", "memory", "disk")
    table = terminal.table(("dataset", "method"), numbers)
    for (dataset, method), jobs in (groups | ({("all", ""): list(found.jobs)} if len(groups) > 1 else {})).items():
        count = [str(len(jobs))] if has_parts else []
        job = _sum(jobs)
        time = "?" if math.isnan(job.seconds) else duration(job.seconds)
        to_do = job.views - job.stored
        costs = (time, _size(job.memory_mb), _size(job.disk_mb)) if to_do else ("", "", "")
        views = (str(job.views), str(job.stored), str(to_do))
        table.add_row(dataset, method, *count, *views, *costs, style="" if method else "bold")
    where = "one job after the other on this machine"
    if found.launcher:
        at_once = f", at most {found.at_once} jobs at once" if found.at_once else ""
        name = "SLURM" if found.launcher == "slurm" else found.launcher
        where = f"by {name}{at_once}; time is the sum of all jobs"
    terminal.out.print(f"What the run would do, {where}")
    terminal.out.print(table)
    for (dataset, method), jobs in groups.items():
        if reason := next((job.reason for job in jobs if job.reason), ""):
            click.echo(f"not estimated  {dataset} / {method}: {reason}")
    for line in _side_by_side(found):
        click.echo(line)
    click.echo("estimated from the stored views of each method")


def _side_by_side(found: Forecast) -> Iterator[str]:
    """How long jobs take side by side, and whether SLURM's limits for each job are enough."""
    longest = max(job.seconds for job in found.jobs)
    total = _sum(found.jobs)
    if not found.launcher or not found.at_once or not total.seconds > 0:
        return
    elapsed = max(longest, total.seconds / found.at_once)
    yield f"side by side   about {duration(elapsed)}, once all jobs run; the longest job {duration(longest)}"
    if found.launcher != "slurm":
        return
    minutes, memory = math.ceil(2 * longest / 60 + 2), math.ceil(1.5 * total.memory_mb / 1e3)
    if found.timeout_min is not None and found.timeout_min < minutes:
        limit = f"the limit of a job is {found.timeout_min} min"
        yield f"too short      {limit}; give hydra.launcher.timeout_min={minutes}, or more blocks: shard.count="
    if found.mem_gb is None:
        yield f"memory         the cluster decides; hydra.launcher.mem_gb={memory} is enough"
    elif found.mem_gb < memory:
        yield f"too little     a job gets {found.mem_gb:g} GB; give hydra.launcher.mem_gb={memory}"


def _sum(jobs: Sequence[Expected]) -> Expected:
    """All jobs together; their memory is that of the largest."""
    views, stored = sum(job.views for job in jobs), sum(job.stored for job in jobs)
    seconds, disk = sum(job.seconds for job in jobs), sum(job.disk_mb for job in jobs)
    memory = max(job.memory_mb for job in jobs) if all(job.memory_mb >= 0 for job in jobs) else math.nan
    return Expected("", "", views, stored, seconds, memory, disk)


def _size(megabytes: float) -> str:
    if math.isnan(megabytes):
        return "?"
    return f"{megabytes / 1e3:.1f} GB" if megabytes >= 1000 else f"{max(1, round(megabytes))} MB"
