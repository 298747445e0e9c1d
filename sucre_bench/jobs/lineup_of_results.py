"""The line-up of a results folder, `lineup.yaml`: each run adds its datasets, configurations and metrics to it."""

import itertools
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError
from sucre_bench.jobs.catalogue import moved_paths
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import Entry, Kind, LineUp, line_up_in
from sucre_bench.jobs.run_options import Study
from sucre_bench.jobs.words import given, undegraded_label
from sucre_bench.machine.files import write_atomically
from sucre_bench.plugins.options import Choice

# Settings of a command that a line-up has where they are not as by default.
_SETTINGS: dict[str, Any] = {"views": None, "every": 1, "first": None, "seed": 0, "save": "display", "baseline": ""}


def line_up_path(out: Path) -> Path:
    """The file in a results folder."""
    return out / "lineup.yaml"


def record_line_up(jobs: Sequence[Job]) -> None:
    """Add the jobs of a command to the line-up of their results folder. Raises OutputError if it cannot be written.

    Settings such as views and study are those of the last command. A file that is no line-up is replaced.
    """
    first, out = jobs[0], jobs[0].out
    try:
        older = line_up_in(line_up_path(out))
    except InputError:
        older = LineUp()
    datasets = {_full_label(entry): entry for entry in older.datasets}
    methods = {entry.label or entry.name: entry for entry in older.methods}
    metrics: dict[str, list[Entry]] = {}
    for job in jobs:
        label = undegraded_label(job.dataset.label, job.degrade.record, job.dataset.plugin.name)
        degrade = {"degrade": job.degrade.record} if job.degrade.record else {}
        datasets[job.dataset.label] = _entry("dataset", job.dataset, label, job, degrade)
        methods[job.method.label] = _entry("method", job.method, job.method.label, job)
        metrics |= {metric.plugin.name: list(_metric(metric)) for metric in job.metrics}
    replicates = {job.replicate for job in jobs}
    replicates |= set(older.sweep.get("replicate", [0] if older.methods else []))
    settings = {name: getattr(first, name) for name, default in _SETTINGS.items() if getattr(first, name) != default}
    settings |= {"views": list(first.views)} if first.views is not None else {}
    settings |= {"plugins": [_relative(file, out) for file in first.plugin_files]} if first.plugin_files else {}
    if first.study:
        values = {name: list(v) if isinstance(v, tuple) else v for name, v in vars(first.study).items()}
        settings["study"] = {name: value for name, value in values.items() if value != Study.defaults()[name]}
    line_up = LineUp(
        _labelled(datasets),
        _labelled(methods),
        (*itertools.chain(*metrics.values()), *(e for e in older.metrics if e.name.partition(":")[0] not in metrics)),
        {"replicate": sorted(replicates)} if replicates != {0} else {},
        settings,
    )
    text = line_up.as_yaml(f"The line-up that made {out}. To run it: sucre-bench run {line_up_path(out).name}")
    write_atomically(line_up_path(out), text.encode())


def _entry(kind: Kind, choice: Choice, label: str, job: Job, more: Mapping[str, Any] | None = None) -> Entry:
    """A dataset or configuration with its label and what is not as by default, its paths as seen from the folder."""
    options = {"label": label, **given(kind, choice.record, job.seed), **(more or {})}
    entry = Entry(choice.plugin.name, options)
    return _with_paths(kind, entry, lambda path: _relative(path, job.out))


def _full_label(entry: Entry) -> str:
    """The label of a dataset's rows."""
    return Degradation.of(entry.options.get("degrade") or {}).labelled(entry.label or entry.name)


def _labelled(entries: Mapping[str, Entry]) -> tuple[Entry, ...]:
    """The entries, each with a label unless it has the same without: several of one name would name their options."""
    names = Counter(entry.name for entry in entries.values())
    every = []
    for entry in entries.values():
        options = {"label": entry.label or entry.name, **entry.options}
        if options["label"] == entry.name and names[entry.name] == 1:
            del options["label"]
        every.append(replace(entry, options=options))
    return tuple(every)


def _metric(choice: Choice) -> Iterator[Entry]:
    name, variants = choice.plugin.name, choice.variants
    options = given("metric", choice.record)
    if variants == choice.plugin.default or options:
        yield Entry(name, {**({} if variants == choice.plugin.default else {"variants": list(variants)}), **options})
    elif variants == tuple(choice.plugin.variants):
        yield Entry(f"{name}:all")
    else:
        yield from (Entry(f"{name}:{variant}") for variant in variants)


def _with_paths(kind: Kind, entry: Entry, seen: Callable[[str], str]) -> Entry:
    """The entry with each path as it is seen from another folder."""
    options = {**entry.options}
    options |= moved_paths(kind, entry.name, options, seen)
    if isinstance(options.get("degrade", {}).get("add_water"), str):
        options["degrade"] = {**options["degrade"], "add_water": seen(options["degrade"]["add_water"])}
    return replace(entry, options=options)


def _relative(path: str, folder: Path) -> str:
    """A path as seen from a folder; absolute where it is absolute and leads out of the folder where we are."""
    is_here = Path(path).is_relative_to(Path.cwd())
    return os.path.relpath(path, folder) if is_here or not Path(path).is_absolute() else path


@dataclass(frozen=True)
class Found:
    """A folder's line-up, and notes on where it differs from what the folder holds."""

    line_up: LineUp
    notes: tuple[str, ...] = ()


def line_up_of(out: Path, folder: Path) -> Found:
    """Return the line-up of a results folder. folder: where its file will be, to which relative paths are rewritten.

    Raises InputError when the folder has no results, or its runs did not record a line-up.
    """
    rows = results.restoration_rows(results.read(out))
    if not line_up_path(out).is_file():
        raise InputError("records no line-up", out, "repeat the run's command, which computes nothing again")
    line_up = line_up_in(line_up_path(out))

    def seen(path: str) -> str:
        return _relative(os.path.normpath(out / path), folder)

    files = [seen(file) for file in line_up.settings.get("plugins", [])]
    moved = replace(
        line_up,
        datasets=tuple(_with_paths("dataset", entry, seen) for entry in line_up.datasets),
        methods=tuple(_with_paths("method", entry, seen) for entry in line_up.methods),
        settings={**line_up.settings, **({"plugins": files} if files else {})},
    )
    return Found(moved, tuple(_notes(line_up, rows)))


def _notes(line_up: LineUp, rows: DataFrame) -> Iterator[str]:
    """Where a run of the line-up would do other than the folder holds."""
    there = set(rows[["dataset", "method"]].itertuples(index=False, name=None))
    methods = [entry.label or entry.name for entry in line_up.methods]
    for dataset, method in itertools.product(map(_full_label, line_up.datasets), methods):
        if (dataset, method) not in there:
            yield f"the folder has no results of {method} on {dataset}; the line-up runs it too"
    views = rows.groupby(["dataset", "method"])["view"].agg(frozenset)
    for dataset, by_method in views.groupby("dataset"):
        if by_method.nunique() > 1:
            yield f"not every method has the same views of {dataset}; the line-up takes those of the last command"
