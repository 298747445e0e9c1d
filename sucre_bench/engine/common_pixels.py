"""Scores on common pixels: the pixels of a view that all methods fill. `compare/choose_pixels.py` uses them.

`view_rows` scores one view from the pictures and masks of its restorations. A run calls it for the views of its
results folder, `compare` for those of several folders, and Python for restorations in memory. No method runs again.
"""

from __future__ import annotations

import json
import math
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol

import numpy as np
import numpy.typing as npt

from sucre_bench import results
from sucre_bench.arrays import DataFrame, Mask, Picture
from sucre_bench.engine.preflight import Planned
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.engine.select_views import Task, open_scenes, tasks
from sucre_bench.errors import DamagedFileError, InputError, SucreBenchError, one_line, raise_if_stop
from sucre_bench.imaging.once import locked
from sucre_bench.jobs.config_file import config_path, read_config
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.metric_words import MetricChoice, metric_choices
from sucre_bench.machine import progress
from sucre_bench.machine.records import keep_traceback, now
from sucre_bench.results.bundle_format import is_bundle
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    COMMON_TABLE,
    CommonRow,
    Kind,
    ViewKey,
    common_frame,
    common_mask,
    common_rows,
    differing_views,
    filled_restorations,
    kind_of,
    read_common,
    write_common,
)
from sucre_bench.results.layout import Place, log_path
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import (
    PictureOnly,
    masked,
    stored_mask,
    stored_picture,
    stored_restoration,
)
from sucre_bench.results.rows import RESTORATION, Row, restorations, row_objects
from sucre_bench.results.table import is_fresh
from sucre_bench.results.table import locked as locked_table
from sucre_bench.scene import Restoration, View

_FLUSH_S = 30.0
_VIEW = ["dataset", "scene", "view"]

_Score = tuple[str, str, str, str]  # method, metric, variant, code
_Restoration = tuple[str, str, str, str, str]  # dataset, scene, view, method, time


class RestorationSource(Protocol):
    """The mask and the pictures of a restoration. Each method raises InputError if it cannot read them."""

    def mask(self) -> Mask:
        """Return which pixels (H, W) have a colour."""
        ...

    def picture(self) -> Picture:
        """Return the restored image (H, W, 3), uint8 RGB, holes black."""
        ...

    def restoration(self, mask: Mask) -> Restoration:
        """Return the restoration with holes outside a mask (H, W); it has no computed image if none was stored."""
        ...


@dataclass(frozen=True)
class Stored:
    """A restoration in a results folder. whole: its row."""

    out: Path
    place: Place
    whole: Row

    def mask(self) -> Mask:
        """See `RestorationSource`."""
        return stored_mask(self.out, self.place, self.whole)

    def picture(self) -> Picture:
        """See `RestorationSource`."""
        return stored_picture(self.out, self.place, self.whole.method)

    def restoration(self, mask: Mask) -> Restoration:
        """See `RestorationSource`."""
        return stored_restoration(self.out, self.place, self.whole, mask)


@dataclass(frozen=True, eq=False)
class InMemory:
    """A restoration as its picture (H, W, 3) and mask, at one bit a pixel."""

    shown: Picture
    bits: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, shown: Picture, mask: Mask) -> InMemory:
        """shown: uint8 RGB, holes black."""
        return cls(shown, np.packbits(mask))

    def mask(self) -> Mask:
        """See `RestorationSource`."""
        height, width = self.shown.shape[:2]
        return np.unpackbits(self.bits, count=height * width).astype(np.bool_).reshape(height, width)

    def picture(self) -> Picture:
        """See `RestorationSource`."""
        return self.shown

    def restoration(self, mask: Mask) -> Restoration:
        """See `RestorationSource`."""
        return PictureOnly(mask, Reason.NOT_HELD)


@dataclass(frozen=True)
class PixelMetrics:
    """The metrics that score pixels, by name and version. log: keeps tracebacks; limit_s: of one score."""

    by_code: Mapping[tuple[str, str], Scorer]
    log: Path | None = None
    limit_s: float | None = None

    @classmethod
    def chosen(
        cls, metrics: Iterable[MetricChoice], log: Path | None = None, limit_s: float | None = None
    ) -> PixelMetrics:
        """Make those of some metrics that score pixels; the last one if several have one name."""
        by_name = {metric.plugin.name: metric for metric in metrics if metric.plugin.is_of_pixels}
        return cls({(made.plugin.name, made.code): made for made in scorers(by_name.values())}, log, limit_s)

    def of(self, row: Row) -> Scorer | None:
        """The metric that made a score; None if the run asks for another version of it, or for other options."""
        return self.by_code.get((row.metric, row.code.partition(".")[2]))


@dataclass
class CommonView:
    """A view that several methods restored, one of them with holes.

    base: a row with its dataset, scene and view; whole, sources: by method, the row of the restoration, and where its
    mask and pictures come from; own_rows: the scores on own pixels; before: the stored row of its common pixels;
    scores: the stored scores on common pixels, without those of other restorations than in `whole`.
    """

    base: Row
    view: View
    whole: dict[str, Row] = field(default_factory=dict)
    sources: dict[str, RestorationSource] = field(default_factory=dict)
    own_rows: list[Row] = field(default_factory=list)
    before: CommonRow | None = None
    scores: dict[_Score, CommonRow] = field(default_factory=dict)

    @property
    def is_done(self) -> bool:
        """Whether nothing has changed since the view's row was written, and no score is missing."""
        row = self.before
        if row is None or row.status == "failed" or json.loads(row.methods) != sorted(self.whole):
            return False
        is_newest = all(whole.time <= row.time for whole in self.whole.values())
        return is_newest and (
            row.variant != "common" or all(_score_of(scored) in self.scores for scored in self.own_rows)
        )

    def add_stored(self, row: CommonRow) -> None:
        """Add a row that the table of scores on common pixels has, if it is of this view's restorations."""
        if row.metric == COMMON_PIXELS:
            self.before = row
        elif row.method in self.whole and row.time >= self.whole[row.method].time and row.status != "failed":
            self.scores[_score_of(row)] = row


def _key(row: Row) -> ViewKey:
    return row.dataset, row.scene, row.view


def _score_of(row: Row) -> _Score:
    return row.method, row.metric, row.variant, row.code


# -- one view ----------------------------------------------------------------------------------------------


def view_rows(view: CommonView, metrics: PixelMetrics) -> list[CommonRow]:
    """Score a view on its common pixels; the first row stands for the view. A fault becomes that row."""
    base = replace(
        view.base, method="", options="{}", options_id="", metric=COMMON_PIXELS, unit="share", better="none", code="",
        value=math.nan, time=now(),
    )  # fmt: skip
    try:
        return _scored(view, metrics, base)
    except InputError as fault:
        reason = one_line(fault)
    except BaseException as fault:
        raise_if_stop(fault)
        keep_traceback(metrics.log, f"{base.dataset} / {base.scene} / {base.view} / common pixels")
        reason = one_line(fault)
    unknown: Kind = "unknown"
    return [CommonRow.of(replace(base, variant=unknown, status="failed", reason=reason), "", list(view.whole))]


def _scored(view: CommonView, metrics: PixelMetrics, base: Row) -> list[CommonRow]:
    masks = {name: None if row.coverage == 1 else view.sources[name].mask() for name, row in view.whole.items()}
    common, differing = common_mask(masks)
    kind, pixels = kind_of(common, differing)
    share = float(common.mean())
    reason = Reason.NO_SHARED_PIXELS.value if kind == "none" else ""
    base = replace(base, value=share, coverage=share, n_pixels=int(common.sum()), variant=kind, reason=reason)
    rows = [CommonRow.of(base, pixels, list(view.whole))]
    if kind != "common":
        return rows
    is_same = view.before is not None and view.before.pixels == pixels
    for method in view.whole:
        known = {key: row for key, row in view.scores.items() if is_same and key[0] == method}
        rows += known.values()  # also by metrics that this run does not ask for
        todo = [row for row in view.own_rows if row.method == method and _score_of(row) not in known]
        if todo:
            rows += _scores(metrics, view, method, todo, common, pixels)
    return rows


def _scores(
    metrics: PixelMetrics, view: CommonView, method: str, own_rows: Sequence[Row], common: Mask, pixels: str
) -> Iterator[CommonRow]:
    """Score a restored image on the common pixels, by the metrics and variants that it has on its own pixels."""
    source = view.sources[method]
    picture = source.picture()
    if picture.shape[:2] != common.shape:
        sizes = [f"{w}x{h}" for h, w in (picture.shape[:2], common.shape)]
        what = f"the restored image of {method}"
        raise InputError(f"is {sizes[0]}, others are {sizes[1]}", what, "run that method again with overwrite=always")
    shown = locked(masked(picture / np.float32(255), common))
    scored, started = Scored(source.restoration(common), shown, view.view), now()
    for row in own_rows:
        scorer, base = metrics.of(row), replace(row, time=started)
        for made in variant_rows(scorer.metric, scored, base, metrics.log, metrics.limit_s) if scorer else ():
            if made.region == "image":
                yield CommonRow.of(made, pixels)


def _fill(
    views: Mapping[ViewKey, CommonView],
    rows: DataFrame,
    metrics: PixelMetrics,
    source: Callable[[Row], RestorationSource | None],
) -> None:
    """Add to each view its restorations and their scores on own pixels.

    rows: of the score table; source: where a restoration's pictures are, None for one that takes no part.
    """
    for row in row_objects(filled_restorations(rows)):
        if _key(row) in views and (pictures := source(row)) is not None:
            views[_key(row)].whole[row.method], views[_key(row)].sources[row.method] = row, pictures
    names = {name for name, _ in metrics.by_code}
    scores = rows[(rows["status"] == "ok") & (rows["region"] == "image") & rows["metric"].isin(names)]
    for row in row_objects(scores):
        if (view := views.get(_key(row))) and row.method in view.whole and metrics.of(row):
            view.own_rows.append(row)


# -- restorations in memory --------------------------------------------------------------------------------


def score_in_memory(
    views: Sequence[View], rows: DataFrame, held: Mapping[tuple[str, str], InMemory], metrics: Sequence[str]
) -> DataFrame:
    """Return scores on common pixels of the views that methods fill differently, as `results.read_common` has them.

    rows: all scores of one scene; held: restorations by view and label; metrics: those of the rows, by name.
    """
    by_name, chosen = {view.name: view for view in views}, PixelMetrics.chosen(metric_choices(metrics))
    whole = filled_restorations(rows)
    differing = differing_views(whole)
    made: dict[ViewKey, CommonView] = {}
    for row in row_objects(whole):
        if _key(row) in differing:
            made.setdefault(_key(row), CommonView(row, by_name[row.view]))
    _fill(made, rows, chosen, lambda row: held[row.view, row.method])
    return common_frame(row for view in made.values() for row in view_rows(view, chosen))


# -- a run's results folder --------------------------------------------------------------------------------


def score_on_common_pixels(planned: Sequence[Planned], rows: DataFrame, out: Path) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    All methods of the folder that restored a view take part, also those of earlier runs; one that failed or fills less
    than 1 % of the image does not. What is there already is not scored again, unless the common mask has changed.

    rows: of the results folder `out`. Raises OutputError if the table cannot be written. A fault in a view becomes its
    row.
    """
    if not _candidates(rows, planned):
        return
    with locked_table(out, COMMON_TABLE):
        rows = results.read(out)  # other commands may have added to it
        try:
            before = read_common(out)
        except DamagedFileError:
            progress.say(f"{out / COMMON_TABLE}: is damaged, and is made again")
            before = common_frame([])
        metrics = PixelMetrics.chosen(
            (metric for plan in planned for metric in plan.job.metrics), log_path(out), planned[0].job.view_timeout_s
        )
        todo = _views_to_score(rows, before, _candidates(rows, planned), metrics, out)
        made: dict[ViewKey, list[CommonRow]] = {}
        written = time.monotonic()
        try:
            for key in progress.track(list(todo), "common pixels"):
                made[key] = view_rows(todo[key], metrics)
                if time.monotonic() - written > _FLUSH_S:
                    write_common(out, _replaced(before, made))
                    written = time.monotonic()
        finally:
            if made:
                write_common(out, _replaced(before, made))


def _replaced(before: DataFrame, made: Mapping[ViewKey, Sequence[CommonRow]]) -> DataFrame:
    """The table with the new rows of some views."""
    import pandas as pd

    keys = zip(*(before[name] for name in _VIEW), strict=True)
    kept = before[[key not in made for key in keys]]
    new = common_frame(row for rows in made.values() for row in rows)
    return pd.concat([table for table in (kept, new) if len(table)] or [new], ignore_index=True)


def _candidates(rows: DataFrame, planned: Sequence[Planned]) -> dict[ViewKey, Task]:
    """The views of the jobs that several methods restored, one of them with holes."""
    wanted = differing_views(filled_restorations(rows))
    every = {(plan.job.dataset.label, task.base.scene, task.view.name): task for plan in planned for task in plan.tasks}
    return {key: task for key, task in every.items() if key in wanted}


def _views_to_score(
    rows: DataFrame, before: DataFrame, candidates: Mapping[ViewKey, Task], metrics: PixelMetrics, out: Path
) -> dict[ViewKey, CommonView]:
    """The views whose stored scores on common pixels are missing or older than their restorations."""
    views = {key: CommonView(task.base, task.view) for key, task in candidates.items()}

    def source(row: Row) -> Stored | None:
        task = candidates[_key(row)]
        return Stored(out, task.place, row) if row.data_id == task.base.data_id else None

    _fill(views, rows, metrics, source)
    for common in common_rows(before):
        if _key(common) in views:
            views[_key(common)].add_stored(common)

    def may_differ(view: CommonView) -> bool:
        return len(view.whole) > 1 and any(whole.coverage < 1 for whole in view.whole.values())

    return {key: view for key, view in views.items() if may_differ(view) and not view.is_done}


# -- several results folders -------------------------------------------------------------------------------


def score_folders(folders: Sequence[Path], rows: DataFrame) -> DataFrame:
    """Return scores on common pixels, as `results.read_common` has them, of views with restorations in several folders.

    Nothing is written. rows: of all folders, as `compare.load` reads them. A view has no scores if its data do not open
    any more, or if one of its restorations lies in a bundle.
    """
    rows_now = rows[is_fresh(rows)]
    whole = [*row_objects(filled_restorations(rows_now))]
    if not (differing := differing_views(filled_restorations(rows_now))):
        return common_frame([])
    places = [folder for folder in folders if not is_bundle(folder)]
    tables = ((folder, restorations(results.read(folder, metric=RESTORATION))) for folder in places)
    folder_of = {_restoration(row): folder for folder, table in tables for row in row_objects(table)}
    of_view: dict[ViewKey, set[Path | None]] = {}
    for row in whole:
        of_view.setdefault(_key(row), set()).add(folder_of.get(_restoration(row)))  # a bundle counts as a folder
    wanted = {key for key, several in of_view.items() if key in differing and len(several) > 1}
    jobs = [job for folder in places for job in _jobs(folder)] if wanted else []
    metrics = PixelMetrics.chosen(metric for job in jobs for metric in job.metrics)
    opened = _tasks(jobs, wanted)
    views = {key: CommonView(task.base, task.view) for key, task in opened.items()}

    def source(row: Row) -> Stored | None:
        folder, task = folder_of.get(_restoration(row)), opened[_key(row)]
        is_of_data = folder is not None and row.data_id == task.base.data_id
        return Stored(folder, task.place, row) if folder is not None and is_of_data else None

    _fill(views, rows_now, metrics, source)
    counts = Counter(map(_key, whole))
    complete = [view for key, view in views.items() if len(view.whole) == counts[key]]
    made = progress.track(complete, "common pixels")
    return common_frame(row for view in made for row in view_rows(view, metrics))


def _restoration(row: Row) -> _Restoration:
    """What identifies a restoration among those of all folders."""
    return row.dataset, row.scene, row.view, row.method, row.time


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
