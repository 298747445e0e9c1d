"""Selects the views of a command, from the words dataset=, views=, every= and first=."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from pathlib import Path

from sucre_bench import results
from sucre_bench.degrade import Degradation, around, degraded_whole
from sucre_bench.errors import (
    InputError,
    PluginError,
    SucreBenchError,
    did_you_mean,
    file_error,
    one_line,
    raise_if_stop,
)
from sucre_bench.jobs.job import Job
from sucre_bench.machine.files import is_want_of_room, not_writable
from sucre_bench.plugins.code_hash import source_hash
from sucre_bench.plugins.options import Choice
from sucre_bench.results.layout import Place, places
from sucre_bench.results.rows import Row
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
    return [Selection(job.dataset, job.degrade, scene, tuple(views)) for scene, views in chosen.values()]


@dataclass(frozen=True)
class Task:
    """A view to restore: where its results are kept, and what every row of it says."""

    scene: Scene
    view: View
    place: Place
    base: Row


_opened: ContextVar[dict[str, list[Scene] | SucreBenchError] | None] = ContextVar("opened", default=None)


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
        raise InputError(f"{reason}; if a library is missing, `sucre-bench doctor` says which") from fault
    except BaseException as fault:
        raise_if_stop(fault)
        reason = f"{one_line(fault)}; mend the plugin"
        raise PluginError(f"dataset '{dataset.label}': {reason}") from fault
    for scene in scenes:
        if not isinstance(scene, Scene):
            raise PluginError(
                f"dataset '{dataset.label}': yields {type(scene).__name__}; scenes() yields Scene objects"
            )
        name, times = Counter(view.name for view in scene.views).most_common(1)[0] if scene.views else ("", 0)
        if times > 1:
            raise PluginError(f"dataset '{dataset.label}': {times} views are called '{name}'; names must be unique")
    name, times = Counter(scene.name for scene in scenes).most_common(1)[0] if scenes else ("", 0)
    if times > 1:
        raise InputError(f"dataset '{dataset.label}': {times} scenes are called '{name}'; rename a folder")
    if not any(len(scene) for scene in scenes):
        raise InputError(f"dataset '{dataset.label}': no views; check its options")
    return scenes


def tasks(job: Job, scenes: Sequence[Scene]) -> Iterator[Task]:
    """Yield the views a job is to restore, degraded, in the dataset's order.

    Raises InputError for a name that no scene has, and for a scene that lacks what is to be degraded.
    """
    base, kept, drawn = base_row(job), places(job.dataset.label, scenes, job.replicate), job.drawn
    data_ids = {scene.name: drawn.data_id(scene.data_id) for scene in scenes}
    is_degraded = bool(drawn.identity())
    whole = [degraded_whole(scene, drawn) for scene in scenes] if is_degraded else scenes
    every = [(scene, view) for scene in whole for view in scene.views]
    if job.views is not None:
        names = {view.name for _, view in every}
        if unknown := [name for name in job.views if name not in names]:
            hint = did_you_mean(unknown[0], names) if len(names) < 20 else f"there are {len(names)} others"
            raise InputError(f"no view is called '{unknown[0]}'", "views", hint)
        chosen = set(job.views)
        every = [(scene, view) for scene, view in every if view.name in chosen]
    for scene, view in job.shard.of(every[:: job.every][: job.first]):
        row = replace(
            base, scene=results.replicated(scene.name, job.replicate), view=view.name, data_id=data_ids[scene.name]
        )
        neighbours = around(scene, view, drawn) if is_degraded else scene
        yield Task(neighbours, view, kept[scene.name, view.name], row)


def base_row(job: Job) -> Row:
    """What every row of a job says."""
    about = {
        "dataset": job.dataset.record,
        **({"degrade": given} if (given := job.degrade.record) else {}),
        **({"replicate": job.replicate} if job.replicate else {}),
    }
    return Row(
        dataset=job.dataset.label,
        method=job.method.label,
        options=results.fingerprint({**job.method.record, **about})[0],
        options_id=results.fingerprint(job.method.record)[1],
        seed=job.seed if job.method.seed is None else job.method.seed,
        code=source_hash(job.dataset.plugin, job.method.plugin, *job.method.methods, files=job.method.files),
    )
