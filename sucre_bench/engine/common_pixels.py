"""Scores on common pixels: the pixels of a view that all methods fill. `compare/choose_rows.py` uses them.

`CommonView.rows` scores one view from the pictures and masks of its restorations. A run calls it for the views of its
results folder, `compare` for those of several folders, and Python for restorations in memory. No method runs again.
"""

from __future__ import annotations

import json
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from operator import attrgetter
from pathlib import Path
from typing import Any

from sucre_bench import results
from sucre_bench.arrays import AnyArray, Array, DataFrame, Mask, Picture, locked
from sucre_bench.engine.preflight import Planned, Task, open_scenes, opening_once, tasks
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.errors import InputError, SucreBenchError, one_line, raise_if_stop
from sucre_bench.imaging.image_files import to_unit
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
    Row,
    RowCode,
    row_objects,
    values_of,
)
from sucre_bench.results.table import is_bundle, is_fresh, read_common
from sucre_bench.scene import Restoration, View


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
class CommonView:
    """A view that several methods restored, one of them with holes."""

    base: Row
    """A row with its dataset, scene and view."""

    view: View

    log: Path | None
    """Keeps tracebacks."""

    by_method: dict[str, tuple[Row, Source]] = field(default_factory=dict)
    """The row of each restoration, and what reads it."""

    scores: list[tuple[Row, Scorer]] = field(default_factory=list)
    """Their scores on own pixels, each with the metric that makes it again."""

    def is_due(self, stored: Sequence[Row]) -> bool:
        """Whether methods may fill different pixels, and something has changed since the view was scored.

        stored: what the table has about its common pixels.
        """
        wholes = [whole for whole, _ in self.by_method.values()]
        if len(wholes) < 2 or all(whole.coverage == 1 for whole in wholes):
            return False
        row = next((row for row in stored if row.metric == COMMON_PIXELS), None)
        if row is None or row.status == "failed":
            return True
        is_older = any(whole.time > row.time for whole in wholes)
        if is_older or methods_of(row.options) != self.by_method.keys():
            return True
        wanted = {_identity(_on_common(score, row.code)) for score, _ in self.scores}
        known = {_identity(score) for score in stored if score.status != "failed"}
        return kind_of(row.status, row.code) == "common" and not wanted <= known

    def rows(self) -> list[Row]:
        """Score the view on its common pixels; the first row stands for the view. A fault becomes that row."""
        base = replace(
            self.base, method="", options=json.dumps({"methods": sorted(self.by_method)}), options_id="",
            metric=COMMON_PIXELS, variant=COMMON, unit="share", better="none", code="", value=math.nan, time=now(),
        )  # fmt: skip
        try:
            return self._scored(base)
        except BaseException as fault:
            raise_if_stop(fault)
            if not isinstance(fault, InputError):
                where = f"{base.dataset} / {base.scene} / {base.view} / common pixels"
                keep_traceback(self.log, where)
            return [replace(base, status="failed", reason=one_line(fault))]

    def _scored(self, base: Row) -> list[Row]:
        masks = {method: source.mask() for method, (_, source) in self.by_method.items()}
        common = common_pixels(masks)
        base = replace(
            base,
            value=common.share,
            coverage=common.share,
            n_pixels=int(common.mask.sum()),
            code=common.id,
        )
        if common.kind == "none":
            return [replace(base, status="skipped", reason=Reason.NO_SHARED_PIXELS.value)]
        rows = [base]
        if common.kind == "equal":
            return rows
        for method, (_, source) in self.by_method.items():
            of_method = [(row, scorer) for row, scorer in self.scores if row.method == method]
            if not of_method:
                continue
            shown = locked(source.shown(common.mask))
            scored, started = Scored(source.restoration(common.mask), shown, self.view), now()
            for own, scorer in of_method:
                own = replace(own, time=started)
                made = variant_rows(scorer, scored, own)
                rows += [_on_common(row, common.id) for row in made if row.region == "image"]
        return rows


_key: Callable[[Row], ViewKey] = attrgetter("dataset", "scene", "view")
_identity = attrgetter("method", "metric", "variant", "code")


def _on_common(row: Row, mask: str) -> Row:
    """A score as the table has it; mask: hash of the common pixels."""
    code = replace(RowCode.read(row.code), mask=mask)
    return replace(row, variant=f"{row.variant}{COMMON}", code=str(code))


def _common_views(
    views: Mapping[ViewKey, tuple[Row, View]],
    rows: DataFrame,
    metrics: Iterable[Choice],
    source: Callable[[Row], Source | None],
    log: Path | None = None,
    limit_s: float | None = None,
) -> dict[ViewKey, CommonView]:
    """The views with their restorations and their scores.

    views: a row of each view, and the view; rows: of the score table; metrics: those asked for, of one name the last
    counts; source: what reads a restoration, None for one that takes no part; log, limit_s: see `Scorer`.
    """
    made = {key: CommonView(base, view, log) for key, (base, view) in views.items()}
    for row in row_objects(filled_restorations(rows)):
        if _key(row) in made and (reads := source(row)):
            made[_key(row)].by_method[row.method] = row, reads
    by_name = {metric.plugin.name: metric for metric in metrics if metric.plugin.is_of_pixels}
    of_pixels = scorers(by_name.values(), log, limit_s)
    versions = {(scorer.plugin.name, scorer.code): scorer for scorer in of_pixels}
    is_score = (rows["status"] == "ok") & (rows["region"] == "image")
    for row in row_objects(rows[is_score & rows["metric"].isin(by_name)]):
        # None: the run asks for another version of the metric, or for other options
        scorer = versions.get((row.metric, RowCode.read(row.code).metric))
        view = made.get(_key(row))
        if scorer and view and row.method in view.by_method:
            view.scores.append((row, scorer))
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
    by_name = {view.name: view for view in views}
    whole = filled_restorations(rows)
    differing = differing_views(whole)
    chosen = {
        _key(row): (row, by_name[row.view])
        for row in row_objects(whole)
        if _key(row) in differing
    }
    made = _common_views(
        chosen, rows, metric_choices(metrics), lambda row: held[row.view, row.method]
    )
    return results.frame(row for view in made.values() for row in view.rows())


def score_on_common_pixels(planned: Sequence[Planned], out: Path) -> None:
    """Bring the scores on common pixels up to date for the views of a run's jobs.

    All methods of the folder that restored a view take part, also those of earlier runs. A method that failed or fills
    less than 1 % of the image does not. A view of which nothing has changed keeps its scores.

    out: the results folder. Raises OutputError if the rows cannot be written. A fault in a view becomes its row.
    """
    rows = results.read(out)
    every = {_key(task.base): task for plan in planned for task in plan.tasks}
    differing = differing_views(filled_restorations(rows)) & every.keys()
    if not differing:
        return
    jobs = [plan.job for plan in planned]
    limit_s = jobs[0].view_timeout_s
    chosen = {key: task for key, task in every.items() if key in differing}
    views = _stored_views(chosen, rows, jobs, lambda _: out, log_path(out), limit_s)
    stored = defaultdict[ViewKey, list[Row]](list)
    for row in row_objects(read_common(out)):
        stored[_key(row)].append(row)
    due = [view for key, view in views.items() if view.is_due(stored[key])]
    part = results.Part(out, "common-pixels")
    try:
        for view in progress.track(due, "common pixels"):
            part.add(view.rows())
    finally:
        part.flush()


def _stored_views(
    chosen: Mapping[ViewKey, Task],
    rows: DataFrame,
    jobs: Iterable[Job],
    folder: Callable[[Row], Path],
    log: Path | None = None,
    limit_s: float | None = None,
) -> dict[ViewKey, CommonView]:
    """See `_common_views`, of restorations that lie in a folder. One of other data than the view's takes no part."""

    def source(row: Row) -> Source | None:
        task = chosen[_key(row)]
        is_of_data = row.data_id == task.base.data_id
        return Source.stored(folder(row), task.place, row) if is_of_data else None

    metrics = [metric for job in jobs for metric in job.metrics]
    views = {key: (task.base, task.view) for key, task in chosen.items()}
    return _common_views(views, rows, metrics, source, log, limit_s)


def score_folders(rows: DataFrame) -> DataFrame:
    """Return scores on common pixels, as `read_common` has them, of views with restorations in several folders.

    Nothing is written. rows: of all folders, as `compare.load` reads them. A view has no scores if its data do not open
    any more, or if one of its restorations lies in a bundle.
    """
    rows = rows[is_fresh(rows)]
    whole = filled_restorations(rows)
    folders = defaultdict[ViewKey, dict[str, Path]](dict)  # of each view, by method
    for *key, method, place in values_of(whole, *KEYS, "_folder"):
        folders[tuple(key)][method] = Path(place)
    wanted = {
        key
        for key in differing_views(whole)
        if len({*folders[key].values()}) > 1 and not any(map(is_bundle, folders[key].values()))
    }
    jobs, opened = list[Job](), dict[ViewKey, Task]()
    for folder in map(Path, whole["_folder"].unique() if wanted else ()):
        with suppress(SucreBenchError):  # the jobs of the last run cannot be read any more
            jobs += [job.of_all_views() for job in read_config(folder / CONFIG)]
    labels = {dataset for dataset, _, _ in wanted}
    jobs = [job for job in jobs if job.dataset.label in labels]
    with opening_once():
        for job in reversed(jobs):
            with suppress(SucreBenchError):  # its data cannot be opened
                of_job = {
                    _key(task.base): task for task in tasks(job, open_scenes(job.dataset))
                }
                opened |= {key: task for key, task in of_job.items() if key in wanted}
    views = _stored_views(opened, rows, jobs, lambda row: folders[_key(row)][row.method])
    complete = [view for key, view in views.items() if len(view.by_method) == len(folders[key])]
    return results.frame(
        row for view in progress.track(complete, "common pixels") for row in view.rows()
    )
