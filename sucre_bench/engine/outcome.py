"""The outcome of a run: counts, faults, and the exit code."""

from dataclasses import dataclass
from pathlib import Path

from sucre_bench.arrays import DataFrame
from sucre_bench.jobs.run_options import Study, Tracking
from sucre_bench.results.rows import values_of


@dataclass(frozen=True)
class Fault:
    """Why a view has no result, or not all its scores. where: dataset and method, and the metric if it is at fault."""

    where: str
    view: str
    reason: str


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run. The counts are of restorations: one view by one method.

    rows: the score table of the folder, on common pixels where methods fill different ones; stored: the same, each
    score on its method's own pixels, as it is stored; requested: dataset, method, scene and view of each requested
    restoration; datasets, methods: labels, in the order of the command; baseline: the method that the others are
    compared with, empty for the best; crashed: whether a process ended unexpectedly; nothing_scored: whether metrics
    were requested, and none of them has a value for any view.
    """

    rows: DataFrame
    stored: DataFrame
    requested: frozenset[tuple[str, str, str, str]]
    out: Path
    datasets: tuple[str, ...]
    methods: tuple[str, ...]
    wants_report: bool
    study: Study | None
    baseline: str
    tracking: Tracking
    ok: int
    cached: int
    failed: tuple[Fault, ...]
    skipped: tuple[Fault, ...]
    scores_failed: tuple[Fault, ...]
    interrupted: bool
    crashed: bool
    nothing_scored: bool

    @property
    def requested_rows(self) -> DataFrame:
        """Those of `rows` of the requested restorations."""
        keys = values_of(self.rows, "dataset", "method", "scene", "view")
        return self.rows[[key in self.requested for key in keys]].reset_index(drop=True)

    @property
    def exit_code(self) -> int:
        """0: all is finished; 1: a view or score failed, or nothing was restored or scored; 130: stopped by Ctrl-C."""
        if self.interrupted:
            return 130
        has_fault = self.failed or self.scores_failed or self.crashed
        return 1 if has_fault or not self.ok or self.nothing_scored else 0
