"""Says before any work whether the water of a scene can be measured, and what to use."""

import contextlib
from collections.abc import Sequence
from functools import partial

from sucre_bench.engine.preflight import Planned
from sucre_bench.errors import ANY_FAULT
from sucre_bench.machine import processes, progress
from sucre_bench.programs.describe.facts import spread_of

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
