"""The views that a command's words choose, dataset=, views=, every=, first=, as `sucre-bench run` reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sucre_bench.job import Choice
from sucre_bench.scene import Scene, View

__all__ = ["Selection", "select"]


@dataclass(frozen=True)
class Selection:
    """A scene of a dataset, and those of its views that were chosen."""

    dataset: Choice
    scene: Scene
    views: tuple[View, ...]


def select(overrides: Sequence[str]) -> list[Selection]:
    """Return every scene of which views are chosen, in the dataset's order; pixels stay unread.

    Raises InputError as `config.jobs` does, for data that are not as expected, and for a name that no view has.
    """
    from sucre_bench import config
    from sucre_bench.run import open_scenes, tasks

    job = config.jobs(overrides, False).jobs[0]
    chosen: dict[str, tuple[Scene, list[View]]] = {}
    for task in tasks(job, open_scenes(job.dataset)):
        chosen.setdefault(task.scene.name, (task.scene, []))[1].append(task.view)
    return [Selection(job.dataset, scene, tuple(views)) for scene, views in chosen.values()]
