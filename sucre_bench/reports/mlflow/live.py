"""Starts and ends the process that logs a command while it runs: `follow` is what it does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from sucre_bench.engine.preflight import Planned, base_row
from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.processes import Forked, call, can_fork
from sucre_bench.machine.text_formats import masked
from sucre_bench.reports.mlflow.follow import Follower, PlannedViews, follow
from sucre_bench.reports.mlflow.runs import log
from sucre_bench.reports.mlflow.store import Note, Place


class Live:
    """The runs of a command, of which job is one. When its block ends, those that are at work are marked as killed.

    mlflow, which takes seconds to import, is imported in the process that logs.
    """

    def __init__(self, job: Job) -> None:
        self._place = Place.of(job.out, job.tracking.uri, job.tracking.experiment)
        self._out = job.out
        self._child = Forked(partial(follow, self._out, self._place)) if can_fork() else None
        self._has_failed = False

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child:
            self._child.stop()

    def follow(self, planned: Sequence[Planned]) -> None:
        """Begin to follow the jobs, if there is work. planned: empty if another sweeper chooses the jobs."""
        if not self._child:
            return
        if planned and not any(plan.todo for plan in planned):
            self._child.stop()
            self._child = None
            return
        self._child.give((Follower.follow, [PlannedViews.of(plan) for plan in planned]))

    def begin(self, job: Job) -> None:
        """Begin the run of a job."""
        if self._child:
            self._child.give((Follower.begin, base_row(job)))

    def receive(self) -> None:
        """Print it once if mlflow fails."""
        for _, fault in self._child.receive() if self._child else ():
            if not self._has_failed:
                progress.say(f"mlflow: {fault}; the run goes on, and its end tries again")
            self._has_failed = True

    def end(self) -> None:
        """Log what lacks at the end, and print how to see it; if that fails, print the reason in one line."""
        out, place = self._out, self._place
        if Note(out).is_logged(place):
            return
        remedy = f"`sucre-bench track {out}` tries again"
        with progress.live():
            progress.say(
                f"mlflow   logging in {masked(place.uri)}; all results are written already"
            )
            try:
                if self._child:
                    self._child.give(None)
                    self._child.wait(remedy)
                else:
                    call(partial(log, out, place), remedy)
            except SucreBenchError as fault:
                reason = "" if self._has_failed else f" ({fault.without_remedy})"
                progress.say(f"mlflow: not logged{reason}; the table has everything, {remedy}")
            else:
                progress.say(f"mlflow   {place.how_to_look}")
