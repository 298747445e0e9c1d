"""Scores on common pixels: the pixels of a view that all methods fill. `compare/choose_rows.py` uses them.

`CommonView.rows` scores one view from the pictures and masks of its restorations. A run calls it for the views of its
results folder, `compare` for those of several folders, and Python for restorations in memory. No method runs again.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Array, DataFrame, Mask, Picture, locked
from sucre_bench.engine.preflight import Planned, Task, open_scenes, opening_once, tasks
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.errors import InputError, SucreBenchError, one_line, raise_if_stop
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.jobs.job import CONFIG, Job, read_config
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import keep_traceback, now
from sucre_bench.plugins.options import Choice
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    ViewKey,
    common_pixels,
    differing_views,
    filled_restorations,
    kind_of,
    methods_of,
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
from sucre_bench.results.rows import (
    COMMON,
    KEYS,
    RESTORATION,
    Row,
    RowCode,
    restorations,
    row_objects,
    values_of,
)
from sucre_bench.results.table import is_bundle, is_fresh, read_common
from sucre_bench.scene import Restoration, View

_Score = tuple[str, str, str, str]  # method, metric, variant, code


@dataclass(frozen=True)
class Source:
    """What reads a restoration. Each function raises InputError if it cannot."""

    mask: Callable[[], Mask | None]
    """Returns which pixels (H, W) have a colour; None if all have."""

    picture: Callable[[tuple[int, ...]], Picture]
    """Returns the restored image (H, W, 3) of a size (H, W), uint8 RGB, holes black."""

    restoration: Callable[[Mask], Restoration]
    """Returns the restoration with holes outside a mask (H, W), without a computed image if none is there."""

    @classmethod
    def stored(cls, out: Path, place: Place, whole: Row) -> Source:
        """A restoration in a results folder. whole: its row."""
        mask = partial(stored_mask, out, place, whole) if whole.coverage < 1 else lambda: None
        picture = partial(stored_picture, out, place, whole.method)
        return cls(mask, picture, partial(stored_restoration, out, place, whole))

    @classmethod
    def held(cls, picture: Picture, mask: Mask) -> Source:
        """A restoration in memory, without its computed image."""
        holed = None if mask.all() else mask
        return cls(lambda: holed, lambda _: picture, partial(PictureOnly, reason=Reason.NOT_HELD))

    def shown(self, mask: Mask) -> Array:
        """Return the restored image (H, W, 3) in [0, 1], NaN outside a mask (H, W)."""
        return masked(self.picture(mask.shape) / np.float32(255), mask)


@dataclass(frozen=True)
class _Metrics:
    """The metrics that score pixels, by name and version. log: keeps tracebacks; limit_s: of one score."""

    by_code: Mapping[tuple[str, str], Scorer]
    log: Path | None = None
    limit_s: float | None = None

    @classmethod
    def of(
        cls, metrics: Iterable[Choice], log: Path | None = None, limit_s: float | None = None
    ) -> _Metrics:
        """Make those of some metrics that score pixels; the last one if several have one name."""
        by_name = {metric.plugin.name: metric for metric in metrics if metric.plugin.is_of_pixels}
        return cls(
            {(made.plugin.name, made.code): made for made in scorers(by_name.values())},
            log,
            limit_s,
        )

    def scorer(self, row: Row) -> Scorer | None:
        """The metric that made a score; None if the run asks for another version of it, or for other options."""
        return self.by_code.get((row.metric, RowCode.read(row.code).metric))


@dataclass
class CommonView:
    """A view that several methods restored, one of them with holes."""

    base: Row
    """A row with its dataset, scene and view."""

    view: View
    metrics: _Metrics

    whole: dict[str, Row] = field(default_factory=dict)
    """The rows of the restorations, by method."""

    sources: dict[str, Source] = field(default_factory=dict)
    """What reads the restorations, by method."""

    own_rows: list[Row] = field(default_factory=list)
    """The scores on own pixels."""

    before: Row | None = None
    """The stored row of its common pixels."""

    scores: dict[_Score, Row] = field(default_factory=dict)
    """The stored scores on common pixels by the score on own pixels, without those of other restorations than in
    `whole`."""

    @property
    def is_due(self) -> bool:
        """Whether methods may fill different pixels, and something has changed since the view's row was written, or a
        score is missing.
        """
        if len(self.whole) < 2 or all(whole.coverage == 1 for whole in self.whole.values()):
            return False
        row = self.before
        if row is None or row.status == "failed" or methods_of(row.options) != self.whole.keys():
            return True
        is_older = any(whole.time > row.time for whole in self.whole.values())
        has_scores = kind_of(row.status, row.code) == "common"
        return is_older or (
            has_scores and any(_score(own) not in self.scores for own in self.own_rows)
        )

    def rows(self) -> list[Row]:
        """Score the view on its common pixels; the first row stands for the view. A fault becomes that row."""
        base = replace(
            self.base, method="", options=json.dumps({"methods": sorted(self.whole)}), options_id="",
            metric=COMMON_PIXELS, variant=COMMON, unit="share", better="none", code="", value=math.nan, time=now(),
        )  # fmt: skip
        try:
            return self._scored(base)
        except BaseException as fault:
            raise_if_stop(fault)
            if not isinstance(fault, InputError):
                keep_traceback(
                    self.metrics.log, f"{base.dataset} / {base.scene} / {base.view} / common pixels"
                )
            return [replace(base, status="failed", reason=one_line(fault))]

    def _scored(self, base: Row) -> list[Row]:
        common = common_pixels({name: source.mask() for name, source in self.sources.items()})
        base = replace(
            base,
            value=common.share,
            coverage=common.share,
            n_pixels=int(common.mask.sum()),
            code=common.id,
        )
        if common.kind == "none":
            base = replace(base, status="skipped", reason=Reason.NO_SHARED_PIXELS.value)
        rows = [base]
        if common.kind != "common":
            return rows
        known = self.scores if self.before is not None and self.before.code == common.id else {}
        for method, source in self.sources.items():
            # also by metrics not asked for now
            rows += [row for key, row in known.items() if key[0] == method]
            todo = [
                row for row in self.own_rows if row.method == method and _score(row) not in known
            ]
            if todo:
                shown = locked(source.shown(common.mask))
                scored, started = Scored(source.restoration(common.mask), shown, self.view), now()
                limits = self.metrics.log, self.metrics.limit_s
                for own, scorer in ((own, self.metrics.scorer(own)) for own in todo):
                    if scorer:  # makes the score on own pixels again, on these
                        made = variant_rows(
                            scorer.metric, scored, replace(own, time=started), *limits
                        )
                        rows += [
                            _on_common(row, common.id) for row in made if row.region == "image"
                        ]
        return rows


def _key(row: Row) -> ViewKey:
    return row.dataset, row.scene, row.view


def _score(row: Row) -> _Score:
    return row.method, row.metric, row.variant, row.code


def _on_common(row: Row, mask: str) -> Row:
    """A score as the table has it; mask: hash of the common pixels."""
    code = replace(RowCode.read(row.code), mask=mask)
    return replace(row, variant=f"{row.variant}{COMMON}", code=str(code))


def _on_own(row: Row) -> _Score:
    """The score on own pixels that a stored score on common pixels goes with."""
    code = replace(RowCode.read(row.code, on_common=True), mask="")
    return row.method, row.metric, row.variant.removesuffix(COMMON), str(code)


def _common_views(
    views: Mapping[ViewKey, tuple[Row, View]],
    rows: DataFrame,
    metrics: _Metrics,
    source: Callable[[Row], Source | None],
    before: DataFrame | None = None,
) -> dict[ViewKey, CommonView]:
    """The views with their restorations and their scores.

    views: a row of each view, and the view; rows: of the score table; source: what reads a restoration, None for one
    that takes no part; before: the stored scores on common pixels.
    """
    made = {key: CommonView(base, view, metrics) for key, (base, view) in views.items()}
    for row in row_objects(filled_restorations(rows)):
        if _key(row) in made and (reads := source(row)) is not None:
            made[_key(row)].whole[row.method], made[_key(row)].sources[row.method] = row, reads
    names = {name for name, _ in metrics.by_code}
    scores = rows[
        (rows["status"] == "ok") & (rows["region"] == "image") & rows["metric"].isin(names)
    ]
    for row in row_objects(scores):
        if (view := made.get(_key(row))) and row.method in view.whole and metrics.scorer(row):
            view.own_rows.append(row)
    for stored in row_objects(before) if before is not None else ():
        if not (view := made.get(_key(stored))):
            continue
        if stored.metric == COMMON_PIXELS:
            view.before = stored
        elif (
            (whole := view.whole.get(stored.method))
            and stored.time >= whole.time
            and stored.status != "failed"
        ):
            view.scores[_on_own(stored)] = stored
    return made


def score_in_memory(
    views: Sequence[View],
    rows: DataFrame,
    held: Mapping[tuple[str, str], Source],
    metrics: Sequence[Any],
) -> DataFrame:
    """Return scores on common pixels of the views that methods fill differently, as `read_common` has them.

    rows: all scores of one scene; held: restorations by view and label; metrics: those of the rows, by name.
    """
    by_name, whole = {view.name: view for view in views}, filled_restorations(rows)
    differing = differing_views(whole)
    chosen = {
        _key(row): (row, by_name[row.view]) for row in row_objects(whole) if _key(row) in differing
    }
    made = _common_views(
        chosen, rows, _Metrics.of(metric_choices(metrics)), lambda row: held[row.view, row.method]
    )
    return results.frame(row for view in made.values() for row in view.rows())


def score_on_common_pixels(planned: Sequence[Planned], out: Path) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    All methods of the folder that restored a view take part, also those of earlier runs. A method that failed or fills
    less than 1 % of the image does not. Scores in the table stay, unless the common mask has changed.

    out: the results folder. Raises OutputError if the rows cannot be written. A fault in a view becomes its row.
    """
    rows = results.read(out)
    every = {_key(task.base): task for plan in planned for task in plan.tasks}
    differing = differing_views(filled_restorations(rows))
    chosen = {key: (task.base, task.view) for key, task in every.items() if key in differing}
    if not chosen:
        return
    limit_s = planned[0].job.view_timeout_s
    metrics = _Metrics.of(
        (metric for plan in planned for metric in plan.job.metrics), log_path(out), limit_s
    )

    def source(row: Row) -> Source | None:
        task = every[_key(row)]
        return Source.stored(out, task.place, row) if row.data_id == task.base.data_id else None

    views = _common_views(chosen, rows, metrics, source, read_common(out))
    part = results.Part(out, "common-pixels")
    try:
        for view in progress.track(
            [view for view in views.values() if view.is_due], "common pixels"
        ):
            part.add(view.rows())
    finally:
        part.flush()


def score_folders(folders: Sequence[Path], rows: DataFrame) -> DataFrame:
    """Return scores on common pixels, as `read_common` has them, of views with restorations in several folders.

    Nothing is written. rows: of all folders, as `compare.load` reads them. A view has no scores if its data do not open
    any more, or if one of its restorations lies in a bundle.
    """
    rows = rows[is_fresh(rows)]
    whole = filled_restorations(rows)
    if not (differing := differing_views(whole)):
        return results.frame([])
    places = [folder for folder in folders if not is_bundle(folder)]
    tables = ((folder, restorations(results.read(folder, metric=RESTORATION))) for folder in places)
    folder_of = {
        which: folder for folder, table in tables for which in values_of(table, *KEYS, "time")
    }
    of_view: dict[ViewKey, list[Path | None]] = {}
    for dataset, scene, view, *which in values_of(whole, *KEYS, "time"):
        of_view.setdefault((dataset, scene, view), []).append(
            folder_of.get((dataset, scene, view, *which))
        )
    wanted = {key for key in differing if None not in of_view[key] and len({*of_view[key]}) > 1}
    labels = {dataset for dataset, _, _ in wanted}
    jobs, opened = list[Job](), dict[ViewKey, Task]()
    for folder in places if wanted else ():
        with suppress(SucreBenchError):  # the jobs of the last run cannot be read any more
            jobs += [
                job.of_all_views()
                for job in read_config(folder / CONFIG)
                if job.dataset.label in labels
            ]
    with opening_once():
        for job in reversed(jobs):
            with suppress(SucreBenchError):  # its data cannot be opened
                every = list(tasks(job, open_scenes(job.dataset)))
                opened |= {key: task for task in every if (key := _key(task.base)) in wanted}

    def source(row: Row) -> Source | None:
        task, folder = opened[_key(row)], folder_of[(*_key(row), row.method, row.time)]
        return Source.stored(folder, task.place, row) if row.data_id == task.base.data_id else None

    metrics = _Metrics.of(metric for job in jobs for metric in job.metrics)
    views = _common_views(
        {key: (task.base, task.view) for key, task in opened.items()}, rows, metrics, source
    )
    complete = [view for key, view in views.items() if len(view.whole) == len(of_view[key])]
    return results.frame(
        row for view in progress.track(complete, "common pixels") for row in view.rows()
    )
