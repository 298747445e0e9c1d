"""Runs a whole command: checks everything first, runs the jobs, merges their rows, and returns the outcome."""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence, Set
from contextlib import suppress
from functools import partial
from typing import TYPE_CHECKING, Any

from sucre_bench import compare, results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.across_views import score_across_views
from sucre_bench.engine.common_pixels import score_on_common_pixels
from sucre_bench.engine.job import JobAtWork
from sucre_bench.engine.outcome import Fault, Outcome
from sucre_bench.engine.preflight import Planned, check, is_for_cluster, states, workers_at_once
from sucre_bench.engine.select_views import opening_once
from sucre_bench.engine.workers import Alone, run_works
from sucre_bench.errors import DiskFullError, SucreBenchError, one_line
from sucre_bench.jobs import compose_jobs as config
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.config_file import config_path, config_text
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup_of_results import record_line_up
from sucre_bench.machine import progress, progress_display, provenance
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.records import keep_traceback, masked, now
from sucre_bench.machine.sigterm import terminated_as_interrupt
from sucre_bench.results.common_scores import read_common
from sucre_bench.results.layout import decoded_path, log_path, pairs_path
from sucre_bench.results.rows import Status

if TYPE_CHECKING:
    from sucre_bench.engine.slurm.launcher import Launcher


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
        started = now()
        interrupted = crashed = False
        _share_decoded(planned)
        try:
            with terminated_as_interrupt():
                crashed = not _run_jobs(command, planned)
                if not crashed:
                    _alone("pairs of views", partial(score_across_views, planned), planned)
        except KeyboardInterrupt:
            interrupted = True
        finally:
            if not crashed:  # else jobs may still be at work on a cluster
                _remove_shared(command)
            rows = results.merge(out)
        if not (interrupted or crashed):
            try:
                with terminated_as_interrupt():
                    _alone("common pixels", partial(score_on_common_pixels, planned, rows, out), planned)
            except KeyboardInterrupt:
                interrupted = True
    return _outcome(rows, planned, started, interrupted, crashed)


def _run_jobs(command: Command, planned: Sequence[Planned]) -> bool:
    """Run the jobs where the command says, and return whether that went well; their rows say what became of them.

    Raises DiskFullError, without the jobs that are left: none could write.
    """
    if launcher := _cluster(command):
        try:
            launcher.launch(command.jobs)
        except DiskFullError:
            raise
        except Exception as fault:
            keep_traceback(log_path(command.jobs[0].out), "launcher")
            reason = one_line(fault) if isinstance(fault, SucreBenchError) else one_line(fault)[:160]
            progress.say(f"failed  the launcher: {reason}", is_fault=True)
            return False
        return True
    if len(command.jobs) == 1:
        run_works([JobAtWork(command.jobs[0])], command.jobs[0].workers)
        return True
    with progress.line(f"{len(command.jobs)} jobs", sum(len(plan.tasks) for plan in planned)) as after_view:
        run_works([JobAtWork(job, after_view) for job in command.jobs], workers_at_once(command))
    return True


def _cluster(command: Command) -> Launcher | None:
    """The launcher of a sweep for SLURM; None where the jobs run on this machine."""
    settings = command.settings.hydra.launcher
    if not is_for_cluster(command):
        return None
    from hydra.utils import instantiate
    from omegaconf import OmegaConf

    launcher: Launcher = instantiate(OmegaConf.to_container(settings, resolve=True), _convert_="all")
    return launcher


def _alone(name: str, work: Callable[[], None], planned: Sequence[Planned]) -> None:
    """Do what metrics do after all jobs, in a worker."""
    run_works([Alone(name, work)], min(1, planned[0].job.workers))


def _share_decoded(planned: Sequence[Planned]) -> None:
    """Make the folder that tells jobs to share, where anything would be decoded twice. No disk for it is no fault."""
    first = planned[0].job
    if first.cache_gb > 0 and _decodes_again(planned):
        with suppress(OSError):
            decoded_path(first.out).mkdir(parents=True, exist_ok=True)


def _remove_decoded(job: Job) -> None:
    """Remove what the jobs of a command shared, and what a killed one left, unless it is to be kept.

    Another command that works in the same results folder makes again what it needs.
    """
    if not job.cache_keep:
        shutil.rmtree(decoded_path(job.out), ignore_errors=True)


def _decodes_again(planned: Sequence[Planned]) -> bool:
    """Whether two restorations read the same view: by two methods, or by one that reads a target's neighbours."""
    if any(plan.job.cache_keep for plan in planned):
        return True
    read = Counter((plan.job.dataset.label, task.base.scene, task.view.name) for plan in planned for task in plan.tasks)
    reads_neighbours = any("poses" in plan.job.method.plugin.needs and len(plan.tasks) > 1 for plan in planned)
    return reads_neighbours or max(read.values(), default=0) > 1


def _remove_shared(command: Command) -> None:
    """Remove what the jobs of a command shared: decoded files and pairs."""
    _remove_decoded(command.jobs[0])
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
