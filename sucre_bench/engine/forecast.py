"""The forecast of a command: its jobs and views, and how long they will take, from the stored views of each method."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.engine.preflight import Planned, check, stored_rows
from sucre_bench.jobs import compose_jobs
from sucre_bench.machine import progress
from sucre_bench.plugins import missing_needs
from sucre_bench.results.rows import restorations


@dataclass(frozen=True)
class Expected:
    """A dataset and method: how many jobs it has, how many views, and how many of them are stored."""

    dataset: str
    method: str
    jobs: int
    views: int
    stored: int

    skipped: int
    """Views of scenes that lack what the method needs. A view that alone lacks a depth map counts as one to do."""

    lack: str
    """What the first of these needs; "" if there is none."""

    seconds: float
    """What the views to do will take; NaN if no view of this configuration is stored."""


def forecast(overrides: Sequence[str], multirun: bool) -> list[Expected]:
    """Return what a command would do; nothing is written. Raises what the command raises before any work."""
    with progress.live():
        command = compose_jobs.jobs(list(overrides), multirun)
        planned = check(command)
    rows = restorations(stored_rows(command.jobs[0]))
    stored = dict(iter(rows.groupby(["dataset", "method", "options_id"])))
    by_labels = defaultdict[tuple[str, str], list[Planned]](list)
    for plan in planned:
        by_labels[plan.labels].append(plan)
    expected = []
    for labels, plans in by_labels.items():
        lacks = [_lacks(plan) for plan in plans]
        every = [lack for of_plan in lacks for lack in of_plan]
        one = Expected(
            *labels,
            jobs=len(plans),
            views=sum(len(plan.tasks) for plan in plans),
            stored=sum(len(plan.tasks) - len(plan.todo) for plan in plans),
            skipped=len(every),
            lack=every[0] if every else "",
            seconds=sum(
                _seconds(plan, len(plan.todo) - len(of_plan), stored)
                for plan, of_plan in zip(plans, lacks, strict=True)
            ),
        )
        expected.append(one)
    return expected


def _lacks(plan: Planned) -> list[str]:
    """What the views to do lack that the method needs, of those that lack something."""
    method = plan.job.method.plugin
    return [lack for task in plan.todo if (lack := missing_needs(method, task.scene.has))]


def _seconds(plan: Planned, n: int, stored: Mapping[Any, DataFrame]) -> float:
    """Seconds for n views to do. stored: the rows of restorations by dataset, method and options."""
    import pandas as pd

    if not n:
        return 0.0
    done = stored.get((*plan.labels, plan.todo[0].base.options_id))
    if done is None:
        return math.nan
    seconds = float(done["seconds"].mean())
    if len(done) > 2:  # from one view's beginning to the next: with its scores and files
        pauses = pd.to_datetime(done["time"], utc=True).sort_values().diff().dt.total_seconds()
        seconds = max(seconds, float(pauses.median()))
    return n * seconds
