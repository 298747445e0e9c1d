"""Says before any work what the selected views of a scene can show: whether they have its water, and are neighbours."""

import contextlib
from collections.abc import Sequence
from functools import partial

from sucre_bench.engine.preflight import Planned
from sucre_bench.errors import ANY_FAULT
from sucre_bench.machine import processes, progress
from sucre_bench.programs.describe.facts import spread_of
from sucre_bench.scene import Scene

_MOST = 3  # scenes


def say_whether_measurable(planned: Sequence[Planned]) -> None:
    """Say it of the scenes that methods of several views are to restore.

    Depth maps are decoded in a process of its own: workers are forked from one without threads.
    """
    measuring = (plan for plan in planned if {"poses", "depth"} <= plan.job.method.plugin.needs)
    scenes = {(plan.job.dataset.label, task.scene.name): task.scene for plan in measuring for task in plan.todo}
    for (dataset, name), scene in list(scenes.items())[:_MOST]:
        with contextlib.suppress(*ANY_FAULT):  # the run says what is wrong with the data
            if spread := processes.call(partial(spread_of, scene.views), "leave out the view that ends it"):
                progress.say(f"{dataset}, {name}: {spread.sentence('')}")


def say_what_views_show(planned: Sequence[Planned]) -> None:
    """Say whether the water can be measured, and of which scenes only neighbours are selected, half of it at most."""
    say_whether_measurable(planned)
    chosen = [plan for plan in planned if plan.job.first or plan.job.views]  # a shard has neighbours on purpose
    scenes: dict[tuple[str, str], tuple[Scene, set[str]]] = {}
    for dataset, task in ((plan.job.dataset.label, task) for plan in chosen for task in plan.tasks):
        scenes.setdefault((dataset, task.scene.name), (task.scene, set()))[1].add(task.view.name)
    for (dataset, name), (scene, selected) in [*scenes.items()][:_MOST]:
        places = [place for place, view in enumerate(scene.views) if view.name in selected]
        n, total = len(places), len(scene.views)
        if "poses" in scene.has and 1 < n <= total // 2 and places[-1] - places[0] == n - 1:
            fewer = f"these {n} of {total} views are neighbours, and show little of the scene"
            progress.say(f"{dataset}, {name}: {fewer}; every={total // n} shows more")
