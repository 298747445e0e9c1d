"""The store of decoded images and depth maps that the jobs of a command share while it runs."""

import shutil
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress

from sucre_bench.engine.preflight import Planned
from sucre_bench.jobs.job import Job
from sucre_bench.machine.cache import ArrayStore, storing
from sucre_bench.results.layout import decoded_path


def share_decoded(planned: Sequence[Planned]) -> None:
    """Make the folder that tells jobs to share, where anything would be decoded twice. No disk for it is no fault."""
    first = planned[0].job
    if first.cache_gb > 0 and _decodes_again(planned):
        with suppress(OSError):
            decoded_path(first.out).mkdir(parents=True, exist_ok=True)


def remove_decoded(job: Job) -> None:
    """Remove what the jobs of a command shared, and what a killed one left, unless it is to be kept.

    Another command that works in the same results folder makes again what it needs.
    """
    if not job.cache_keep:
        shutil.rmtree(decoded_path(job.out), ignore_errors=True)


def sharing_decoded(job: Job) -> AbstractContextManager[None]:
    """In this block, share what is decoded, if the job's command made the folder for it."""
    folder = decoded_path(job.out)
    return storing(ArrayStore(folder, job.cache_gb * 2**30)) if folder.is_dir() and job.cache_gb else nullcontext()


def _decodes_again(planned: Sequence[Planned]) -> bool:
    """Whether two restorations read the same view: by two methods, or by one that reads a target's neighbours."""
    if any(plan.job.cache_keep for plan in planned):
        return True
    read = Counter((plan.job.dataset.label, task.base.scene, task.view.name) for plan in planned for task in plan.tasks)
    reads_neighbours = any("poses" in plan.job.method.plugin.needs and len(plan.tasks) > 1 for plan in planned)
    return reads_neighbours or max(read.values(), default=0) > 1
