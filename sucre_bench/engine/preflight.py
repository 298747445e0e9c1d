"""The check before the work: opens the data, selects the views of a command, and compares them with stored results."""

from __future__ import annotations

import functools
import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.degrade import Degradation, around, degraded_whole
from sucre_bench.engine.score import charts_id, metric_code, score_code
from sucre_bench.errors import (
    InputError,
    LinesError,
    MissingFileError,
    PluginError,
    SucreBenchError,
    did_you_mean,
    file_error,
    one_line,
    raise_if_stop,
)
from sucre_bench.imaging.display import is_of_scene
from sucre_bench.jobs.compose_jobs import Command
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.run_options import Shard
from sucre_bench.loading.passed_over import say_passed_over
from sucre_bench.loading.view_files import source_files, with_shared_pixels
from sucre_bench.machine.files import expanded, is_want_of_room, not_writable
from sucre_bench.machine.provenance import require
from sucre_bench.plugins.options import Choice, options_of, source_hash
from sucre_bench.results.layout import Place, as_one_file, places
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import are_stored
from sucre_bench.results.rows import Row, restoration_rows, values_of
from sucre_bench.scene import Scene, View


@dataclass(frozen=True)
class Selection:
    """A scene of a dataset, degraded as was asked for, and those of its views that were chosen."""

    dataset: Choice
    degrade: Degradation
    scene: Scene
    views: tuple[View, ...]


def select(overrides: Sequence[str]) -> list[Selection]:
    """Return every scene of which views are chosen, in the dataset's order; pixels stay unread.

    degrade.within and degrade.keep choose views around one that is restored, and mean nothing here.
    Raises InputError as `compose_jobs.jobs` does, for data that are not as expected, and for a name that no view has.
    """
    from sucre_bench.jobs import compose_jobs

    job = compose_jobs.jobs(overrides, multirun=False).jobs[0]
    job = replace(job, degrade=replace(job.degrade, within=None, keep=None))
    chosen: dict[str, tuple[Scene, list[View]]] = {}
    for task in tasks(job, open_scenes(job.dataset)):
        chosen.setdefault(task.scene.name, (task.scene, []))[1].append(task.view)
    return [
        Selection(job.dataset, job.degrade, scene, tuple(views)) for scene, views in chosen.values()
    ]


@dataclass(frozen=True)
class Task:
    """A view to restore: where its results are kept, and what every row of it says."""

    scene: Scene
    view: View
    place: Place
    base: Row


_opened: ContextVar[dict[str, list[Scene] | SucreBenchError] | None] = ContextVar(
    "opened", default=None
)


@contextmanager
def opening_once() -> Iterator[None]:
    """In this block, open each dataset once, for all jobs of this process, also if that fails."""
    token = _opened.set({} if (opened := _opened.get()) is None else opened)
    try:
        yield
    finally:
        _opened.reset(token)


def open_scenes(dataset: Choice) -> list[Scene]:
    """Open every scene of a dataset; pixels stay unread. InputError or PluginError when it cannot be opened."""
    if (opened := _opened.get()) is None:
        return _open(dataset)
    key = results.fingerprint({**dataset.record, "replicate": dataset.seed})[1]
    if key not in opened:
        try:
            opened[key] = _open(dataset)
        except SucreBenchError as fault:
            opened[key] = fault
    found = opened[key]
    if isinstance(found, SucreBenchError):
        raise found
    return found


def _open(dataset: Choice) -> list[Scene]:
    try:
        scenes = list(dataset.make().scenes())
    except SucreBenchError:
        raise
    except (ImportError, OSError) as fault:
        if isinstance(fault, OSError) and fault.filename is not None:
            if is_want_of_room(fault):
                raise not_writable(Path(os.fsdecode(fault.filename)), fault) from fault
            remedy = "let this user read it, or give another path"
            raise file_error(os.fsdecode(fault.filename), fault, remedy) from fault
        reason = f"dataset '{dataset.label}': {one_line(fault)}"
        raise InputError(
            f"{reason}; if a library is missing, `sucre-bench doctor` says which"
        ) from fault
    except BaseException as fault:
        raise_if_stop(fault)
        reason = f"{one_line(fault)}; mend the plugin"
        raise PluginError(f"dataset '{dataset.label}': {reason}") from fault
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise PluginError(
                f"dataset '{dataset.label}': yields {type(scene).__name__}; scenes() yields Scene objects"
            )
        for kind, name in (("scene", scene.name), *(("view", view.name) for view in scene.views)):
            if not PurePosixPath(name).name:
                raise PluginError(
                    f"dataset '{dataset.label}': a {kind} is called '{name}'; give it a name"
                )
    name, times = Counter(scene.name for scene in scenes).most_common(1)[0] if scenes else ("", 0)
    if times > 1:
        raise InputError(
            f"dataset '{dataset.label}': {times} scenes are called '{name}'; rename a folder"
        )
    if not any(len(scene) for scene in scenes):
        raise InputError(f"dataset '{dataset.label}': no views; check its options")
    _say_passed_over(dataset, scenes)
    return scenes


def _say_passed_over(dataset: Choice, scenes: Sequence[Scene]) -> None:
    """Say what lies unread in the folders that the dataset's options name, and beside what its views read."""
    read = {file for scene in scenes for view in scene.views for file in source_files(view)}
    root = expanded(dataset.options.get("root") or "")
    if not read or not dataset.options.get("root"):
        return
    values = {option.name: option.default for option in options_of(dataset.plugin.cls)} | {
        **dataset.options
    }
    named = [
        root / expanded(value)
        for value in values.values()
        if isinstance(value, str | Path) and value
    ]
    is_published = bool(dataset.plugin.licence)
    folders = {*(path for path in named if path.is_dir()), *(file.parent for file in read)}
    read |= {path for sign in dataset.plugin.signs for path in root.glob(sign)}
    say_passed_over(root, sorted(folders), read, beside=not is_published)


def tasks(job: Job, scenes: Sequence[Scene]) -> Iterator[Task]:
    """Yield the views a job is to restore, degraded, in the dataset's order.

    Raises InputError for a name that no scene has, and for a scene that lacks what is to be degraded.
    """
    base, kept, drawn = base_row(job), places(job.dataset.label, scenes, job.replicate), job.drawn
    # A method that looks at charts may look at those of all views.
    codes = {s.name: f"{base.code}{charts_id(job.method.plugin, s.views)}" for s in scenes}
    data_ids = {scene.name: drawn.data_id(scene.data_id) for scene in scenes}
    is_degraded = bool(drawn.identity())
    degraded = [degraded_whole(scene, drawn) for scene in scenes] if is_degraded else scenes
    every = [(scene, view) for scene in degraded for view in scene.views]
    if job.views is not None:
        names = {view.name for _, view in every}
        if unknown := [name for name in job.views if name not in names]:
            hint = (
                did_you_mean(unknown[0], names)
                if len(names) < 20
                else f"there are {len(names)} others"
            )
            raise InputError(f"no view is called '{unknown[0]}'", "views", hint)
        chosen = set(job.views)
        every = [(scene, view) for scene, view in every if view.name in chosen]
    for scene, view in job.shard.of(every[:: job.every][: job.first]):
        name, data_id, code = (
            results.replicated(scene.name, job.replicate),
            data_ids[scene.name],
            codes[scene.name],
        )
        row = replace(base, scene=name, view=view.name, data_id=data_id, code=code)
        neighbours = around(scene, view, drawn) if is_degraded else scene
        yield Task(neighbours, view, kept[scene.name, view.name], row)


def base_row(job: Job) -> Row:
    """What every row of a job says."""
    about = {
        "dataset": job.dataset.record,
        **({"degrade": given} if (given := job.degrade.record) else {}),
        **({"replicate": job.replicate} if job.replicate else {}),
    }
    methods, files = job.method.rests_on
    return Row(
        dataset=job.dataset.label,
        method=job.method.label,
        options=results.fingerprint({**job.method.record, **about})[0],
        options_id=results.fingerprint(job.method.record)[1],
        seed=job.seed if job.method.seed is None else job.method.seed,
        code=source_hash(job.dataset.plugin, job.method.plugin, *methods, files=files),
    )


# Views of a scene, evenly chosen, whose percentiles and means stand for all in a display of the whole scene.
MOST_SHOWN_OVER = 40


class ProblemsError(LinesError):
    """Everything the check before the work found, a line each."""


@dataclass(frozen=True)
class Planned:
    """A job and what it will do."""

    job: Job

    tasks: tuple[Task, ...]
    """The selected views."""

    todo: tuple[Task, ...]
    """Those without stored results."""

    before: frozenset[tuple[str, str, str]]
    """Scene, view and time of the stored restorations by this method."""

    shown_over: Mapping[str, tuple[Task, ...]]
    """By scene, the views whose colours decide how all of it are shown, other shards' among them; none where each view
    is shown by itself."""

    by_scene: bool = False
    """Whether one worker restores all views of a scene: they are shown alike, or the method works on all at once."""

    shares_decoded: bool = False
    """Whether decoded files are stored for other restorations, which read the same views."""

    @property
    def labels(self) -> tuple[str, str]:
        """The labels of dataset and method."""
        return self.job.dataset.label, self.job.method.label

    @property
    def name(self) -> str:
        """The labels as messages have them."""
        return " / ".join(self.labels)


@opening_once()
def check(command: Command) -> list[Planned]:
    """Return what each job will do. Raises ProblemsError with everything that is wrong, a line each."""
    jobs, problems = command.jobs, list[str]()
    unasked = (
        "",
        "off",
        f"sqlite:///{jobs[0].out}/mlflow.db",
        os.environ.get("MLFLOW_TRACKING_URI"),
    )
    if jobs[0].tracking.uri not in unasked:  # the default: where mlflow is there
        require("tracking.uri", "mlflow")
    if len({job.out.resolve() for job in jobs}) > 1:
        problems.append("out: not the same for all jobs of the sweep; give one folder")
    study, known = jobs[0].study, {job.method.label for job in jobs}
    label = study.baseline if study else jobs[0].baseline
    # one that is a method, but not of this sweep, is left out
    if label and label not in known and not plugins.is_name("method", label):
        key = "baseline" if jobs[0].baseline else "study.baseline"
        known |= plugins.discover("method").keys()
        problems.append(f"{key}: no method is called '{label}'; {did_you_mean(label, known)}")
    rows = results.frame([])
    try:
        rows = _stored(jobs[0])
    except SucreBenchError as fault:
        problems.append(str(fault))
    planned: list[Planned] = []
    shared, of_job = (
        functools.cache(with_shared_pixels),
        dict(iter(rows.groupby(["dataset", "method"]))),
    )
    for job in jobs:
        try:
            for metric in job.metrics:
                _made(metric, job.out)
            method = _made(job.method, job.out)
            of_method = of_job.get((job.dataset.label, job.method.label), rows[:0])
            sees_whole_scene = bool(getattr(method, "sees_whole_scene", False))
            by_scene = sees_whole_scene or is_of_scene(job.method.display)
            planned.append(replace(_planned(job, of_method, shared), by_scene=by_scene))
        except SucreBenchError as fault:
            problems.append(str(fault))
    if not problems and not rows.empty:
        problems = _clashes(planned, rows)
    if problems:
        raise ProblemsError("\n".join(dict.fromkeys(problems)))
    return _sharing_decoded(planned)


def planned_again(before: Planned) -> Planned:
    """Return what a job will do now, without a check. Raises what opening its dataset raises."""
    job = before.job
    rows = _stored(job, dataset=job.dataset.label, method=job.method.label)
    now = _planned(job, rows, with_shared_pixels)
    return replace(now, by_scene=before.by_scene, shares_decoded=before.shares_decoded)


def _sharing_decoded(planned: Sequence[Planned]) -> list[Planned]:
    """Let jobs share decoded files where two restorations read the same view.

    They do by two methods, and by one that reads a target's neighbours.
    """
    read = Counter(
        (plan.job.dataset.label, task.base.scene, task.view.name)
        for plan in planned
        for task in plan.todo
    )
    reads_neighbours = any(
        "poses" in plan.job.method.plugin.needs and len(plan.todo) > 1 for plan in planned
    )
    reads_again = reads_neighbours or max(read.values(), default=0) > 1
    return [
        replace(plan, shares_decoded=plan.job.cache_gb > 0 and (plan.job.cache_keep or reads_again))
        for plan in planned
    ]


def _stored(job: Job, **labels: str) -> DataFrame:
    """The rows of a job's output folder; none if it has no table."""
    try:
        return results.read(job.out, **labels)
    except MissingFileError:
        return results.frame([])


def _planned(job: Job, rows: DataFrame, shared: Callable[[Scene], Scene]) -> Planned:
    """What a job will do. rows: all of its dataset and method; shared: makes the pixels of a scene shared."""
    scenes, of_scene = (
        [shared(scene) for scene in open_scenes(job.dataset)],
        dict[str, list[Task]](),
    )
    every = tuple(tasks(job, scenes))
    if is_of_scene(job.method.display):
        for task in tasks(replace(job, shard=Shard()), scenes):
            of_scene.setdefault(task.base.scene, []).append(task)
    over = {
        scene: tuple(of[k] for k in evenly(len(of), MOST_SHOWN_OVER))
        for scene, of in of_scene.items()
    }
    if rows.empty:
        return Planned(job, every, every, frozenset(), over)
    todo = every if job.overwrite == "always" else _without_results(job, every, rows, over)
    return Planned(
        job,
        every,
        todo,
        frozenset(values_of(restoration_rows(rows), "scene", "view", "time")),
        over,
    )


def names_hash(views: Iterable[str]) -> str:
    """Return a hash of the views whose colours a scene is shown by; their data, options and code are in the rows."""
    return hashlib.blake2b("\n".join(views).encode(), digest_size=6).hexdigest()


def _without_results(
    job: Job, every: Sequence[Task], rows: DataFrame, shown_over: Mapping[str, Sequence[Task]]
) -> tuple[Task, ...]:
    """The views that need work.

    Failed views and scores need it, unless the process died at them, because they would end the next process, too.
    """
    is_kept = rows["status"] != "failed"
    if job.overwrite != "failed":
        is_kept |= Reason.among(rows["reason"], Reason.DIED)
    kept: dict[
        tuple[str, str], dict[tuple[str, ...], str]
    ] = {}  # of each view, the status of its scores
    columns = ("options_id", "data_id", "metric", "variant", "code")
    for scene, view, status, *score in values_of(
        rows[is_kept], "scene", "view", "status", *columns
    ):
        kept.setdefault((scene, view), {})[tuple(score)] = status
    codes = [
        (metric, metric_code(metric)) for metric in job.metrics if not metric.plugin.is_of_pairs
    ]
    suffixes = [".png", *([".npz"] if job.save == "full" else [])]

    def stored_status(base: Row) -> str | None:
        identity = (base.options_id, base.data_id, base.metric, base.variant, base.code)
        return kept.get((base.scene, base.view), {}).get(identity)

    hashes = {  # a view that failed, and is tried again, may give colours this time
        scene: names_hash(
            task.view.name for task in of_scene if stored_status(task.base) in ("ok", None)
        )
        for scene, of_scene in shown_over.items()
    }

    def is_done(task: Task) -> bool:
        base, scores = task.base, kept.get((task.base.scene, task.base.view), {})
        if job.overwrite == "never":
            return bool(scores)
        if (status := stored_status(base)) != "ok":
            return status is not None
        wanted = (
            (base.options_id, base.data_id, metric.plugin.name, variant, score)
            for metric, code in codes
            for score in [score_code(base, code, charts_id(metric.plugin, [task.view]))]
            for variant in metric.variants
        )
        picture = task.place.restored(job.out, job.method.label)
        over = hashes.get(base.scene, "")
        return all(score in scores for score in wanted) and are_stored(picture, suffixes, over)

    return tuple(task for task in every if not is_done(task))


def _made(choice: Choice, out: Path) -> Any:
    """Make a plugin. Raises InputError if it refuses its options, named as the command takes them."""
    try:
        return choice.make(out)
    except SucreBenchError:
        raise
    except BaseException as fault:
        raise_if_stop(fault)
        raise InputError(one_line(fault), choice.plugin.name, "mend its options") from fault


def _clashes(planned: Sequence[Planned], rows: DataFrame) -> list[str]:
    """Labels that already stand for something else in the output folder: their results would be overwritten."""
    clashes = []
    known = rows[["dataset", "method", "scene", "options_id", "status"]].drop_duplicates()
    by_dataset = known.groupby("dataset")
    methods_of = by_dataset["method"].unique().to_dict()
    scenes_of = by_dataset["scene"].unique().to_dict()
    # what failed may be tried another way
    worked = known[known["status"] != "failed"]
    options_of = worked.groupby(["dataset", "method"])["options_id"].agg(set).to_dict()
    for plan in planned:
        job = plan.job
        dataset = job.dataset.label
        methods = methods_of.get(dataset, ())
        for choice, labels in ((job.dataset, methods_of), (job.method, methods)):
            folder = as_one_file(choice.label)
            for other in sorted(
                o for o in labels if choice.label not in labels and as_one_file(o) == folder
            ):
                clashes.append(
                    f"{job.out}: '{choice.label}' would share a folder with '{other}'; "
                    f"give another {choice.label_option}"
                )
        if job.overwrite == "always":
            continue
        scenes = {results.unreplicated(scene)[0] for scene in scenes_of.get(dataset, ()) if scene}
        if scenes and plan.tasks and not scenes & {task.scene.name for task in plan.tasks}:
            clashes.append(
                f"{job.out}: its '{dataset}' is scene {sorted(scenes)[0]}, not {plan.tasks[0].scene.name}; "
                f"give another out=... or {job.dataset.label_option}"
            )
        options_ids = options_of.get(plan.labels)
        if options_ids and options_ids != {results.fingerprint(job.method.record)[1]}:
            clashes.append(
                f"{job.out}: its '{job.method.label}' has other options; "
                f"give another {job.method.label_option}, or overwrite=always"
            )
    return clashes
