"""Scores on common pixels, computed after all jobs of a run if methods fill different pixels of a view.

The pictures and masks are those that the results folder holds, so no method runs again. All methods of the folder that
restored the view take part, also those of earlier runs; one that failed or fills less than 1 % of the image does not.
What is there already is not scored again, unless the common mask has changed.
"""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.common_pixels.of_view import (
    CommonView,
    PixelMetrics,
    Stored,
    add_scores,
    of_views,
    rows_of,
    score_of,
)
from sucre_bench.engine.preflight import Planned
from sucre_bench.engine.select_views import Task
from sucre_bench.errors import DamagedFileError
from sucre_bench.machine import progress
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    COMMON_TABLE,
    CommonRow,
    ViewKey,
    common_frame,
    common_rows,
    differing_views,
    filled_restorations,
    read_common,
    write_common,
)
from sucre_bench.results.layout import log_path
from sucre_bench.results.rows import row_objects
from sucre_bench.results.table import locked as locked_table

_FLUSH_S = 30.0
_VIEW = ["dataset", "scene", "view"]


def score_on_common_pixels(planned: Sequence[Planned], rows: DataFrame, out: Path) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    rows: of the results folder `out`. Raises OutputError if the table cannot be written. A fault in a view becomes its
    row.
    """
    if not _candidates(rows, planned):
        return
    with locked_table(out, COMMON_TABLE):
        rows, before = results.read(out), _before(out)  # other commands may have added to it
        metrics = PixelMetrics.chosen(
            (metric for plan in planned for metric in plan.job.metrics), log_path(out), planned[0].job.view_timeout_s
        )
        views = _views(rows, before, _candidates(rows, planned), metrics, out)
        todo = {place: view for place, view in views.items() if not view.is_done}
        made: dict[ViewKey, list[CommonRow]] = {}
        written = time.monotonic()
        try:
            for place in progress.track(list(todo), "common pixels"):
                made[place] = rows_of(todo[place], metrics)
                if time.monotonic() - written > _FLUSH_S:
                    write_common(out, _replaced(before, made))
                    written = time.monotonic()
        finally:
            if made:
                write_common(out, _replaced(before, made))


def _before(out: Path) -> DataFrame:
    try:
        return read_common(out)
    except DamagedFileError:
        progress.say(f"{out / COMMON_TABLE}: is damaged, and is made again")
        return common_frame([])


def _replaced(before: DataFrame, made: Mapping[ViewKey, Sequence[CommonRow]]) -> DataFrame:
    """The table with the new rows of some views."""
    import pandas as pd

    keys = zip(*(before[name] for name in _VIEW), strict=True)
    kept = before[[key not in made for key in keys]]
    new = common_frame(row for rows in made.values() for row in rows)
    return pd.concat([table for table in (kept, new) if len(table)] or [new], ignore_index=True)


# -- views and their stored scores -------------------------------------------------------------------------


def _candidates(rows: DataFrame, planned: Sequence[Planned]) -> dict[ViewKey, Task]:
    """The views of the jobs that several methods restored, one of them with holes."""
    wanted = differing_views(filled_restorations(rows))
    tasks = {(plan.job.dataset.label, task.base.scene, task.view.name): task for plan in planned for task in plan.tasks}
    return {place: task for place, task in tasks.items() if place in wanted}


def _views(
    rows: DataFrame, before: DataFrame, tasks: Mapping[ViewKey, Task], metrics: PixelMetrics, out: Path
) -> dict[ViewKey, CommonView]:
    views = {place: CommonView(task.base, task.view) for place, task in tasks.items()}
    for place, row in of_views(row_objects(filled_restorations(rows)), views):
        if row.data_id == views[place].base.data_id:
            views[place].add(row, Stored(out, tasks[place].place, row))
    add_scores(views, rows, metrics)
    for place, common in of_views(common_rows(before), views):
        view = views[place]
        if common.metric == COMMON_PIXELS:
            view.before = common
        elif (
            common.method in view.whole and common.time >= view.whole[common.method].time and common.status != "failed"
        ):
            view.scores[score_of(common)] = common
    return {place: view for place, view in views.items() if view.may_differ}
