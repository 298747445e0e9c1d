"""Scores on common pixels of views whose restorations lie in several results folders; nothing is written.

A run scores the methods of one folder on their common pixels. Folders that are compared get the same from their
pictures and masks, and from their data, which `config.yaml` names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench import results
from sucre_bench.compare.newest_data import is_fresh
from sucre_bench.engine.common_view import CommonView, PixelMetrics, Stored, rows_of
from sucre_bench.engine.score import scorers
from sucre_bench.engine.tasks import Task, open_scenes, tasks
from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs.config_file import config_path, read_config
from sucre_bench.jobs.job import Job, MetricChoice
from sucre_bench.jobs.shard import Shard
from sucre_bench.machine import progress
from sucre_bench.results.bundle_format import is_bundle
from sucre_bench.results.common_scores import LEAST_FILLED, common_frame
from sucre_bench.results.rows import COLUMNS, Row, restorations

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["score_folders"]

_Place = tuple[str, str, str]  # dataset, scene, view


def score_folders(folders: Sequence[Path], rows: pd.DataFrame) -> pd.DataFrame:
    """Return scores on common pixels, as `results.read_common` has them, of views with restorations in several folders.

    rows: of all folders, as `compare.load` reads them. Views that cannot be scored have no row: their data do not open
    any more, or a restoration lies in a bundle.
    """
    places = [folder for folder in folders if not is_bundle(folder)]
    whole = restorations(rows[is_fresh(rows)])
    whole = whole[whole["coverage"] >= LEAST_FILLED]
    kept = _folders(places)
    wanted = set(_spread(whole, kept))
    if not wanted:
        return common_frame([])
    jobs = [job for folder in places for job in _jobs(folder)]
    opened = _tasks(jobs, {dataset for dataset, _, _ in wanted})
    metrics = _metrics(jobs)
    views = {place: CommonView(opened[place].base, opened[place].view) for place in wanted & opened.keys()}
    for place, row in _of_views(whole, views):
        if row.data_id == views[place].base.data_id and _key(row) in kept:
            views[place].add(row, Stored(kept[_key(row)], opened[place].place, row))
    methods = whole.groupby(["dataset", "scene", "view"])["method"].nunique().to_dict()
    complete = {place: view for place, view in views.items() if len(view.whole) == methods[place]}
    scores = rows[(rows["status"] == "ok") & (rows["region"] == "image")]
    for place, row in _of_views(scores[scores["metric"].isin({name for name, _ in metrics.by_code})], complete):
        if row.method in complete[place].whole and metrics.of(row):
            complete[place].own_rows.append(row)
    made = progress.track(list(complete.values()), "common pixels")
    return common_frame(row for view in made for row in rows_of(view, metrics))


_Key = tuple[str, str, str, str, str]


def _key(row: Row) -> _Key:
    """What identifies a restoration among those of all folders."""
    return row.dataset, row.scene, row.view, row.method, row.time


def _folders(folders: Sequence[Path]) -> dict[_Key, Path]:
    """The folder of each restoration."""
    return {_key(row): folder for folder in folders for row in _rows(restorations(results.read(folder)))}


def _spread(whole: pd.DataFrame, kept: Mapping[_Key, Path]) -> Iterator[_Place]:
    """The views with restorations in several folders, one of them with holes."""
    lying: dict[_Place, set[Path | None]] = {}
    with_holes: set[_Place] = set()
    for row in _rows(whole):
        place = (row.dataset, row.scene, row.view)
        lying.setdefault(place, set()).add(kept.get(_key(row)))
        if row.coverage < 1:
            with_holes.add(place)
    return (place for place, those in lying.items() if len(those) > 1 and place in with_holes)


def _jobs(folder: Path) -> list[Job]:
    """The jobs of a folder's last run, with all views; none if they cannot be read any more."""
    try:
        return [
            replace(job, views=None, every=1, first=None, shard=Shard()) for job in read_config(config_path(folder))
        ]
    except SucreBenchError:
        return []


def _tasks(jobs: Sequence[Job], datasets: set[str]) -> dict[_Place, Task]:
    """The views of datasets by their labels, as far as their data can be opened."""
    found: dict[_Place, Task] = {}
    done: set[str] = set()
    for job in jobs:
        key = results.fingerprint({**job.dataset.record, **job.degrade.record, "replicate": job.replicate})[1]
        if job.dataset.label not in datasets or key in done:
            continue
        done.add(key)
        try:
            for task in tasks(job, open_scenes(job.dataset)):
                found.setdefault((job.dataset.label, task.base.scene, task.view.name), task)
        except SucreBenchError:
            continue
    return found


def _metrics(jobs: Sequence[Job]) -> PixelMetrics:
    chosen: dict[str, MetricChoice] = {metric.plugin.name: metric for job in jobs for metric in job.metrics}
    made = scorers(metric for metric in chosen.values() if metric.plugin.is_of_pixels)
    return PixelMetrics({(scorer.plugin.name, scorer.code): scorer for scorer in made})


def _rows(table: pd.DataFrame) -> Iterator[Row]:
    for values in table[list(COLUMNS)].itertuples(index=False, name=None):
        yield Row(**dict(zip(COLUMNS, values, strict=True)))


def _of_views(table: pd.DataFrame, views: Mapping[_Place, CommonView]) -> Iterator[tuple[_Place, Row]]:
    for row in _rows(table):
        if (place := (row.dataset, row.scene, row.view)) in views:
            yield place, row
