"""`sucre-bench run --dry-run`: prints the jobs of a run, and their expected time, memory and disk."""

from __future__ import annotations

import math
from dataclasses import asdict

import click
from rich.table import Table

from sucre_bench.engine.forecast import Expected, Forecast
from sucre_bench.machine import terminal
from sucre_bench.machine.json_text import json_text
from sucre_bench.machine.measured_rates import rates_path
from sucre_bench.machine.pace import duration

__all__ = ["as_json", "show"]


def show(found: Forecast) -> None:
    """Print a line a job, their sum, and what the numbers rest on."""
    table = Table(box=None, pad_edge=False)
    for name, side in (("dataset", "left"), ("method", "left"), *((name, "right") for name in _NUMBERS)):
        table.add_column(name, justify=side)  # type: ignore[arg-type]
    for job in found.jobs:
        table.add_row(job.dataset, job.method, *_numbers(job))
    if len(found.jobs) > 1:
        table.add_row("all", "", *_numbers(_sum(found.jobs)), style="bold")
    terminal.out.print("What the run would do, one job after the other on this machine")
    terminal.out.print(table)
    for job in found.jobs:
        if job.reason:
            click.echo(f"not estimated  {job.dataset} / {job.method}: {job.reason}")
    if found.cache_mb and any(job.views > job.stored for job in found.jobs):
        click.echo(f"while it runs  up to {_size(found.cache_mb)} of disk for decoded images (cache_gb)")
    click.echo(f"estimated from one small view by each method; rates are kept in {rates_path()}")


_NUMBERS = ("views", "stored", "to do", "time", "memory", "disk")


def as_json(found: Forecast) -> str:
    """Return the forecast as one JSON object; what is not known is null."""
    return json_text(asdict(found))


def _sum(jobs: tuple[Expected, ...]) -> Expected:
    """All jobs together; their memory is that of the largest."""
    views, stored = sum(job.views for job in jobs), sum(job.stored for job in jobs)
    seconds, disk = sum(job.seconds for job in jobs), sum(job.disk_mb for job in jobs)
    memory = max(job.memory_mb for job in jobs) if all(job.memory_mb >= 0 for job in jobs) else math.nan
    return Expected("", "", views, stored, seconds, memory, disk)


def _numbers(job: Expected) -> tuple[str, ...]:
    to_do = job.views - job.stored
    if not to_do:
        return (str(job.views), str(job.stored), "0", "", "", "")
    time = "?" if math.isnan(job.seconds) else duration(job.seconds)
    return (str(job.views), str(job.stored), str(to_do), time, _size(job.memory_mb), _size(job.disk_mb))


def _size(megabytes: float) -> str:
    if math.isnan(megabytes):
        return "?"
    return f"{megabytes / 1e3:.1f} GB" if megabytes >= 1000 else f"{max(1, round(megabytes))} MB"
