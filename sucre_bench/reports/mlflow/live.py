"""Starts and ends the process that logs a command while it runs: `follow` is what it does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

from sucre_bench.engine.preflight import base_row
from sucre_bench.errors import SucreBenchError
from sucre_bench.machine import progress
from sucre_bench.machine.processes import Forked, call, can_fork
from sucre_bench.machine.provenance import absent
from sucre_bench.machine.text_formats import masked

if TYPE_CHECKING:
    from sucre_bench.engine.preflight import Planned
    from sucre_bench.jobs.job import Job
    from sucre_bench.reports.mlflow.store import Place


class Live:
    """The runs of a command. When its block ends, those that are at work are marked as killed."""

    def __init__(self) -> None:
        self._child: Forked | None = None
        self._has_failed = False

    def __enter__(self) -> Live:
        return self

    def __exit__(self, *_: object) -> None:
        if self._child:
            self._child.stop()

    def start(self, job: Job) -> None:
        """Start the process, which needs seconds to import mlflow, if mlflow is wanted and installed."""
        place = _place(job)
        if place and can_fork():
            from sucre_bench.reports.mlflow.follow import follow

            self._child = Forked(partial(follow, job.out, place))

    def follow(self, planned: Sequence[Planned]) -> None:
        """Begin to follow the jobs, if there is work. planned: empty if another sweeper chooses the jobs."""
        if not self._child:
            return
        if planned and not any(plan.todo for plan in planned):
            self._child.stop()
            self._child = None
            return
        from sucre_bench.reports.mlflow.follow import Follower, PlannedViews

        self._child.give((Follower.follow, [PlannedViews.of(plan) for plan in planned]))

    def begin(self, job: Job) -> None:
        """Begin the run of a job."""
        if self._child:
            from sucre_bench.reports.mlflow.follow import Follower

            self._child.give((Follower.begin, base_row(job)))

    def receive(self) -> None:
        """Print it once if mlflow fails."""
        for _, fault in self._child.receive() if self._child else ():
            if not self._has_failed:
                progress.say(f"mlflow: {fault}; the run goes on, and its end tries again")
            self._has_failed = True

    def end(self, job: Job) -> None:
        """Log what lacks at the end, and print how to see it; if that fails, print the reason in one line.

        job: any of the command.
        """
        place = _place(job)
        if not place:
            return
        from sucre_bench.reports.mlflow.runs import log
        from sucre_bench.reports.mlflow.store import Note

        if Note(job.out).is_logged(place):
            return
        remedy = f"`sucre-bench track {job.out}` tries again"
        with progress.live():
            progress.say(
                f"mlflow   logging in {masked(place.uri)}; all results are written already"
            )
            try:
                if self._child:
                    self._child.give(None)
                    self._child.wait(remedy)
                else:
                    call(partial(log, job.out, place), remedy)
            except SucreBenchError as fault:
                reason = "" if self._has_failed else f" ({fault.without_remedy})"
                progress.say(f"mlflow: not logged{reason}; the table has everything, {remedy}")
            else:
                progress.say(f"mlflow   {place.how_to_look}")


def _place(job: Job) -> Place | None:
    """Where a command is to be logged; None if it is not."""
    if job.tracking.uri == "off" or absent("mlflow"):
        return None
    from sucre_bench.reports.mlflow.store import Place

    place = Place.of(job.out, job.tracking.uri, job.tracking.experiment)
    return None if place.uri == "off" else place
