"""Makes the line-up of a results folder, from its last command's configuration and the rows of older commands."""

import itertools
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.errors import InputError
from sucre_bench.jobs.config_file import config_path, read_config
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.labels import undegraded_label
from sucre_bench.jobs.lineup import Entry, Kind, LineUp
from sucre_bench.jobs.metric_words import MetricChoice
from sucre_bench.jobs.presets import given_paths
from sucre_bench.jobs.rerun import given
from sucre_bench.jobs.study_block import Study

# Settings of the last command that a line-up has where they are not as by default.
_SETTINGS: dict[str, Any] = {"views": None, "every": 1, "first": None, "seed": 0, "save": "display", "baseline": ""}


@dataclass(frozen=True)
class Found:
    """A folder's line-up, and notes on where it differs from what the folder holds."""

    line_up: LineUp
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Made:
    """A dataset and a configuration that the folder has results of, each with its label and record."""

    dataset: str
    dataset_record: Mapping[str, Any]
    degrade: Mapping[str, Any]
    replicate: int
    method: str
    method_record: Mapping[str, Any]

    @property
    def pair(self) -> tuple[str, str]:
        return self.dataset, self.method

    @property
    def key(self) -> tuple[str, str, int]:
        return self.dataset, self.method, self.replicate


def line_up_of(out: Path, folder: Path) -> Found:
    """Return the line-up of a results folder. folder: where its file will be, to which relative paths are rewritten.

    Raises InputError when the folder has no results.
    """
    rows = results.read(out)
    jobs = list(read_config(config_path(out))) if config_path(out).is_file() else []
    last = {one.key: one for one in _of_jobs(jobs)}
    older = {one.key: one for one in _of_rows(rows) if one.key not in last}
    made = [*older.values(), *last.values()]
    if not made:
        raise InputError("its rows do not say which options made them", out, "run again with this version")
    seed = jobs[0].seed if jobs else 0
    line_up = LineUp(
        datasets=_entries("dataset", made, seed, folder),
        methods=_entries("method", made, seed, folder),
        metrics=tuple(_metrics(jobs, rows)),
        sweep=_replicates(made),
        settings=_settings(jobs, folder),
    )
    return Found(line_up, tuple(_notes(made, rows)))


def _of_jobs(jobs: Iterable[Job]) -> Iterator[_Made]:
    for job in jobs:
        yield _Made(
            job.dataset.label,
            job.dataset.record,
            job.degrade.record,
            job.replicate,
            job.method.label,
            job.method.record,
        )


def _of_rows(rows: DataFrame) -> Iterator[_Made]:
    """What older commands made; rows of before datasets were recorded tell nothing."""
    last = rows.sort_values("time", kind="stable").drop_duplicates(["dataset", "method", "options"], keep="last")
    for row in last.itertuples():
        record: dict[str, Any] = json.loads(str(row.options))
        dataset, degrade = record.pop("dataset", None), record.pop("degrade", {})
        replicate = record.pop("replicate", 0)
        if dataset and "name" in record:
            yield _Made(str(row.dataset), dataset, degrade, replicate, str(row.method), record)


def _entries(kind: Kind, made: Sequence[_Made], seed: int, folder: Path) -> tuple[Entry, ...]:
    chosen = {}
    for one in made:
        key, label, record, degrade = one.method, one.method, one.method_record, {}
        if kind == "dataset":
            key, record = one.dataset, one.dataset_record
            label = undegraded_label(key, one.degrade, str(record["name"]))
            degrade = {"degrade": _degrade(one, folder)} if one.degrade else {}
        options = {name: value for name, value in given(kind, record, seed).items() if name != "name"}
        chosen[key] = Entry(str(record["name"]), {"label": label, **_moved(kind, record, options, folder), **degrade})
    names = Counter(entry.name for entry in chosen.values())
    return tuple(_without_needless_label(entry, names[entry.name]) for entry in chosen.values())


def _degrade(one: _Made, folder: Path) -> dict[str, Any]:
    water = one.degrade.get("add_water")
    return {**one.degrade, **({"add_water": _relative(water, folder)} if isinstance(water, str) else {})}


def _without_needless_label(entry: Entry, entries: int) -> Entry:
    """The entry without a label that it has anyway. entries: how many there are of its name; several name options."""
    is_needless = entry.label == entry.name and entries == 1
    return replace(entry, options={k: v for k, v in entry.options.items() if k != "label" or not is_needless})


def _moved(kind: Kind, record: Mapping[str, Any], options: Mapping[str, Any], folder: Path) -> dict[str, Any]:
    """Options with their relative paths as seen from a folder."""
    paths = given_paths(kind, str(record["name"]), options)
    return {**options, **{name: _relative(path, folder) for name, path in paths.items()}}


def _relative(path: str, folder: Path) -> str:
    return path if Path(path).is_absolute() else os.path.relpath(path, folder)


def _metrics(jobs: Sequence[Job], rows: DataFrame) -> Iterator[Entry]:
    """The metrics of the last command, then those that only rows have, but for scores that no run computes."""
    last = {choice.plugin.name: choice for job in jobs for choice in job.metrics}
    for choice in last.values():
        yield from _metric(choice)
    scored = results.score_rows(rows)
    for name, variants in scored.groupby("metric", sort=False)["variant"].unique().items():
        if name not in last and name in plugins.discover("metric"):
            yield from (Entry(f"{name}:{variant}") for variant in variants)


def _metric(choice: MetricChoice) -> Iterator[Entry]:
    name, record = choice.plugin.name, choice.choice.record
    options = {key: value for key, value in given("metric", record, 0).items() if key != "name"}
    if choice.variants == choice.plugin.default or options:
        variants = {} if choice.variants == choice.plugin.default else {"variants": list(choice.variants)}
        yield Entry(name, {**variants, **options})
    elif choice.variants == tuple(choice.plugin.variants):
        yield Entry(f"{name}:all")
    else:
        yield from (Entry(f"{name}:{variant}") for variant in choice.variants)


def _replicates(made: Iterable[_Made]) -> dict[str, Sequence[Any]]:
    numbers = sorted({one.replicate for one in made})
    return {"replicate": numbers} if numbers != [0] else {}


def _settings(jobs: Sequence[Job], folder: Path) -> dict[str, Any]:
    """What the last command says of views, draws and files, and its study."""
    if not jobs:
        return {}
    job = jobs[0]
    values = {name: getattr(job, name) for name in _SETTINGS}
    kept = {name: value for name, value in values.items() if value != _SETTINGS[name]}
    if job.views is not None:
        kept["views"] = list(job.views)
    files = [_relative(_from_here(file), folder) for file in job.plugin_files]
    study = _study(job.study) if job.study else {}
    return kept | ({"plugins": files} if files else {}) | ({"study": study} if study else {})


def _from_here(file: str) -> str:
    """A file in this folder or below it by its relative path."""
    path, here = Path(file), Path.cwd()
    return str(path.relative_to(here)) if path.is_relative_to(here) else file


def _study(study: Study) -> dict[str, Any]:
    values = {name: list(v) if isinstance(v, tuple) else v for name, v in vars(study).items()}
    return {name: value for name, value in values.items() if value != Study.defaults()[name]}


def _notes(made: Sequence[_Made], rows: DataFrame) -> Iterator[str]:
    """Where a run of the line-up would do other than the folder holds."""
    datasets, methods = (dict.fromkeys(one.pair[i] for one in made) for i in (0, 1))
    there = {one.pair for one in made}
    for dataset, method in itertools.product(datasets, methods):
        if (dataset, method) not in there:
            yield f"the folder has no results of {method} on {dataset}; the line-up runs it too"
    views = results.restoration_rows(rows).groupby(["dataset", "method"])["view"].agg(frozenset)
    for dataset, by_method in views.groupby("dataset"):
        if by_method.nunique() > 1:
            yield f"not every method has the same views of {dataset}; the line-up takes those of the last command"
