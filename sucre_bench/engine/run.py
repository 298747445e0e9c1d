"""Runs a whole command: checks everything first, runs the jobs, merges their rows, and returns the outcome."""

from __future__ import annotations

import re
import shutil
from collections import Counter, defaultdict
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from sucre_bench import compare, results
from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.engine.across_views import score_across_views
from sucre_bench.engine.common_pixels import score_on_common_pixels
from sucre_bench.engine.preflight import Planned, base_row, check, opening_once
from sucre_bench.engine.score import row_without_value
from sucre_bench.engine.workers import run_alone, run_jobs
from sucre_bench.errors import DiskFullError, InputError, SucreBenchError, one_line
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.experiment_file import record_experiment
from sucre_bench.jobs.job import CONFIG, Job, config_text
from sucre_bench.machine import progress, provenance
from sucre_bench.machine.files import RESULTS_MARK, check_results_folder, write_atomically
from sucre_bench.machine.processes import terminated_as_interrupt
from sucre_bench.machine.text_formats import keep_traceback, masked, now
from sucre_bench.results.layout import decoded_path, file_name, log_path, pairs_path
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import KEYS, restoration_rows, restorations, tuples, values_of

_MOST_VIEWS = 50  # whose records are read, evenly chosen
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class Fault:
    """Why a view has no result, or not all its scores."""

    where: str
    """Dataset and method, and the metric if it is at fault."""

    view: str
    reason: str


@dataclass(frozen=True)
class Hint:
    """A fault that most of the views have, and what to type."""

    where: str
    """Dataset and method."""

    # How many of the views whose records were read have it.
    n_views: int
    n_read: int

    text: str


@dataclass(frozen=True)
class Outcome:
    """The outcome of a run. The counts are of restorations: one view by one method."""

    rows: DataFrame
    """The score table of the folder, on common pixels where methods fill different ones."""

    requested_rows: DataFrame
    """Those of `rows` of the requested restorations."""

    # Labels of the requested restorations, in the order of the command.
    datasets: tuple[str, ...]
    methods: tuple[str, ...]

    job: Job
    """The first one, which has what all have in common, study and baseline say."""

    ok: int
    failed: tuple[Fault, ...]
    skipped: tuple[Fault, ...]

    nothing_scored: bool
    """Whether metrics were requested, and none of them has a value for any view."""

    cached: int
    scores_failed: tuple[Fault, ...]
    interrupted: bool

    crashed: bool
    """Whether a process ended unexpectedly."""

    hints: tuple[Hint, ...]
    """What to type against faults, one a method."""

    @property
    def out(self) -> Path:
        """The results folder."""
        return self.job.out

    @property
    def exit_code(self) -> int:
        """0: all is finished; 1: a view or score failed, or nothing was restored or scored; 130: stopped by Ctrl-C."""
        if self.interrupted:
            return 130
        has_fault = self.failed or self.scores_failed or self.crashed
        return 1 if has_fault or not self.ok or self.nothing_scored else 0


# Runs jobs, each of the overrides that Hydra composes it of; returns why each was lost, empty for one that ended.
Launch = Callable[[Sequence[tuple[str, ...]]], Sequence[str]]


@dataclass(frozen=True)
class Watch:
    """What follows a command."""

    start: Callable[[Job], None] = lambda _: None
    """Called with a job, before its data are opened."""

    before: Callable[[Sequence[Planned]], None] = lambda _: None
    """Called with all that is planned, before any work; with nothing if another sweeper chooses the jobs."""


def run(command: Command, watch: Watch | None = None, launch: Launch | None = None) -> Outcome:
    """Run the checked jobs of a command.

    launch: runs the jobs elsewhere; by default they run in worker processes of this machine.

    Raises ProblemsError before any work when something selected does not exist, cannot be opened or is not installed;
    OutputError when results cannot be written.
    """
    watch = watch or Watch()
    with progress.live(), opening_once():
        check_results_folder(command.jobs[0].out)
        watch.start(command.jobs[0])
        planned = check(command)
        started = now()
        first = command.jobs[0]
        _write_provenance(command, planned)
        watch.before(planned)
        interrupted = crashed = False
        n_alone = min(1, first.workers)  # what metrics do after all jobs has one worker, too
        try:
            with terminated_as_interrupt():
                crashed = not _run_jobs(command, planned, launch)
                if not crashed:
                    if any(
                        metric.plugin.is_of_pairs
                        for plan in planned
                        for metric in plan.job.metrics
                    ):
                        run_alone(
                            "pairs of views", partial(score_across_views, planned), n_alone
                        )
                    table = results.merge(first.out)
                    if compare.leaves_holes(table[0]):  # else all methods fill the same pixels
                        on_common_pixels = partial(score_on_common_pixels, planned, *table)
                        run_alone("common pixels", on_common_pixels, n_alone)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            if not crashed:  # else jobs may still be at work on a cluster
                _remove_shared(command)
            table = results.merge(first.out)
    missing = "missing" if interrupted else "failed"
    ends = [*_ends(table[0], planned, started, missing)]
    return _outcome(first, table, _requested(planned), ends, interrupted, crashed)


def _write_provenance(command: Command, planned: Sequence[Planned]) -> None:
    """Write environment.json, config.yaml and experiment.yaml."""
    first = command.jobs[0]
    data = defaultdict[str, set[str]](set)
    for plan in planned:
        data[plan.job.dataset.label] |= {task.base.data_id for task in plan.tasks}
    words = ["sucre-bench", "run", *(["-m"] if command.is_sweep else []), *command.words]
    ids = {label: ",".join(sorted(ids)) for label, ids in data.items()}
    provenance.write(first.out / RESULTS_MARK, words, first.seed, ids)
    text = config_text(command.jobs, command.words, command.is_sweep)
    write_atomically(first.out / CONFIG, masked(text).encode())
    record_experiment(command.jobs)


def _run_jobs(command: Command, planned: Sequence[Planned], launch: Launch | None) -> bool:
    """Run the jobs, and return whether that went well; their rows say what became of them.

    Raises DiskFullError, without the jobs that are left: none could write.
    """
    if launch is None:
        run_jobs(planned, command.jobs[0].workers)
        return True
    each = zip(planned, command.overrides, strict=True)
    waiting = [(plan, words) for plan, words in each if plan.todo]
    try:
        reasons = launch([words for _, words in waiting]) if waiting else ()
    except DiskFullError:
        raise
    except Exception as fault:
        keep_traceback(log_path(command.jobs[0].out), "launcher")
        reason = (
            one_line(fault) if isinstance(fault, SucreBenchError) else one_line(fault)[:160]
        )
        progress.say(f"failed  the launcher: {reason}", is_fault=True)
        return False
    lost = defaultdict[tuple[str, str], list[tuple[Job, str]]](list)
    for (plan, _), reason in zip(waiting, reasons, strict=True):
        if reason:
            lost[plan.labels].append((plan.job, reason))
    for labels, ((job, reason), *others) in lost.items():
        reason += f"; and {len(others)} more of its jobs" if others else ""
        progress.say(f"failed  {' / '.join(labels)}: {reason}", is_fault=True)
        row = row_without_value(base_row(job), "failed", reason)
        results.write_rows(job.out, file_name("-".join(labels)), [row])
    return True


def _remove_shared(command: Command) -> None:
    """Remove what the jobs of a command shared, decoded files and pairs, and what a killed command left.

    Another command that works in the same results folder makes again what it needs.
    """
    job = command.jobs[0]
    if not job.cache_keep:
        shutil.rmtree(decoded_path(job.out), ignore_errors=True)
    if job.shared_pairs:
        shutil.rmtree(pairs_path(job.out) / job.shared_pairs, ignore_errors=True)
        with suppress(OSError):  # another command shares there
            pairs_path(job.out).rmdir()


def _ends(
    rows: DataFrame, planned: Sequence[Planned], started: str, missing: str
) -> Iterator[tuple[str, bool, Fault]]:
    """Yield of each requested restoration the status, whether it was stored, and the reason.

    started: when the run began; missing: the status of one that has no row since then.
    """
    restored = restoration_rows(rows)
    keys = ("dataset", "method", "scene", "view")
    states = {
        row[:4]: row[4:] for row in values_of(restored, *keys, "status", "reason", "time")
    }
    for plan in planned:
        todo = {id(task) for task in plan.todo}
        of_job = states.get((*plan.labels, "", ""))
        for task in plan.tasks:
            is_cached = id(task) not in todo
            of_view = states.get((*plan.labels, task.base.scene, task.view.name))
            status = missing
            reason = "did not finish"
            # what became of the whole job, unless there is more of the view
            for state in (of_job, of_view):
                if state and (is_cached or state[2] >= started):
                    status, reason, _ = state
            yield status, is_cached, Fault(plan.name, task.view.name, reason)


def _of(rows: DataFrame, restorations: Container[tuple[str, ...]]) -> DataFrame:
    """The rows of some restorations, each given by dataset, scene, view and method."""
    is_of = [key in restorations for key in values_of(rows, *KEYS)]
    return rows.loc[is_of].reset_index(drop=True)


def _requested(planned: Sequence[Planned]) -> dict[tuple[str, ...], set[str]]:
    """The names of the metrics of each requested restoration."""
    metrics = defaultdict[tuple[str, ...], set[str]](set)
    for plan in planned:
        dataset, method = plan.labels
        names = {metric.plugin.name for metric in plan.job.metrics}
        for task in plan.tasks:
            metrics[dataset, task.base.scene, task.view.name, method] |= names
    return metrics


def outcome_of(job: Job, started: str) -> Outcome:
    """Return the outcome of jobs that another sweeper chose, whose rows are from this time on."""
    table = results.merge(job.out)
    restored = restoration_rows(table[0])
    fresh = restored[restored["time"] >= started]
    names = {metric.plugin.name for metric in job.metrics}
    ends = [
        (row.status, False, Fault(f"{row.dataset} / {row.method}", row.view, row.reason))
        for row in tuples(fresh)
    ]
    return _outcome(job, table, dict.fromkeys(values_of(fresh, *KEYS), names), ends)


def _outcome(
    job: Job,
    table: tuple[DataFrame, DataFrame],
    metrics: Mapping[tuple[str, ...], set[str]],
    ends: Sequence[tuple[str, bool, Fault]],
    interrupted: bool = False,
    crashed: bool = False,
) -> Outcome:
    """Count what became of the requested restorations and scores.

    table: after the run, see `results.merge`; metrics: of each requested restoration; ends: see `_ends`.
    """
    rows = compare.on_pixels(*table)
    requested = _of(rows, metrics)
    is_asked = [
        name in metrics[tuple(key)] for *key, name in values_of(requested, *KEYS, "metric")
    ]
    asked = requested.loc[is_asked]

    def faults(wanted: str) -> tuple[Fault, ...]:
        return tuple(fault for status, _, fault in ends if status == wanted)

    return Outcome(
        rows=rows,
        requested_rows=requested,
        datasets=tuple(dict.fromkeys(key[0] for key in metrics)),
        methods=tuple(dict.fromkeys(key[-1] for key in metrics)),
        job=job,
        ok=len(faults("ok")),
        cached=sum(is_cached for status, is_cached, _ in ends if status == "ok"),
        failed=faults("failed"),
        skipped=faults("skipped"),
        scores_failed=tuple(
            Fault(f"{row.dataset} / {row.method} / {row.metric}", row.view, row.reason)
            for row in tuples(asked[asked["status"] == "failed"])
        ),
        interrupted=interrupted,
        crashed=crashed,
        nothing_scored=any(metrics.values()) and not (asked["status"] == "ok").any(),
        hints=tuple(_hints(_of(restorations(table[0]), metrics), job.out)),
    )


def _hints(restored: DataFrame, out: Path) -> Iterator[Hint]:
    """Yield the most frequent of the "hints" in the records of each method's restorations, if they have any.

    restored: the rows of restored views. Hints that differ by numbers alone are one.
    """
    for labels, rows in restored.groupby(["dataset", "method"], sort=False):
        some = rows.iloc[evenly(len(rows), _MOST_VIEWS)]
        kinds, first = Counter[str](), dict[str, str]()
        for row in tuples(some):
            try:
                found = read_record(row, out).get("hints", ())
            except InputError:  # damaged; the picture may be whole
                continue
            of_view = {_NUMBER.sub("", text): text for text in found}
            kinds.update(of_view.keys())
            first = of_view | first
        if kinds:
            kind, n_views = kinds.most_common(1)[0]
            yield Hint(" / ".join(labels), n_views, len(some), first[kind])
