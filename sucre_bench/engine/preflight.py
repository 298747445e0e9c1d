"""The check before the work: opens all that a command selects, and compares it with the stored results."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Literal

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.score import metric_code, score_code
from sucre_bench.engine.select_views import Task, open_scenes, opening_once, tasks
from sucre_bench.errors import (
    FileError,
    InputError,
    MissingFileError,
    SucreBenchError,
    did_you_mean,
    one_line,
    raise_if_stop,
)
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.job import Job
from sucre_bench.machine.cores import usable_cores
from sucre_bench.plugins.options import Choice
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.layout import file_name
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import are_stored
from sucre_bench.results.rows import Row, Status, restoration_rows, tuples


class ProblemsError(SucreBenchError):
    """Everything the check before the work found, a line each."""


@dataclass(frozen=True)
class Planned:
    """A job with what it will do, and the data it works on."""

    job: Job
    tasks: tuple[Task, ...]
    data_id: str


@opening_once()
def check(command: Command) -> list[Planned]:
    """Return what each job will do. Raises ProblemsError with everything that is wrong, a line each."""
    problems: list[str] = []
    if len({job.out.resolve() for job in command.jobs}) > 1:
        problems.append("out: not the same for all jobs of the sweep; give one folder")
    for plugin in _plugins_of(command.jobs):
        if line := plugins.missing_packages(plugin):
            problems.append(f"{plugin.kind} '{plugin.name}': not installed; {line}")
    problems += _unknown_baseline(command.jobs)
    if not is_for_cluster(command):
        try:
            workers_at_once(command)
        except InputError as fault:
            problems.append(str(fault))
    planned: list[Planned] = []
    for job in command.jobs:
        try:
            for choice in (job.method, *(m.choice for m in job.metrics)):
                _made(choice, command)
            scenes = open_scenes(job.dataset)
            data_ids = sorted({job.drawn.data_id(scene.data_id) for scene in scenes})
            planned.append(Planned(job, tuple(tasks(job, scenes)), ",".join(data_ids)))
        except SucreBenchError as fault:
            problems.append(str(fault))
    if not problems:
        problems = _clashes(planned)
    if problems:
        raise ProblemsError("\n".join(dict.fromkeys(problems)))
    return planned


def _unknown_baseline(jobs: Sequence[Job]) -> list[str]:
    """Refuse a baseline that is no method at all. A baseline that is a method, but not of this sweep, is left out."""
    known = {*(job.method.label for job in jobs), *plugins.discover("method")}
    asked, key = jobs[0].baseline, "baseline"
    if not asked and jobs[0].study:
        asked, key = jobs[0].study.baseline, "study.baseline"
    unknown = asked and asked not in known
    return [f"{key}: no method is called '{asked}'; {did_you_mean(asked, known)}"] if unknown else []


def _plugins_of(jobs: Sequence[Job]) -> list[Plugin]:
    every = [p for job in jobs for p in (job.dataset.plugin, job.method.plugin, *(m.plugin for m in job.metrics))]
    return list({(p.kind, p.name): p for p in every}.values())


def _made(choice: Choice, command: Command) -> None:
    try:
        choice.make(command.jobs[0].out)
    except SucreBenchError as fault:
        raise InputError(_as_typed(str(fault), choice, command)) from fault
    except BaseException as fault:
        raise_if_stop(fault)
        raise InputError(one_line(fault), choice.plugin.name, "mend its options") from fault


def _as_typed(text: str, choice: Choice, command: Command) -> str:
    """A plugin's error with its options as the user names them: its "method.model" is "onnx.model" beside others."""
    kind, name = choice.plugin.kind, choice.plugin.name
    typed = {word.partition("=")[0] for word in command.words}
    is_one_of_several = kind == "method" and len({job.method.label for job in command.jobs}) > 1

    def key(found: re.Match[str]) -> str:
        keys = [f"{owner}.{found[1]}" for owner in (choice.label, name, kind)]
        default = keys[0] if is_one_of_several and choice.label.isidentifier() else keys[-1]
        return next((one for one in keys if one in typed), default)

    options = "|".join(map(re.escape, choice.options))
    return re.sub(rf"(?<![\w/.]){kind}\.({options})\b", key, text) if options else text


def _clashes(planned: Sequence[Planned]) -> list[str]:
    """Labels that already stand for something else in the output folder: their results would be overwritten."""
    try:
        rows = results.read(planned[0].job.out)
    except MissingFileError:  # there are no results yet
        return []
    except FileError as fault:
        return [str(fault)]
    said = []
    for plan in planned:
        job = plan.job
        if job.overwrite == "always":
            continue
        there = rows[rows["dataset"] == job.dataset.label]
        scenes = {results.unreplicated(scene)[0] for scene in there["scene"].unique()} - {""}
        if scenes and plan.tasks and not scenes & {task.scene.name for task in plan.tasks}:
            option = _label_option([plan.job.dataset for plan in planned], job.dataset)
            remedy = " or ".join(dict.fromkeys(["out=...", option]))
            said.append(
                f"{job.out}: its '{job.dataset.label}' is scene {sorted(scenes)[0]}, not {plan.tasks[0].scene.name}; "
                f"give another {remedy}"
            )
        option = _label_option([plan.job.method for plan in planned], job.method)
        same_folder = set(there["method"].unique()) - {job.method.label}
        for other in sorted(o for o in same_folder if file_name(o) == file_name(job.method.label)):
            said.append(f"{job.out}: '{job.method.label}' would share a folder with '{other}'; give another {option}")
        is_result = (there["scene"] != "") & (there["status"] != "failed")  # what failed may be tried another way
        of_method = there[(there["method"] == job.method.label) & is_result]
        if len(of_method) and set(of_method["options_id"].unique()) != {results.fingerprint(job.method.record)[1]}:
            said.append(
                f"{job.out}: its '{job.method.label}' has other options; give another {option}, or overwrite=always"
            )
    return said


def _label_option(chosen: Sequence[Choice], one: Choice) -> str:
    """The word that gives one of a run's methods or datasets another label; out=... where no word is for it alone."""
    labels = {choice.label: choice.plugin.name for choice in chosen}
    if len(labels) == 1:
        return f"{one.plugin.kind}.label=..."
    called = [label for label, name in labels.items() if one.label in (label, name)]
    return f"{one.label}.label=..." if len(called) == 1 and one.label.isidentifier() else "out=..."


def is_for_cluster(command: Command) -> bool:
    """Whether the jobs are for SLURM, and not for this machine."""
    return command.is_sweep and "engine.slurm" in str(command.settings.hydra.launcher.get("_target_", ""))


def workers_at_once(command: Command) -> int:
    """Return how many jobs run at once on this machine; 0: in this process.

    Raises InputError for a launcher that is neither joblib's nor this program's.
    """
    settings, workers = command.settings.hydra.launcher, command.jobs[0].workers
    target = str(settings.get("_target_", ""))
    if not command.is_sweep or target.endswith("OneByOne") or not workers:
        return workers
    if "joblib" not in target:
        raise InputError("not known here", f"hydra/launcher ({target})", "give joblib or slurm, or workers=4")
    n_jobs = int(settings.get("n_jobs") or 1)
    return n_jobs if n_jobs > 0 else max(1, usable_cores() + 1 + n_jobs)


@dataclass(frozen=True)
class State:
    """What became of a task. status: "missing" if its job never got to it; is_new: made by this command."""

    status: Status | Literal["missing"] = "missing"
    reason: str = "did not finish"
    is_new: bool = False


def states(rows: DataFrame, plan: Planned, started: str) -> list[State]:
    """Return the state of each of a job's tasks. started: when the command did.

    Older results count if they are what the job would make.
    """
    job, done = plan.job, Done.among(rows, plan.job)
    restored = restoration_rows(rows[(rows["dataset"] == job.dataset.label) & (rows["method"] == job.method.label)])
    known = {(r.scene, r.view): State(r.status, r.reason, r.time >= started) for r in tuples(restored)}
    of_job = known.get(("", ""), State())
    found = []
    for task in plan.tasks:
        state = known.get((task.base.scene, task.view.name), of_job)
        is_valid = state.is_new or done.covers(task.base, task.place.restored(job.out, job.method.label))
        found.append(state if is_valid else State())
    return found


@dataclass(slots=True)
class _Kept:
    """What the table holds of a score."""

    metric: str
    variant: str
    code: str
    status: str
    options_id: str
    data_id: str


_KEPT = tuple(field.name for field in fields(_Kept))


@dataclass(frozen=True)
class Done:
    """What an output folder holds of a job, by the names of scene and view.

    It holds failed views and scores only if the process died at them, because they would end the next process, too.
    metric_codes: the code that the job's scores depend on, see `engine.score.metric_code`.
    """

    job: Job
    kept: dict[tuple[str, str], list[_Kept]]
    metric_codes: tuple[str, ...]
    _by_code: dict[str, frozenset[tuple[str, str, str]]] = field(default_factory=dict)

    @classmethod
    def of(cls, job: Job) -> Done:
        """Read the output folder of a job; one without a table holds nothing."""
        try:
            rows = results.read(job.out, dataset=job.dataset.label, method=job.method.label)
        except MissingFileError:
            rows = results.frame([])
        return cls.among(rows, job)

    @classmethod
    def among(cls, rows: DataFrame, job: Job) -> Done:
        """Pick what a table holds of a job."""
        kept: dict[tuple[str, str], list[_Kept]] = {}
        of_job = rows[(rows["dataset"] == job.dataset.label) & (rows["method"] == job.method.label)]
        is_kept = of_job["status"] != "failed"
        if job.overwrite != "failed":
            died = [text for text in of_job["reason"].unique() if Reason.of(text) is Reason.DIED]
            is_kept |= of_job["reason"].isin(died)
        for scene, view, *about in tuples(of_job[is_kept], "scene", "view", *_KEPT):
            kept.setdefault((scene, view), []).append(_Kept(*about))
        return cls(job, kept, tuple(map(metric_code, job.metrics)))

    def covers(self, base: Row, picture: Path) -> bool:
        """Whether a view needs no work. base: what its rows would say; picture: where its restoration is kept."""
        kept = self.kept.get((base.scene, base.view), [])
        if self.job.overwrite == "always":
            return False
        if self.job.overwrite == "never":
            return bool(kept)
        kept = [k for k in kept if (k.options_id, k.data_id) == (base.options_id, base.data_id)]
        there = {(k.metric, k.variant, k.code) for k in kept}
        whole = (base.metric, base.variant, base.code)
        if any(k.metric == base.metric and k.status != "ok" for k in kept):
            return whole in there
        suffixes = [".png", *([".npz"] if self.job.save == "full" else [])]
        return whole in there and self._wanted(base) <= there and are_stored(picture, suffixes)

    def _wanted(self, base: Row) -> frozenset[tuple[str, str, str]]:
        """The scores, by metric, variant and code, of a view whose rows say `base`: the same for all with its code."""
        if base.code not in self._by_code:
            self._by_code[base.code] = frozenset(
                (metric.plugin.name, variant, score_code(base, code))
                for metric, code in zip(self.job.metrics, self.metric_codes, strict=True)
                if not metric.plugin.is_of_pairs  # these are scored when all views are there
                for variant in metric.variants
            )
        return self._by_code[base.code]
