"""Scores of one view on the pixels that all methods fill, from the pictures and masks of the results folder."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Mask
from sucre_bench.engine.score import Scored, Scorer, variant_rows
from sucre_bench.engine.tasks import Task
from sucre_bench.errors import InputError, one_line, raise_if_stop
from sucre_bench.imaging.once import locked
from sucre_bench.machine.log import keep_traceback, now
from sucre_bench.results.common_scores import COMMON_PIXELS, LEAST_DIFFERENCE, CommonRow, Kind
from sucre_bench.results.layout import log_path
from sucre_bench.results.masks import mask_id
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import Row
from sucre_bench.results.stored_pictures import masked, stored_mask, stored_picture, stored_restoration

__all__ = ["CommonView", "PixelMetrics", "Score", "rows_of", "score_of"]

Score = tuple[str, str, str, str]  # method, metric, variant, code


@dataclass(frozen=True)
class PixelMetrics:
    """The metrics of pixels that a run asks for.

    out: the results folder; by_code: the metrics by name and code; limit_s: how long a score may take.
    """

    out: Path
    by_code: Mapping[tuple[str, str], Scorer]
    limit_s: float | None = None

    def of(self, row: Row) -> Scorer | None:
        """The metric that made a score; None if the run asks for another version of it, or for other options."""
        return self.by_code.get((row.metric, row.code.partition(".")[2]))


@dataclass
class CommonView:
    """A view that several methods restored, one of them with holes.

    whole: the row of each method's restoration; own_rows: the scores on own pixels; before: what the folder holds
    of its common pixels; scores: the same of their scores, as far as these are of the restorations in `whole`.
    """

    task: Task
    whole: dict[str, Row] = field(default_factory=dict)
    own_rows: list[Row] = field(default_factory=list)
    before: CommonRow | None = None
    scores: dict[Score, CommonRow] = field(default_factory=dict)

    @property
    def is_done(self) -> bool:
        """Whether nothing has changed since the view's row was written, and no score is missing."""
        row = self.before
        if row is None or row.status == "failed" or json.loads(row.methods) != sorted(self.whole):
            return False
        is_newest = all(whole.time <= row.time for whole in self.whole.values())
        return is_newest and (
            row.variant != "common" or all(score_of(scored) in self.scores for scored in self.own_rows)
        )


def score_of(row: Row) -> Score:
    """What identifies a score within its view."""
    return row.method, row.metric, row.variant, row.code


def rows_of(view: CommonView, metrics: PixelMetrics) -> list[CommonRow]:
    """Score a view on its common pixels; the first row stands for the view. A fault becomes that row."""
    base = _row_of_view(view)
    try:
        return _scored(view, metrics, base)
    except InputError as fault:
        reason = one_line(fault)
    except BaseException as fault:
        raise_if_stop(fault)
        keep_traceback(log_path(metrics.out), f"{base.dataset} / {base.scene} / {base.view} / common pixels")
        reason = one_line(fault)
    unknown: Kind = "unknown"
    return [CommonRow.of(replace(base, variant=unknown, status="failed", reason=reason), "", list(view.whole))]


def _row_of_view(view: CommonView) -> Row:
    base = view.task.base
    return replace(
        base, method="", options="{}", options_id="", metric=COMMON_PIXELS, unit="share", better="none", code="",
        value=math.nan, time=now(),
    )  # fmt: skip


def _scored(view: CommonView, metrics: PixelMetrics, base: Row) -> list[CommonRow]:
    common, differing = _common_mask(metrics.out, view)
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
        rows += known.values()  # also by metrics that this run does not ask for
        todo = [row for row in view.own_rows if row.method == method and score_of(row) not in known]
        if todo:
            rows += _scores(metrics, view.task, whole, todo, common, pixels)
    return rows


def _of_kind(base: Row, kind: Kind) -> Row:
    return replace(base, variant=kind)


def _common_mask(out: Path, view: CommonView) -> tuple[Mask, float]:
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
    metrics: PixelMetrics, task: Task, whole: Row, own_rows: Sequence[Row], common: Mask, pixels: str
) -> Iterator[CommonRow]:
    """Score a stored picture on the common pixels, by the metrics and variants that it has on its own pixels."""
    picture = stored_picture(metrics.out, task.place, whole.method)
    if picture.shape[:2] != common.shape:
        sizes = [f"{w}x{h}" for h, w in (picture.shape[:2], common.shape)]
        path = task.place.restored(metrics.out, whole.method)
        raise InputError(f"{path}: is {sizes[0]}, expected {sizes[1]}; run {whole.method} again with overwrite=always")
    shown = locked(masked(picture / np.float32(255), common))
    restoration = stored_restoration(metrics.out, task.place, whole, common)
    scored, started = Scored(restoration, shown, task.view), now()
    for row in own_rows:
        scorer, base = metrics.of(row), replace(row, time=started)
        for made in variant_rows(scorer.metric, scored, base, log_path(metrics.out), metrics.limit_s) if scorer else ():
            if made.region == "image":
                yield CommonRow.of(made, pixels)
