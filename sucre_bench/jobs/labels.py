"""Labels of configurations: those that a sweep makes, and the clash of two jobs with one label."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.layout import file_name

if TYPE_CHECKING:
    from sucre_bench.jobs.job import Job

__all__ = ["plain_value", "refuse_same_place", "swept_label"]


def swept_label(plugin: Plugin, values: Mapping[str, Any], swept: Sequence[str]) -> str:
    """Return the plugin's name with its swept options: "sucre,pairing=depth". A path counts by its last part."""
    named = [name for name in values if f"{plugin.kind}.{name}" in swept or (name == "seed" and "seed" in swept)]
    shown = ((name, values[name]) for name in named)
    parts = [f"{name}={value.name if isinstance(value, Path) else plain_value(value)}" for name, value in shown]
    return ",".join([plugin.name, *parts]).replace(" ", "")


def plain_value(value: Any) -> Any:
    """Return an option's value as rows and labels have it: paths as text, tuples as lists."""
    if isinstance(value, Path):
        return str(value)
    return list(value) if isinstance(value, tuple) else value


def refuse_same_place(planned: Sequence[Job]) -> None:
    """Raise InputError if two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault((file_name(job.dataset.label), file_name(job.method.label), *part), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=...")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")
