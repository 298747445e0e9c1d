"""After the jobs of a run: where methods fill different pixels of a view, scores on the pixels that all of them fill.

The pictures and masks are those that the results folder holds, so no method runs again. All methods of the folder that
restored the view take part, also those of earlier runs; one that failed or fills less than 1 % of the image does not.
What is there already is not scored again, unless the common mask has changed.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Mask
from sucre_bench.engine.preflight import Planned
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.engine.tasks import Task
from sucre_bench.errors import ANY_FAULT, DamagedTableError, InputError, one_line
from sucre_bench.imaging.once import locked
from sucre_bench.machine import progress
from sucre_bench.machine.log import keep_traceback, now
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    COMMON_TABLE,
    LEAST_DIFFERENCE,
    LEAST_FILLED,
    CommonRow,
    Kind,
    common_frame,
    read_common,
    write_common,
)
from sucre_bench.results.layout import log_path
from sucre_bench.results.masks import mask_id
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import COLUMNS, RESTORATION, Row
from sucre_bench.results.stored_pictures import masked, stored_mask, stored_picture, stored_restoration
from sucre_bench.results.table import locked as locked_table

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["score_on_common_pixels"]

_FLUSH_S = 30.0
_VIEW = ["dataset", "scene", "view"]

_Place = tuple[str, str, str]  # dataset, scene, view
_Score = tuple[str, str, str, str]  # method, metric, variant, code


@dataclass
class _View:
    """A view that methods fill differently.

    whole: the row of each method's restoration; own: the scores on own pixels; before: what the folder holds of its
    common pixels, the view's row and the scores.
    """

    task: Task
    whole: dict[str, Row] = field(default_factory=dict)
    own: list[Row] = field(default_factory=list)
    before: CommonRow | None = None
    scores: dict[_Score, CommonRow] = field(default_factory=dict)

    @property
    def is_done(self) -> bool:
        """Whether nothing has changed since the view's row was written, and no score is missing."""
        row = self.before
        if row is None or row.status == "failed" or json.loads(row.methods) != sorted(self.whole):
            return False
        is_newest = all(own.time <= row.time for own in self.whole.values())
        return is_newest and (row.variant != "common" or all(key_of(own) in self.scores for own in self.own))


def key_of(row: Row) -> _Score:
    """What identifies a score within its view."""
    return row.method, row.metric, row.variant, row.code


def score_on_common_pixels(planned: Sequence[Planned], rows: pd.DataFrame, out: Path) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    rows: of the results folder `out`. Raises OutputError if the table cannot be written. A fault in a view becomes its
    row.
    """
    if not _candidates(rows, planned):
        return
    with locked_table(out, COMMON_TABLE):
        rows, before = results.read(out), _before(out)  # other commands may have added to it
        metrics = _metrics(planned)
        views = _views(rows, before, _candidates(rows, planned), metrics)
        todo = {place: view for place, view in views.items() if not view.is_done}
        made: dict[_Place, list[CommonRow]] = {}
        written = time.monotonic()
        try:
            for place in progress.track(list(todo), "common pixels"):
                made[place] = _rows_of(out, todo[place], metrics)
                if time.monotonic() - written > _FLUSH_S:
                    write_common(out, _replaced(before, made))
                    written = time.monotonic()
        finally:
            if made:
                write_common(out, _replaced(before, made))


def _before(out: Path) -> pd.DataFrame:
    try:
        return read_common(out)
    except DamagedTableError as fault:
        progress.say(f"{fault}: made again")
        return common_frame([])


def _replaced(before: pd.DataFrame, made: Mapping[_Place, Sequence[CommonRow]]) -> pd.DataFrame:
    """The table with the new rows of some views."""
    import pandas as pd

    keys = zip(*(before[name] for name in _VIEW), strict=True)
    kept = before[[key not in made for key in keys]]
    new = common_frame(row for rows in made.values() for row in rows)
    return pd.concat([table for table in (kept, new) if len(table)] or [new], ignore_index=True)


# -- what there is -----------------------------------------------------------------------------------------


def _candidates(rows: pd.DataFrame, planned: Sequence[Planned]) -> dict[_Place, Task]:
    """The views of the jobs that several methods restored, one of them with holes."""
    whole = _restorations(rows)
    by_view = whole.groupby(_VIEW, sort=False)
    several = (by_view["method"].nunique() > 1) & (by_view["coverage"].min() < 1)
    wanted = set(several.index[several])
    tasks = {(plan.job.dataset.label, task.base.scene, task.view.name): task for plan in planned for task in plan.tasks}
    return {place: task for place, task in tasks.items() if place in wanted}


def _restorations(rows: pd.DataFrame) -> pd.DataFrame:
    ok = rows[(rows["status"] == "ok") & (rows["view"] != "") & (rows["metric"] == RESTORATION)]
    return ok[ok["coverage"] >= LEAST_FILLED]


def _metrics(planned: Sequence[Planned]) -> dict[tuple[str, str], Scorer]:
    """The jobs' metrics of pixels, by name and code."""
    chosen = {metric.plugin.name: metric for plan in planned for metric in plan.job.metrics}
    each = scorers(metric for metric in chosen.values() if metric.plugin.is_of_pixels)
    return {(scorer.plugin.name, scorer.code): scorer for scorer in each}


def _views(
    rows: pd.DataFrame, before: pd.DataFrame, tasks: Mapping[_Place, Task], metrics: Mapping[tuple[str, str], Scorer]
) -> dict[_Place, _View]:
    views = {place: _View(task) for place, task in tasks.items()}
    for place, row in _of_views(_restorations(rows), views):
        if row.data_id == views[place].task.base.data_id:
            views[place].whole[row.method] = row
    scores = rows[(rows["status"] == "ok") & (rows["region"] == "image") & rows["metric"].isin({m for m, _ in metrics})]
    for place, row in _of_views(scores, views):
        if row.method in views[place].whole and (row.metric, row.code.partition(".")[2]) in metrics:
            views[place].own.append(row)
    for place, row in _of_views(before, views):
        assert isinstance(row, CommonRow)
        view = views[place]
        if row.metric == COMMON_PIXELS:
            view.before = row
        elif row.method in view.whole and row.time >= view.whole[row.method].time:
            view.scores[key_of(row)] = row
    return {place: view for place, view in views.items() if len(view.whole) > 1}


def _of_views(rows: pd.DataFrame, views: Mapping[_Place, _View]) -> Iterator[tuple[_Place, Row]]:
    kind, names = (CommonRow, rows.columns) if "pixels" in rows else (Row, COLUMNS)
    for values in rows[list(names)].itertuples(index=False, name=None):
        row = kind(**dict(zip(names, values, strict=True)))
        if (place := (row.dataset, row.scene, row.view)) in views:
            yield place, row


# -- one view ----------------------------------------------------------------------------------------------


def _rows_of(out: Path, view: _View, metrics: Mapping[tuple[str, str], Scorer]) -> list[CommonRow]:
    """Score a view on its common pixels; the first row stands for the view."""
    base = _row_of_view(view)
    try:
        return _scored(out, view, metrics, base)
    except InputError as fault:
        reason = one_line(fault)
    except ANY_FAULT as fault:
        keep_traceback(log_path(out), f"{base.dataset} / {base.scene} / {base.view} / common pixels")
        reason = one_line(fault)
    unknown: Kind = "unknown"
    return [CommonRow.of(replace(base, variant=unknown, status="failed", reason=reason), "", list(view.whole))]


def _row_of_view(view: _View) -> Row:
    base = view.task.base
    return replace(
        base, method="", options="{}", options_id="", metric=COMMON_PIXELS, unit="share", better="none", code="",
        value=math.nan, time=now(),
    )  # fmt: skip


def _scored(out: Path, view: _View, metrics: Mapping[tuple[str, str], Scorer], base: Row) -> list[CommonRow]:
    common, differing = _common_mask(out, view)
    share, methods = float(common.mean()), list(view.whole)
    base = replace(base, value=share, coverage=share, n_pixels=int(common.sum()))
    if differing <= LEAST_DIFFERENCE:
        return [CommonRow.of(_of_kind(base, "equal"), "", methods)]
    if not common.any():
        reason = Reason.NO_SHARED_PIXELS.value
        return [CommonRow.of(replace(_of_kind(base, "none"), reason=reason), "", methods)]
    pixels = mask_id(common)
    is_same = view.before is not None and view.before.pixels == pixels
    rows = [CommonRow.of(_of_kind(base, "common"), pixels, methods)]
    for method, whole in view.whole.items():
        known = {key: row for key, row in view.scores.items() if is_same and key[0] == method}
        own = [row for row in view.own if row.method == method]
        rows += [known[key_of(row)] for row in own if key_of(row) in known]
        todo = [row for row in own if key_of(row) not in known]
        if todo:
            rows += _scores(out, view.task, whole, todo, metrics, common, pixels)
    return rows


def _of_kind(base: Row, kind: Kind) -> Row:
    return replace(base, variant=kind)


def _common_mask(out: Path, view: _View) -> tuple[Mask, float]:
    """The pixels (H, W) that all methods fill, and the share of the image that only some of them fill."""
    common = some = None
    for method, whole in view.whole.items():
        if whole.coverage == 1:
            continue
        mask = stored_mask(out, view.task.place, whole)
        if common is not None and common.shape != mask.shape:
            sizes = [f"{w}x{h}" for h, w in (mask.shape, common.shape)]
            path = view.task.place.mask(out, method)
            raise InputError(f"{path}: is {sizes[0]}, others are {sizes[1]}; run {method} again with overwrite=always")
        common = mask if common is None else common & mask
        some = mask if some is None else some | mask
    if common is None or some is None:
        raise AssertionError("a view without holes is no candidate")
    is_filled = any(whole.coverage == 1 for whole in view.whole.values())
    return common, float((1.0 if is_filled else some.mean()) - common.mean())


def _scores(
    out: Path,
    task: Task,
    whole: Row,
    own: Sequence[Row],
    metrics: Mapping[tuple[str, str], Scorer],
    common: Mask,
    pixels: str,
) -> Iterator[CommonRow]:
    """Score a stored picture on the common pixels, by the metrics and variants that it has on its own pixels."""
    picture = stored_picture(out, task.place, whole.method)
    if picture.shape[:2] != common.shape:
        sizes = [f"{w}x{h}" for h, w in (picture.shape[:2], common.shape)]
        path = task.place.restored(out, whole.method)
        raise InputError(f"{path}: is {sizes[0]}, expected {sizes[1]}; run {whole.method} again with overwrite=always")
    shown = locked(masked(picture / np.float32(255), common))
    restoration = stored_restoration(out, task.place, whole, common)
    scored, started = Scored(restoration, shown, task.view), now()
    for row in own:
        scorer = metrics[row.metric, row.code.partition(".")[2]]
        for made in variant_rows(scorer.metric, scored, replace(row, time=started), log_path(out)):
            if made.region == "image":
                yield CommonRow.of(made, pixels)
