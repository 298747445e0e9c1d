"""A whole command: check everything before any work, run the jobs through Hydra, join their rows, say what came out."""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench import config, console, plugins, progress, provenance, results, tracking
from sucre_bench.config import CONF, Choice, Job, Sweep
from sucre_bench.errors import InputError, SucreBenchError
from sucre_bench.plugins import Plugin
from sucre_bench.resume import Done
from sucre_bench.run import Task, open_scenes, run_job, tasks
from sucre_bench.scene import Scene

if TYPE_CHECKING:
    import pandas as pd
    from omegaconf import DictConfig

__all__ = ["Fault", "Outcome", "ProblemsError", "run"]


class ProblemsError(SucreBenchError):
    """Everything the check before the work found, a line each."""


@dataclass(frozen=True)
class Fault:
    """Why a view has no result, or not all its scores. where: dataset and method, and the metric if it is at fault."""

    where: str
    view: str
    reason: str


@dataclass(frozen=True)
class Outcome:
    """What a command came to. The counts are of restorations: one view by one method.

    methods: the labels in the order they were asked for; crashed: a process ended that should not have.
    """

    rows: pd.DataFrame
    out: Path
    methods: tuple[str, ...]
    wants_report: bool
    ok: int
    cached: int
    failed: tuple[Fault, ...]
    skipped: tuple[Fault, ...]
    scores_failed: tuple[Fault, ...]
    interrupted: bool
    crashed: bool

    @property
    def exit_code(self) -> int:
        """0 when everything asked for was done or had a reason not to be; 130 after Ctrl-C."""
        if self.interrupted:
            return 130
        return 1 if self.failed or self.scores_failed or self.crashed or not self.ok else 0


def run(overrides: Sequence[str], multirun: bool, plugin_files: Sequence[str] = ()) -> Outcome:
    """Run what the overrides ask for.

    Raises ProblemsError before any work when something selected does not exist, cannot be opened or is not installed;
    OutputError when results cannot be written.
    """
    overrides = list(overrides)
    if plugin_files:
        for file in plugin_files:
            plugins.load_file(file)
        listed = ",".join("'" + str(Path(f).resolve()).replace("'", r"\'") + "'" for f in plugin_files)
        overrides.append(f"plugins=[{listed}]")
    sweep = config.jobs(overrides, multirun)
    out = sweep.jobs[0].out
    with console.live():
        planned = _check(sweep)
        _write_provenance(sweep, planned)
        started = results.now()
        parent = tracking.start_sweep(sweep, name=out.name) or ""
        interrupted = crashed = False
        try:
            with _terminated_as_interrupt():
                crashed = not _launch(sweep, parent, sum(len(plan.tasks) for plan in planned))
        except KeyboardInterrupt:
            interrupted = True
        finally:
            rows = results.merge(out)
        outcome = _outcome(rows, planned, started, interrupted, crashed)
        if parent:
            tracking.finish_sweep(sweep, parent, rows, outcome.exit_code == 0)
    return outcome


# -- the check before the work -----------------------------------------------------------------------------


@dataclass(frozen=True)
class _Planned:
    """A job with what it will do, and the data it works on."""

    job: Job
    tasks: tuple[Task, ...]
    data_id: str


def _check(sweep: Sweep) -> list[_Planned]:
    problems: list[str] = []
    if len({job.out.resolve() for job in sweep.jobs}) > 1:
        problems.append("out: not the same for all jobs of the sweep; give one folder")
    for plugin in _plugins_of(sweep.jobs):
        if line := plugins.missing_packages(plugin):
            problems.append(f"{plugin.kind} '{plugin.name}': not installed; {line}")
    opened: dict[str, list[Scene]] = {}
    planned: list[_Planned] = []
    for job in sweep.jobs:
        key = results.fingerprint(job.dataset.record)[1]
        try:
            for choice in (job.method, *(m.choice for m in job.metrics)):
                _made(choice)
            if key not in opened:
                opened[key] = open_scenes(job.dataset)
            planned.append(_Planned(job, tuple(tasks(job, opened[key])), _data_id(opened[key])))
        except SucreBenchError as fault:
            problems.append(str(fault))
    if not problems:
        problems = _clashes(planned)
    if problems:
        raise ProblemsError("\n".join(dict.fromkeys(problems)))
    return planned


def _plugins_of(jobs: Sequence[Job]) -> list[Plugin]:
    every = [p for job in jobs for p in (job.dataset.plugin, job.method.plugin, *(m.plugin for m in job.metrics))]
    return list({(p.kind, p.name): p for p in every}.values())


def _made(choice: Choice) -> None:
    try:
        choice.make()
    except SucreBenchError:
        raise
    except Exception as fault:
        raise InputError(f"{choice.plugin.name}: {type(fault).__name__}: {fault}; mend its options") from fault


def _data_id(scenes: Sequence[Scene]) -> str:
    return ",".join(sorted({scene.data_id for scene in scenes}))


def _clashes(planned: Sequence[_Planned]) -> list[str]:
    """Labels that already stand for something else in the output folder: their results would be overwritten."""
    try:
        rows = results.read(planned[0].job.out)
    except InputError as fault:
        return [str(fault)] if "not a table" in str(fault) else []
    said = []
    for plan in planned:
        job = plan.job
        if job.overwrite == "always":
            continue
        there = rows[rows["dataset"] == job.dataset.label]
        scenes = set(there["scene"]) - {""}
        if scenes and plan.tasks and not scenes & {task.scene.name for task in plan.tasks}:
            said.append(
                f"{job.out}: its '{job.dataset.label}' is scene {sorted(scenes)[0]}, not {plan.tasks[0].scene.name}; "
                "give another out=... or dataset.label=..."
            )
        own = there[(there["method"] == job.method.label) & (there["scene"] != "")]
        if len(own) and set(own["options_id"]) != {results.fingerprint(job.method.record)[1]}:
            said.append(
                f"{job.out}: its '{job.method.label}' has other options; "
                "give another method.label=... or overwrite=always"
            )
    return said


# -- running -----------------------------------------------------------------------------------------------


# Steps the line of the whole sweep; None in the processes of a parallel launcher, which each tell of their own job.
_view_done: ContextVar[Callable[[], None] | None] = ContextVar("view_done", default=None)


def _launch(sweep: Sweep, parent: str, restorations: int) -> bool:
    """Hand the command to Hydra, whose launchers run `_hydra_job` here or elsewhere; return whether all came back."""
    import hydra

    arguments = [*sweep.overrides, f"tracking.parent_run='{parent}'", *(["--multirun"] if sweep.multirun else [])]
    config.register()
    main = hydra.main(config_path=f"pkg://{CONF}", config_name="config", version_base="1.3")(_hydra_job)
    before, sys.argv = sys.argv, ["sucre-bench run", *arguments]
    try:
        if len(sweep.jobs) == 1 or not sweep.in_process:
            main()
        else:
            with progress.line(f"{len(sweep.jobs)} jobs", restorations) as step:
                token = _view_done.set(step)
                try:
                    main()
                finally:
                    _view_done.reset(token)
    except SystemExit as ended:  # Hydra's way to say that a job's process died; the missing rows tell which
        return not ended.code
    finally:
        sys.argv = before
    return True


def _hydra_job(settings: DictConfig) -> None:
    for file in settings.plugins:
        plugins.load_file(file)
    job = Job.of(settings)
    with nullcontext() if progress.is_watched() else console.plain():
        try:
            if run_job(job, _view_done.get() or (lambda: None)):
                tracking.log_job(job)
        except SucreBenchError as fault:
            progress.say(f"failed  {job.dataset.label} / {job.method.label}: {fault}")


@contextmanager
def _terminated_as_interrupt() -> Iterator[None]:
    """Let a polite kill end like Ctrl-C: what is done is kept and joined."""

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    try:
        before = signal.signal(signal.SIGTERM, interrupt)
    except ValueError:  # not the main thread: whoever runs us handles signals
        yield
        return
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


# -- afterwards --------------------------------------------------------------------------------------------


def _write_provenance(sweep: Sweep, planned: Sequence[_Planned]) -> None:
    first = sweep.jobs[0]
    data = {plan.job.dataset.label: plan.data_id for plan in planned}
    command = ["sucre-bench", "run", *(["-m"] if sweep.multirun else []), *sweep.overrides]
    provenance.write(first.out / "environment.json", provenance.environment(command, first.seed, data))
    results.write_atomically(first.out / "config.yaml", _config(sweep).encode())


def _config(sweep: Sweep) -> str:
    """The configuration as YAML; of a sweep, what its jobs share, what it was asked for, and what differs by job."""
    import yaml

    if not sweep.multirun:
        return sweep.jobs[0].config
    each: list[dict[str, Any]] = [yaml.safe_load(job.config) for job in sweep.jobs]
    shared = {key: value for key, value in each[0].items() if all(one[key] == value for one in each)}
    differing = [{key: value for key, value in one.items() if key not in shared} for one in each]
    return str(yaml.safe_dump({**shared, "sweep": list(sweep.overrides), "jobs": differing}, sort_keys=False))


def _outcome(
    rows: pd.DataFrame, planned: Sequence[_Planned], started: str, interrupted: bool, crashed: bool
) -> Outcome:
    own = rows[rows["metric"] == "seconds"]
    state = {(r.dataset, r.scene, r.view, r.method): (r.status, r.reason, r.time) for r in own.itertuples()}
    ok = cached = 0
    failed: list[Fault] = []
    skipped: list[Fault] = []
    for plan in planned:
        job, done = plan.job, Done.of(plan.job)
        of = (job.dataset.label, job.method.label)
        for task in plan.tasks:
            scene, view = task.scene.name, task.view.name
            status, reason, when = state.get(
                (of[0], scene, view, of[1]), state.get((of[0], "", "", of[1]), ("missing", "", ""))
            )
            # What was there before counts where it is what was asked for; else this job never got to it.
            is_new = when >= started
            if not is_new and not done.covers(task.base, task.place.restored(job.out, job.method.label)):
                status, reason = "missing", "did not finish"
            fault = Fault(f"{of[0]} / {of[1]}", view, reason)
            if status == "ok":
                ok, cached = ok + 1, cached + (not is_new)
            elif status == "skipped":
                skipped.append(fault)
            elif not (status == "missing" and interrupted):
                failed.append(fault)
    first = planned[0].job
    return Outcome(
        rows=rows,
        out=first.out,
        methods=tuple(dict.fromkeys(plan.job.method.label for plan in planned)),
        wants_report=first.report,
        ok=ok,
        cached=cached,
        failed=tuple(failed),
        skipped=tuple(skipped),
        scores_failed=tuple(_failed_scores(rows, planned)),
        interrupted=interrupted,
        crashed=crashed,
    )


def _failed_scores(rows: pd.DataFrame, planned: Sequence[_Planned]) -> Iterator[Fault]:
    """The scores among those asked for that a metric failed to give."""
    asked = {
        (plan.job.dataset.label, plan.job.method.label, task.scene.name, task.view.name, metric.plugin.name)
        for plan in planned
        for task in plan.tasks
        for metric in plan.job.metrics
    }
    for r in rows[rows["status"] == "failed"].itertuples():
        if (r.dataset, r.method, r.scene, r.view, r.metric) in asked:
            yield Fault(f"{r.dataset} / {r.method} / {r.metric}", r.view, r.reason)
