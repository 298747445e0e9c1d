"""The views that a command's words choose, dataset=, views=, every=, first=, as `sucre-bench run` reads them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from sucre_bench.degrade import Degradation
from sucre_bench.job import Choice
from sucre_bench.scene import Scene, View

__all__ = ["Selection", "quoted", "select"]


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
    Raises InputError as `config.jobs` does, for data that are not as expected, and for a name that no view has.
    """
    from sucre_bench import config
    from sucre_bench.tasks import open_scenes, tasks

    job = config.jobs(overrides, False).jobs[0]
    job = replace(job, degrade=replace(job.degrade, within=None, keep=None))
    chosen: dict[str, tuple[Scene, list[View]]] = {}
    for task in tasks(job, open_scenes(job.dataset)):
        chosen.setdefault(task.scene.name, (task.scene, []))[1].append(task.view)
    return [Selection(job.dataset, job.degrade, scene, tuple(views)) for scene, views in chosen.values()]


def quoted(text: str) -> str:
    """Return any text as the value of an override: as it is where Hydra takes it for itself, else in quotes."""
    if re.fullmatch(r"[A-Za-z_./][\w./-]*", text):
        return text
    escaped = text.replace("\\", "\\\\").replace("'", "\\'")
    return f"'{escaped}'"
