"""The check before the work: opens the data, selects the views of a command, and compares them with stored results."""

from __future__ import annotations

import functools
import json
import os
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from operator import attrgetter
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
from sucre_bench.machine.text_formats import short_hash
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
    return [
        Selection(
            job.dataset, job.degrade, of_scene[0].scene, tuple(task.view for task in of_scene)
        )
        for of_scene in tasks_by_scene(job, open_scenes(job.dataset)).values()
    ]


@dataclass(frozen=True)
class Task:
    """A view to restore: where its results are kept, and what every row of it says."""

    scene: Scene
    view: View
    place: Place
    base: Row


_opened = ContextVar[dict[str, list[Scene] | SucreBenchError]]("opened")


@contextmanager
def opening_once() -> Iterator[None]:
    """In this block, open each dataset once, for all jobs of this process, also if that fails."""
    token = _opened.set(_opened.get({}))
    try:
        yield
    finally:
        _opened.reset(token)


def open_scenes(dataset: Choice) -> list[Scene]:
    """Open every scene of a dataset; pixels stay unread. InputError or PluginError when it cannot be opened."""
    opened = _opened.get({})
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
    where = f"dataset '{dataset.label}'"
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
        remedy = "if a library is missing, `sucre-bench doctor` says which"
        raise InputError(one_line(fault), where, remedy) from fault
    except BaseException as fault:
        raise_if_stop(fault)
        raise PluginError(one_line(fault), where, "mend the plugin") from fault
    for scene in scenes:
        if not isinstance(scene, Scene):
            fault_of_type = f"yields {type(scene).__name__}"
            raise PluginError(fault_of_type, where, "scenes() yields Scene objects")
        for kind, name in (
            ("scene", scene.name),
            *(("view", view.name) for view in scene.views),
        ):
            if not PurePosixPath(name).name:
                raise PluginError(f"a {kind} is called '{name}'", where, "give it a name")
    for name, times in Counter(scene.name for scene in scenes).most_common(1):
        if times > 1:
            raise InputError(f"{times} scenes are called '{name}'", where, "rename a folder")
    if not any(map(len, scenes)):
        raise InputError("no views", where, "check its options")
    _say_passed_over(dataset, scenes)
    return scenes


def _say_passed_over(dataset: Choice, scenes: Sequence[Scene]) -> None:
    """Say what lies unread in the folders that the dataset's options name, and beside what its views read."""
    read = {file for scene in scenes for view in scene.views for file in source_files(view)}
    folder = dataset.options.get("root")
    if not read or not folder:
        return
    root = expanded(folder)
    default = {option.name: option.default for option in options_of(dataset.plugin.cls)}
    values = {**default, **dataset.options}.values()
    named = [
        root / expanded(value) for value in values if isinstance(value, str | Path) and value
    ]
    folders = {*(path for path in named if path.is_dir()), *(file.parent for file in read)}
    read |= {path for sign in dataset.plugin.signs for path in root.glob(sign)}
    say_passed_over(root, sorted(folders), read, beside=not dataset.plugin.licence)


def tasks(job: Job, scenes: Sequence[Scene]) -> Iterator[Task]:
    """Yield the views a job is to restore, degraded, in the dataset's order.

    Raises InputError for a name that no scene has, and for a scene that lacks what is to be degraded.
    """
    base = base_row(job)
    kept = places(job.dataset.label, scenes, job.replicate)
    drawn = job.drawn
    every = list[tuple[Scene, View, Row]]()
    for scene in scenes:
        # A method that looks at charts may look at those of all views.
        code = f"{base.code}{charts_id(job.method.plugin, scene.views)}"
        name = results.replicated(scene.name, job.replicate)
        row = replace(base, scene=name, data_id=drawn.data_id(scene.data_id), code=code)
        whole = degraded_whole(scene, drawn)
        every += [(whole, view, row) for view in whole.views]
    if job.views is not None:
        names = {view.name for _, view, _ in every}
        if unknown := [name for name in job.views if name not in names]:
            hint = (
                did_you_mean(unknown[0], names)
                if len(names) < 20
                else f"there are {len(names)} others"
            )
            raise InputError(f"no view is called '{unknown[0]}'", "views", hint)
        chosen = set(job.views)
        every = [one for one in every if one[1].name in chosen]
    for scene, view, row in job.shard.of(every[:: job.every][: job.first]):
        place = kept[scene.name, view.name]
        yield Task(around(scene, view, drawn), view, place, replace(row, view=view.name))


def tasks_by_scene(job: Job, scenes: Sequence[Scene]) -> dict[str, list[Task]]:
    """Return what `tasks` yields by the scene's name in rows."""
    by_scene = defaultdict[str, list[Task]](list)
    for task in tasks(job, scenes):
        by_scene[task.base.scene].append(task)
    return by_scene


def base_row(job: Job) -> Row:
    """What every row of a job says."""
    about = {"degrade": job.degrade.record, "replicate": job.replicate}
    given = {name: value for name, value in about.items() if value}
    options = {**job.method.record, "dataset": job.dataset.record, **given}
    methods, files = job.method.rests_on
    return Row(
        dataset=job.dataset.label,
        method=job.method.label,
        options=results.fingerprint(options)[0],
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
    jobs = command.jobs
    problems = list[str]()
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
    study = jobs[0].study
    known = {job.method.label for job in jobs}
    label = study.baseline if study else jobs[0].baseline
    # one that is a method, but not of this sweep, is left out
    if label and label not in known and not plugins.is_name("method", label):
        key = "baseline" if jobs[0].baseline else "study.baseline"
        known |= plugins.discover("method").keys()
        problems.append(f"{key}: no method is called '{label}'; {did_you_mean(label, known)}")
    rows = results.frame([])
    try:
        rows = stored_rows(jobs[0])
    except SucreBenchError as fault:
        problems.append(str(fault))
    planned: list[Planned] = []
    shared = functools.cache(with_shared_pixels)
    of_job = dict(iter(rows.groupby(["dataset", "method"])))
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
    rows = stored_rows(job, dataset=job.dataset.label, method=job.method.label)
    now = _planned(job, rows, with_shared_pixels)
    return replace(now, by_scene=before.by_scene, shares_decoded=before.shares_decoded)


def _sharing_decoded(planned: Sequence[Planned]) -> list[Planned]:
    """Let jobs share decoded files where two restorations read the same view.

    They do by two methods, and by one that reads a target's neighbours.
    """
    read = [
        (plan.job.dataset.label, task.base.scene, task.view.name)
        for plan in planned
        for task in plan.todo
    ]
    reads_neighbours = any(
        "poses" in plan.job.method.plugin.needs and len(plan.todo) > 1 for plan in planned
    )
    reads_again = reads_neighbours or len(set(read)) < len(read)
    return [
        replace(
            plan, shares_decoded=plan.job.cache_gb > 0 and (plan.job.cache_keep or reads_again)
        )
        for plan in planned
    ]


def stored_rows(job: Job, **labels: str) -> DataFrame:
    """Return the rows of a job's output folder; none if it has no table. labels: see `results.read`."""
    try:
        return results.read(job.out, **labels)
    except MissingFileError:
        return results.frame([])


def _planned(job: Job, rows: DataFrame, shared: Callable[[Scene], Scene]) -> Planned:
    """What a job will do. rows: all of its dataset and method; shared: makes the pixels of a scene shared."""
    scenes = [shared(scene) for scene in open_scenes(job.dataset)]
    every = tuple(tasks(job, scenes))
    over: dict[str, tuple[Task, ...]] = {}
    if is_of_scene(job.method.display):
        for scene, of_scene in tasks_by_scene(replace(job, shard=Shard()), scenes).items():
            over[scene] = tuple(of_scene[k] for k in evenly(len(of_scene), MOST_SHOWN_OVER))
    todo = every if job.overwrite == "always" else _without_results(job, every, rows, over)
    before = frozenset(values_of(restoration_rows(rows), "scene", "view", "time"))
    return Planned(job, every, todo, before, over)


def names_hash(views: Iterable[str]) -> str:
    """Return a hash of the views whose colours a scene is shown by; their data, options and code are in the rows."""
    return short_hash("\n".join(views))


def _without_results(
    job: Job, every: Sequence[Task], rows: DataFrame, shown_over: Mapping[str, Sequence[Task]]
) -> tuple[Task, ...]:
    """The views that need work.

    Failed views and scores need it, unless the process died at them, because they would end the next process, too.
    """
    is_kept = rows["status"] != "failed"
    if job.overwrite != "failed":
        is_kept |= Reason.among(rows["reason"], Reason.DIED)
    data_of = attrgetter("scene", "view", "options_id", "data_id")
    columns = ("scene", "view", "options_id", "data_id", "metric", "variant", "code", "status")
    # the status of each score
    kept = {values[:-1]: values[-1] for values in values_of(rows[is_kept], *columns)}
    views = {score[:2] for score in kept}
    codes = [
        (metric, metric_code(metric)) for metric in job.metrics if not metric.plugin.is_of_pairs
    ]
    suffixes = [".png", ".npz"] if job.save == "full" else [".png"]

    def stored_status(base: Row) -> str | None:
        return kept.get((*data_of(base), base.metric, base.variant, base.code))

    hashes = {  # a view that failed, and is tried again, may give colours this time
        scene: names_hash(
            task.view.name for task in of_scene if stored_status(task.base) in ("ok", None)
        )
        for scene, of_scene in shown_over.items()
    }

    def is_done(task: Task) -> bool:
        base = task.base
        if job.overwrite == "never":
            return (base.scene, base.view) in views
        if (status := stored_status(base)) != "ok":
            return status is not None
        data = data_of(base)
        for metric, code in codes:
            score = score_code(base, code, charts_id(metric.plugin, [task.view]))
            if any(
                (*data, metric.plugin.name, variant, score) not in kept
                for variant in metric.variants
            ):
                return False
        picture = task.place.restored(job.out, job.method.label)
        return are_stored(picture, suffixes, hashes.get(base.scene, ""))

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


_DataOf = Mapping[tuple[str, str], Mapping[str, str]]


def _data_of(rows: DataFrame) -> _DataOf:
    """Return the dataset's options by data_id, by its label and scene, of rows that did not fail."""
    data_of = defaultdict[tuple[str, str], dict[str, str]](dict)
    about = ("dataset", "scene", "data_id", "options")
    worked = rows[rows["status"] != "failed"].drop_duplicates(list(about))
    for dataset, scene, data_id, options in values_of(worked, *about):
        of_dataset = json.loads(options or "{}").get("dataset", {})
        data_of[dataset, scene][data_id] = results.fingerprint(of_dataset)[0]
    return data_of


def _replaces_other_data(plan: Planned, data_of: _DataOf) -> bool:
    """Whether a job's dataset has other options and other data than the stored rows with its label.

    data_of: see `_data_of`. Other data with the same options are files that changed, which are restored again.
    """
    dataset = plan.job.dataset
    own = results.fingerprint(dataset.record)[0]
    for scene, data_id in {(task.base.scene, task.base.data_id) for task in plan.tasks}:
        stored = data_of.get((dataset.label, scene), {})
        is_known = data_id in stored or own in stored.values()
        if stored and not is_known:
            return True
    return False


def _clashes(planned: Sequence[Planned], rows: DataFrame) -> list[str]:
    """Labels that already stand for something else in the output folder: their results would be overwritten."""
    clashes = list[str]()
    known = rows[["dataset", "method", "scene", "options_id", "status"]].drop_duplicates()
    by_dataset = known.groupby("dataset")
    methods_of = by_dataset["method"].unique().to_dict()
    scenes_of = by_dataset["scene"].unique().to_dict()
    # what failed may be tried another way
    worked = known[known["status"] != "failed"]
    options_of = worked.groupby(["dataset", "method"])["options_id"].agg(set).to_dict()
    data_of = _data_of(rows)
    for plan in planned:
        job = plan.job
        dataset = job.dataset.label
        methods = methods_of.get(dataset, ())
        for choice, labels in ((job.dataset, methods_of), (job.method, methods)):
            folder = as_one_file(choice.label)
            if choice.label not in labels:
                clashes += [
                    f"{job.out}: '{choice.label}' would share a folder with '{other}'; "
                    f"give another {choice.label_option}"
                    for other in sorted(labels)
                    if as_one_file(other) == folder
                ]
        if job.overwrite == "always":
            continue
        scenes = {
            results.unreplicated(scene)[0] for scene in scenes_of.get(dataset, ()) if scene
        }
        if scenes and plan.tasks and not scenes & {task.scene.name for task in plan.tasks}:
            clashes.append(
                f"{job.out}: its '{dataset}' is scene {sorted(scenes)[0]}, not {plan.tasks[0].scene.name}; "
                f"give another out=... or {job.dataset.label_option}"
            )
        if _replaces_other_data(plan, data_of):
            clashes.append(
                f"{job.out}: its '{dataset}' has other options and data; "
                f"give another out=... or {job.dataset.label_option}, or overwrite=always"
            )
        options_id = results.fingerprint(job.method.record)[1]
        if options_of.get(plan.labels, {options_id}) != {options_id}:
            clashes.append(
                f"{job.out}: its '{job.method.label}' has other options; "
                f"give another {job.method.label_option}, or overwrite=always"
            )
    return clashes
