"""Scores on common pixels: the pixels of a view that all methods fill. `compare/choose_rows.py` uses them.

`CommonView.rows` scores one view from the pictures and masks of its restorations. A run calls it for the views of its
results folder, `compare` for those of several folders, and Python for restorations in memory. No method runs again.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from sucre_bench import results
from sucre_bench.arrays import AnyArray, Array, DataFrame, Mask, Picture, locked
from sucre_bench.engine.preflight import Planned, Task, open_scenes, opening_once, tasks
from sucre_bench.engine.score import (
    Scored,
    Scorer,
    row_of_fault,
    scorers,
    variant_rows,
)
from sucre_bench.errors import SucreBenchError
from sucre_bench.imaging.image_files import to_unit
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.jobs.job import CONFIG, Job, read_config
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import now
from sucre_bench.plugins.options import Choice
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    common_pixels,
    filled_restorations,
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
from sucre_bench.results.rows import COMMON, KEYS, Row, RowCode, row_objects, values_of
from sucre_bench.results.table import is_bundle, is_fresh
from sucre_bench.scene import Restoration, View

ViewKey = tuple[str, str, str, str]  # dataset, scene, view and data_id


@dataclass(frozen=True)
class Source:
    """What reads a restoration. Each function raises InputError if it cannot."""

    mask: Callable[[], Mask | None]
    """Returns which pixels (H, W) have a colour; None if all have."""

    picture: Callable[[tuple[int, ...]], AnyArray]
    """Returns the restored image (H, W, 3) of a size (H, W), RGB of 8 or 16 bits, holes black."""

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
        return cls(
            lambda: holed, lambda _: picture, partial(PictureOnly, reason=Reason.NOT_HELD)
        )

    def shown(self, mask: Mask) -> Array:
        """Return the restored image (H, W, 3) in [0, 1], NaN outside a mask (H, W)."""
        return masked(to_unit(self.picture(mask.shape)), mask)


@dataclass(frozen=True)
class Entrant:
    """A restoration of a view."""

    whole: Row
    """The row that stands for it."""

    source: Source

    scores: Sequence[tuple[Row, Scorer]]
    """Its scores on own pixels, each with the metric that makes it again."""


@dataclass(frozen=True)
class CommonView:
    """A view that several methods restored, one of them with holes."""

    view: View
    entrants: Sequence[Entrant]

    log: Path | None
    """Keeps tracebacks."""

    @property
    def methods(self) -> list[str]:
        """The labels of the methods."""
        return sorted(entrant.whole.method for entrant in self.entrants)

    def is_scored(self, said: Row | None) -> bool:
        """Whether the table has the view's scores. said: the table's row that stands for the view."""
        if said is None:
            return False
        last = max(entrant.whole.time for entrant in self.entrants)
        return last <= said.time and methods_of(said.options) == {*self.methods}

    def rows(self) -> list[Row]:
        """Score the view on its common pixels; the first row stands for the view. A fault becomes that row."""
        some = self.entrants[0].whole
        base = Row(
            dataset=some.dataset,
            scene=some.scene,
            view=some.view,
            options=json.dumps({"methods": self.methods}),
            metric=COMMON_PIXELS,
            variant=COMMON,
            unit="share",
            better="none",
            data_id=some.data_id,
        )
        try:
            return self._scored(base)
        except BaseException as fault:
            return [row_of_fault(base, fault, self.log)]

    def _scored(self, base: Row) -> list[Row]:
        common = common_pixels(
            {entrant.whole.method: entrant.source.mask() for entrant in self.entrants}
        )
        whole = replace(
            base,
            value=common.share,
            coverage=common.share,
            n_pixels=int(common.mask.sum()),
            code=common.id,
        )
        if common.kind == "none":
            return [replace(whole, status="skipped", reason=Reason.NO_SHARED_PIXELS.value)]
        rows = [whole]
        if common.kind == "equal":
            return rows
        for entrant in self.entrants:
            if not entrant.scores:
                continue
            shown = locked(entrant.source.shown(common.mask))
            scored = Scored(entrant.source.restoration(common.mask), shown, self.view)
            started = now()
            for own, scorer in entrant.scores:
                code = replace(RowCode.read(own.code), mask=common.id)
                rows += [
                    replace(row, variant=f"{row.variant}{COMMON}", code=str(code))
                    for row in variant_rows(scorer, scored, replace(own, time=started))
                    if row.region == "image"
                ]
        return rows


def _key(row: Row) -> ViewKey:
    return row.dataset, row.scene, row.view, row.data_id


def _common_views(
    views: Mapping[ViewKey, View],
    rows: DataFrame,
    metrics: Iterable[Choice],
    source: Callable[[Row], Source],
    log: Path | None = None,
    limit_s: float | None = None,
) -> list[CommonView]:
    """The views that several methods restored, one of them with holes.

    rows: of the score table; metrics: those asked for, of one name the last counts; source: what reads a restoration;
    log, limit_s: see `Scorer`.
    """
    wholes = defaultdict[ViewKey, list[Row]](list)
    for row in row_objects(filled_restorations(rows)):
        if _key(row) in views:
            wholes[_key(row)].append(row)
    differing = {
        key: found
        for key, found in wholes.items()
        if len(found) > 1 and any(row.coverage < 1 for row in found)
    }
    if not differing:
        return []
    by_name = {metric.plugin.name: metric for metric in metrics if metric.plugin.is_of_pixels}
    versions = {
        (scorer.plugin.name, scorer.code): scorer
        for scorer in scorers(by_name.values(), log, limit_s)
    }
    scores = defaultdict[tuple[str, ViewKey], list[tuple[Row, Scorer]]](list)
    is_score = (rows["status"] == "ok") & (rows["region"] == "image")
    for row in row_objects(rows[is_score & rows["metric"].isin(by_name)]):
        # None: the run asks for another version of the metric, or for other options
        scorer = versions.get((row.metric, RowCode.read(row.code).metric))
        if scorer and _key(row) in differing:
            scores[row.method, _key(row)].append((row, scorer))
    return [
        CommonView(
            views[key],
            [Entrant(row, source(row), scores[row.method, key]) for row in found],
            log,
        )
        for key, found in differing.items()
    ]


def score_in_memory(
    views: Sequence[View],
    rows: DataFrame,
    held: Mapping[tuple[str, str], Source],
    metrics: Sequence[Any],
) -> DataFrame:
    """Return scores on common pixels of the views that methods fill differently, as `read_both` has them.

    rows: all scores of one scene; held: restorations by view and label; metrics: those of the rows, by name.
    """
    by_name = {view.name: view for view in views}
    whole = row_objects(filled_restorations(rows))
    made = _common_views(
        {_key(row): by_name[row.view] for row in whole},
        rows,
        metric_choices(metrics),
        lambda row: held[row.view, row.method],
    )
    return results.frame(row for view in made for row in view.rows())


def score_on_common_pixels(
    planned: Sequence[Planned], rows: DataFrame, common: DataFrame
) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    All methods of the folder that restored a view take part, also those of earlier runs. A method that failed or fills
    less than 1 % of the image does not. A view of which nothing has changed keeps its scores.

    rows, common: the score table, see `results.table.read_both`. Raises OutputError if the rows cannot be written. A
    fault in a view becomes its row.
    """
    job = planned[0].job
    every = {_key(task.base): task for plan in planned for task in plan.tasks}
    views = _common_views(
        {key: task.view for key, task in every.items()},
        rows,
        [metric for plan in planned for metric in plan.job.metrics],
        lambda row: Source.stored(job.out, every[_key(row)].place, row),
        log_path(job.out),
        job.view_timeout_s,
    )
    said = {_key(row): row for row in row_objects(common[common["metric"] == COMMON_PIXELS])}
    for row in row_objects(common[common["status"] == "failed"]):
        # it is tried again
        said.pop(_key(row), None)
    due = [view for view in views if not view.is_scored(said.get(_key(view.entrants[0].whole)))]
    part = results.Part(job.out, "common-pixels")
    try:
        for view in progress.track(due, "common pixels"):
            part.add(view.rows())
    finally:
        part.flush()


def score_folders(rows: DataFrame) -> DataFrame:
    """Return scores on common pixels, as `read_both` has them, of views with restorations in several folders.

    Nothing is written. rows: of all folders, as `compare.load` reads them. A view has no scores if its data do not open
    any more, or if one of its restorations lies in a bundle.
    """
    rows = rows[is_fresh(rows)]
    whole = filled_restorations(rows)
    folder = {tuple(key): Path(place) for *key, place in values_of(whole, *KEYS, "_folder")}
    in_bundle = whole["_folder"].map(lambda place: is_bundle(Path(place)))
    by_view = whole.assign(_in_bundle=in_bundle).groupby(["dataset", "scene", "view"])
    is_wanted = (by_view["_folder"].nunique() > 1) & ~by_view["_in_bundle"].any()
    wanted = set(is_wanted.index[is_wanted])
    jobs = list[Job]()
    for place in whole["_folder"].unique() if wanted else ():
        with suppress(SucreBenchError):  # the jobs of the last run cannot be read any more
            jobs += [job.of_all_views() for job in read_config(Path(place) / CONFIG)]
    opened = dict[ViewKey, Task]()
    with opening_once():
        for job in jobs:
            if job.dataset.label in {dataset for dataset, _, _ in wanted}:
                with suppress(SucreBenchError):  # its data cannot be opened
                    every = tasks(job, open_scenes(job.dataset))
                    opened |= {_key(task.base): task for task in every}
    views = _common_views(
        {key: task.view for key, task in opened.items() if key[:3] in wanted},
        rows,
        [metric for job in jobs for metric in job.metrics],
        lambda row: Source.stored(
            folder[row.dataset, row.scene, row.view, row.method], opened[_key(row)].place, row
        ),
    )
    return results.frame(
        row for view in progress.track(views, "common pixels") for row in view.rows()
    )
