"""The check before the work: opens the data, selects the views of a command, and compares them with stored results."""

from __future__ import annotations

import functools
import json
import os
from collections import Counter, defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, fields, replace
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
from sucre_bench.plugins.options import Choice, source_hash
from sucre_bench.results.layout import Place, as_one_file, places
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import are_stored
from sucre_bench.results.rows import Row, values_of
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


_opened = ContextVar[dict[str, list[Scene]]]("opened")


@contextmanager
def opening_once() -> Iterator[None]:
    """In this block, open each dataset once, for all jobs of this process."""
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
        opened[key] = _open(dataset)
    return opened[key]


def _open(dataset: Choice) -> list[Scene]:
    where = f"dataset '{dataset.label}'"
    try:
        made = dataset.make()
        scenes = list(made.scenes())
    except SucreBenchError:
        raise
    except OSError as fault:
        file = where if fault.filename is None else os.fsdecode(fault.filename)
        if is_want_of_room(fault):
            raise not_writable(Path(file), fault) from fault
        remedy = "let this user read it, or give another path"
        raise file_error(file, fault, remedy) from fault
    except ImportError as fault:
        remedy = "if a library is missing, `sucre-bench doctor` says which"
        raise InputError(one_line(fault), where, remedy) from fault
    except BaseException as fault:
        raise_if_stop(fault)
        raise PluginError(one_line(fault), where, "mend the plugin") from fault
    for scene in scenes:
        if not isinstance(scene, Scene):
            fault_of_type = f"yields {type(scene).__name__}"
            raise PluginError(fault_of_type, where, "scenes() yields Scene objects")
        for name in (scene.name, *(view.name for view in scene.views)):
            if not PurePosixPath(name).name:
                raise PluginError(
                    f"a scene or view is called '{name}'", where, "give it a name"
                )
    for name, times in Counter(scene.name for scene in scenes).most_common(1):
        if times > 1:
            raise InputError(f"{times} scenes are called '{name}'", where, "rename a folder")
    if not any(map(len, scenes)):
        raise InputError("no views", where, "check its options")
    # not `vars`: a class may have slots
    options = [getattr(made, field.name) for field in fields(made)]
    _say_passed_over(dataset, options, scenes)
    return scenes


def _say_passed_over(dataset: Choice, options: Iterable[Any], scenes: Sequence[Scene]) -> None:
    """Say what lies unread in the folders that the dataset's options name, and beside what its views read."""
    read = {file for scene in scenes for view in scene.views for file in source_files(view)}
    folder = dataset.options.get("root")
    if not read or not folder:
        return
    root = expanded(folder)
    named = [root / expanded(one) for one in options if isinstance(one, str | Path) and one]
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
            hint = f"there are {len(names)} others"
            if len(names) < 20:
                hint = did_you_mean(unknown[0], names)
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
    baseline = study.baseline if study else jobs[0].baseline
    known = {job.method.label for job in jobs}
    # one that is a method, but not of this sweep, is left out
    if (
        baseline
        and baseline not in known
        and baseline not in plugins.discover("method", baseline)
    ):
        hint = did_you_mean(baseline, known | plugins.discover("method").keys())
        problems.append(f"baseline: no method is called '{baseline}'; {hint}")
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
            plan = _planned(job, of_method, shared)
            if getattr(method, "sees_whole_scene", False):
                plan = replace(plan, by_scene=True)
            planned.append(plan)
        except SucreBenchError as fault:
            problems.append(str(fault))
    if not problems and not rows.empty:
        problems = [*_clashes(planned, rows)]
    if problems:
        raise ProblemsError("\n".join(dict.fromkeys(problems)))
    n_jobs = Counter(plan.labels[0] for plan in planned if plan.todo)
    return [
        replace(plan, shares_decoded=_shares_decoded(plan, n_jobs[plan.labels[0]]))
        for plan in planned
    ]


def planned_again(before: Planned) -> Planned:
    """Return what a job will do now, without a check. Raises what opening its dataset raises."""
    job = before.job
    rows = stored_rows(job, dataset=job.dataset.label, method=job.method.label)
    now = _planned(job, rows, with_shared_pixels)
    return replace(now, by_scene=before.by_scene, shares_decoded=before.shares_decoded)


def _shares_decoded(plan: Planned, n_jobs: int) -> bool:
    """Whether a job stores decoded files, because another restoration reads them. n_jobs: on its dataset."""
    reads_neighbours = "poses" in plan.job.method.plugin.needs and len(plan.todo) > 1
    is_read_again = plan.job.cache_keep or reads_neighbours or n_jobs > 1
    return plan.job.cache_gb > 0 and is_read_again


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
    return Planned(job, every, todo, over, by_scene=is_of_scene(job.method.display))


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


def _clashes(planned: Sequence[Planned], rows: DataFrame) -> Iterator[str]:
    """Yield the labels that stand for something else in the output folder: their results would be overwritten.

    What failed may be tried another way.
    """
    about = ["dataset", "method", "scene", "data_id", "options", "options_id"]
    worked = rows.loc[rows["status"] != "failed", about].drop_duplicates()
    for plan in planned:
        job = plan.job
        of_dataset = worked[worked["dataset"] == job.dataset.label]
        yield from _shared_folders(job.out, job.dataset, worked["dataset"].unique())
        yield from _shared_folders(job.out, job.method, of_dataset["method"].unique())
        if job.overwrite == "always":
            continue
        if len(of_dataset) and plan.tasks and _is_of_other_data(plan, of_dataset):
            yield (
                f"{job.out}: its '{job.dataset.label}' has other options and data; "
                f"give another out=... or {job.dataset.label_option}, or overwrite=always"
            )
        of_method = of_dataset[of_dataset["method"] == job.method.label]
        if (of_method["options_id"] != base_row(job).options_id).any():
            yield (
                f"{job.out}: its '{job.method.label}' has other options; "
                f"give another {job.method.label_option}, or overwrite=always"
            )


def _shared_folders(out: Path, choice: Choice, labels: Iterable[str]) -> Iterator[str]:
    """Yield the stored labels whose folder another label would write into."""
    for label in labels:
        if label != choice.label and as_one_file(label) == as_one_file(choice.label):
            remedy = f"give another {choice.label_option}"
            yield f"{out}: '{choice.label}' would share a folder with '{label}'; {remedy}"


def _is_of_other_data(plan: Planned, stored: DataFrame) -> bool:
    """Whether a job's dataset has other options and other data than the rows with its label.

    Other data with the same options are files that changed, which are restored again.
    """
    own = results.fingerprint(plan.job.dataset.record)[0]
    for text in stored["options"].unique():
        of_dataset = json.loads(text).get("dataset", {})
        if results.fingerprint(of_dataset)[0] == own:
            return False
    known = set(values_of(stored, "scene", "data_id"))
    scenes = {scene for scene, _ in known}
    data = {(task.base.scene, task.base.data_id) for task in plan.tasks}
    of_known_scenes = {one for one in data if one[0] in scenes}
    return not of_known_scenes or not of_known_scenes <= known
