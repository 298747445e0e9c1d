"""Runs a whole command: checks everything first, launches the jobs, merges their rows, and returns the outcome."""

import shutil
from collections.abc import Iterator, Sequence, Set
from contextlib import suppress
from typing import Any

from sucre_bench import compare, results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.across_views import score_across_views
from sucre_bench.engine.common_pixels.of_run import score_on_common_pixels
from sucre_bench.engine.launch import Ended, launch
from sucre_bench.engine.outcome import Fault, Outcome
from sucre_bench.engine.preflight import Planned, check, states
from sucre_bench.engine.rescue_jobs import rescue
from sucre_bench.engine.select_views import opening_once
from sucre_bench.engine.share_decoded import remove_decoded, share_decoded
from sucre_bench.jobs import compose_jobs as config
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.config_file import config_path, config_text
from sucre_bench.jobs.lineup_of_results import record_line_up
from sucre_bench.machine import progress_display, provenance
from sucre_bench.machine.current_step import note_start
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.records import masked, now
from sucre_bench.machine.sigterm import terminated_as_interrupt
from sucre_bench.results.common_scores import read_common
from sucre_bench.results.layout import pairs_path
from sucre_bench.results.rows import Status


def run(overrides: Sequence[str], multirun: bool) -> Outcome:
    """Run what the overrides ask for.

    Raises ProblemsError before any work when something selected does not exist, cannot be opened or is not installed;
    OutputError when results cannot be written.
    """
    with progress_display.live(), opening_once():
        command = config.jobs(overrides, multirun)
        out = command.jobs[0].out
        planned = check(command)
        _write_provenance(command, planned)
        started = note_start(now())
        interrupted = crashed = False
        share_decoded(planned)
        try:
            with terminated_as_interrupt():
                ended = launch(command, sum(len(plan.tasks) for plan in planned))
                crashed = ended is Ended.CRASHED
                if ended is Ended.WORKER_DIED:
                    rescue(planned, started)
                if not crashed:
                    score_across_views(planned)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            if not crashed:  # else jobs may still be at work on a cluster
                _remove_shared(command)
            rows = results.merge(out)
        if not (interrupted or crashed):
            try:
                with terminated_as_interrupt():
                    score_on_common_pixels(planned, rows, out)
            except KeyboardInterrupt:
                interrupted = True
    return _outcome(rows, planned, started, interrupted, crashed)


def _remove_shared(command: Command) -> None:
    """Remove what the jobs of a command shared: decoded files and pairs."""
    remove_decoded(command.jobs[0])
    if command.shared_pairs:
        pairs = pairs_path(command.jobs[0].out)
        shutil.rmtree(pairs / command.shared_pairs, ignore_errors=True)
        with suppress(OSError):  # another command shares there
            pairs.rmdir()


def _write_provenance(command: Command, planned: Sequence[Planned]) -> None:
    first = command.jobs[0]
    ids: dict[str, set[str]] = {}
    for plan in planned:
        ids.setdefault(plan.job.dataset.label, set()).add(plan.data_id)
    data = {label: ",".join(sorted(data_ids)) for label, data_ids in ids.items()}
    words = ["sucre-bench", "run", *(["-m"] if command.is_sweep else []), *command.words]
    provenance.write(first.out / "environment.json", provenance.environment(words, first.seed, data))
    text = config_text(command.jobs, command.words, command.is_sweep)
    write_atomically(config_path(first.out), masked(text).encode())
    record_line_up(command.jobs)


def _outcome(rows: DataFrame, planned: Sequence[Planned], started: str, interrupted: bool, crashed: bool) -> Outcome:
    ok = cached = 0
    failed: list[Fault] = []
    skipped: list[Fault] = []
    for plan in planned:
        for task, state in zip(plan.tasks, states(rows, plan, started), strict=True):
            fault = Fault(f"{plan.job.dataset.label} / {plan.job.method.label}", task.view.name, state.reason)
            if state.status == "ok":
                ok += 1
                cached += not state.is_new
            elif state.status == "skipped":
                skipped.append(fault)
            elif state.status == "failed" or not interrupted:
                failed.append(fault)
    first = planned[0].job
    scores = compare.on_pixels(rows, read_common(first.out))
    requested = _requested_scores(planned)
    return Outcome(
        rows=scores,
        stored=rows,
        requested=_requested(planned),
        out=first.out,
        datasets=tuple(dict.fromkeys(plan.job.dataset.label for plan in planned)),
        methods=tuple(dict.fromkeys(plan.job.method.label for plan in planned)),
        wants_report=first.report,
        study=first.study,
        baseline=first.baseline,
        tracking=first.tracking,
        ok=ok,
        cached=cached,
        failed=tuple(failed),
        skipped=tuple(skipped),
        scores_failed=tuple(_failed_scores(scores, requested)),
        interrupted=interrupted,
        crashed=crashed,
        nothing_scored=bool(requested) and not any(_with_status(scores, requested, "ok")),
    )


def _requested(planned: Sequence[Planned]) -> frozenset[tuple[str, str, str, str]]:
    return frozenset(
        (plan.job.dataset.label, plan.job.method.label, task.base.scene, task.view.name)
        for plan in planned
        for task in plan.tasks
    )


def _requested_scores(planned: Sequence[Planned]) -> frozenset[tuple[str, str, str, str, str]]:
    """Dataset, method, scene, view and metric of each requested score."""
    return frozenset(
        (plan.job.dataset.label, plan.job.method.label, task.base.scene, task.view.name, metric.plugin.name)
        for plan in planned
        for task in plan.tasks
        for metric in plan.job.metrics
    )


def _with_status(rows: DataFrame, requested: Set[tuple[str, ...]], status: Status) -> Iterator[Any]:
    """The rows of requested scores that have a status."""
    for r in rows[rows["status"] == status].itertuples():
        if (r.dataset, r.method, r.scene, r.view, r.metric) in requested:
            yield r


def _failed_scores(rows: DataFrame, requested: Set[tuple[str, ...]]) -> Iterator[Fault]:
    """The requested scores that a metric failed to give."""
    for r in _with_status(rows, requested, "failed"):
        yield Fault(f"{r.dataset} / {r.method} / {r.metric}", r.view, r.reason)
