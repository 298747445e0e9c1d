"""Scores on common pixels of views whose restorations lie in several results folders; nothing is written.

A run scores the methods of one folder on their common pixels. Folders that are compared get the same from their
pictures and masks, and from their data, which `config.yaml` names.
"""

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import is_fresh
from sucre_bench.engine.common_pixels.of_view import CommonView, PixelMetrics, Stored, add_scores, of_views, rows_of
from sucre_bench.engine.select_views import Task, open_scenes, tasks
from sucre_bench.errors import SucreBenchError
from sucre_bench.jobs.config_file import config_path, read_config
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.results.bundle_format import is_bundle
from sucre_bench.results.common_scores import ViewKey, common_frame, differing_views, filled_restorations
from sucre_bench.results.rows import RESTORATION, Row, restorations, row_objects

_Restoration = tuple[str, str, str, str, str]  # dataset, scene, view, method, time


def score_folders(folders: Sequence[Path], rows: DataFrame) -> DataFrame:
    """Return scores on common pixels, as `results.read_common` has them, of views with restorations in several folders.

    rows: of all folders, as `compare.load` reads them. A view has no scores if its data do not open any more, or if one
    of its restorations lies in a bundle.
    """
    whole = filled_restorations(rows[is_fresh(rows)])
    if not (differing := differing_views(whole)):
        return common_frame([])
    places = [folder for folder in folders if not is_bundle(folder)]
    folder_of = _folders(places)
    wanted = _in_several_folders(whole, differing, folder_of)
    jobs = [job for folder in places for job in _jobs(folder)] if wanted else []
    metrics = PixelMetrics.chosen(metric for job in jobs for metric in job.metrics)
    views = _views(whole, folder_of, _tasks(jobs, wanted))
    add_scores(views, rows, metrics)
    made = progress.track(list(views.values()), "common pixels")
    return common_frame(row for view in made for row in rows_of(view, metrics))


def _restoration(row: Row) -> _Restoration:
    """What identifies a restoration among those of all folders."""
    return row.dataset, row.scene, row.view, row.method, row.time


def _folders(folders: Sequence[Path]) -> dict[_Restoration, Path]:
    """The folder of each restoration."""
    tables = ((folder, restorations(results.read(folder, metric=RESTORATION))) for folder in folders)
    return {_restoration(row): folder for folder, table in tables for row in row_objects(table)}


def _in_several_folders(
    whole: DataFrame, views: Collection[ViewKey], folder_of: Mapping[_Restoration, Path]
) -> set[ViewKey]:
    """Those of some views whose restorations lie in several folders. A bundle counts as a folder."""
    found: dict[ViewKey, set[Path | None]] = {}
    for key, row in of_views(row_objects(whole), views):
        found.setdefault(key, set()).add(folder_of.get(_restoration(row)))
    return {key for key, folders in found.items() if len(folders) > 1}


def _jobs(folder: Path) -> list[Job]:
    """The jobs of a folder's last run, with all views; none if they cannot be read any more."""
    try:
        return [job.of_all_views() for job in read_config(config_path(folder))]
    except SucreBenchError:
        return []


def _tasks(jobs: Sequence[Job], wanted: Collection[ViewKey]) -> dict[ViewKey, Task]:
    """The tasks of some views, as far as their data can be opened."""
    found: dict[ViewKey, Task] = {}
    labels, opened = {dataset for dataset, _, _ in wanted}, set[str]()
    for job in jobs:
        data = results.fingerprint({**job.dataset.record, **job.degrade.record, "replicate": job.replicate})[1]
        if job.dataset.label not in labels or data in opened:
            continue
        opened.add(data)
        try:
            for task in tasks(job, open_scenes(job.dataset)):
                if (key := (job.dataset.label, task.base.scene, task.view.name)) in wanted:
                    found.setdefault(key, task)
        except SucreBenchError:
            continue
    return found


def _views(
    whole: DataFrame, folder_of: Mapping[_Restoration, Path], opened: Mapping[ViewKey, Task]
) -> dict[ViewKey, CommonView]:
    """The views with all their restorations; those that lack one are left out."""
    views = {key: CommonView(task.base, task.view) for key, task in opened.items()}
    counts: Counter[ViewKey] = Counter()
    for key, row in of_views(row_objects(whole), views):
        counts[key] += 1
        folder = folder_of.get(_restoration(row))
        if folder is not None and row.data_id == views[key].base.data_id:
            views[key].add(row, Stored(folder, opened[key].place, row))
    return {key: view for key, view in views.items() if len(view.whole) == counts[key]}
