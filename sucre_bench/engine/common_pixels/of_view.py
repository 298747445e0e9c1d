"""Scores of one view on the pixels that all methods fill, from the pictures and masks of its restorations."""

from __future__ import annotations

import json
import math
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Protocol, TypeVar

import numpy as np

from sucre_bench.arrays import DataFrame, Mask, Picture
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.errors import InputError, one_line, raise_if_stop
from sucre_bench.imaging.once import locked
from sucre_bench.jobs.metric_words import MetricChoice
from sucre_bench.machine.records import keep_traceback, now
from sucre_bench.results.common_scores import COMMON_PIXELS, LEAST_DIFFERENCE, CommonRow, Kind, ViewKey
from sucre_bench.results.layout import Place
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import mask_id, masked, stored_mask, stored_picture, stored_restoration
from sucre_bench.results.rows import Row, row_objects
from sucre_bench.scene import Restoration, View

Score = tuple[str, str, str, str]  # method, metric, variant, code
_R = TypeVar("_R", bound=Row)


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


@dataclass(frozen=True)
class PixelMetrics:
    """The requested metrics that score pixels.

    by_code: the metrics by name and code; log: keeps tracebacks; limit_s: how long a score may take.
    """

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
    scores: dict[Score, CommonRow] = field(default_factory=dict)

    def add(self, whole: Row, source: RestorationSource) -> None:
        """Add the restoration of a method. whole: its row."""
        self.whole[whole.method], self.sources[whole.method] = whole, source

    @property
    def may_differ(self) -> bool:
        """Whether several methods restored the view, one of them with holes."""
        return len(self.whole) > 1 and any(whole.coverage < 1 for whole in self.whole.values())

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


def of_views(rows: Iterable[_R], views: Container[ViewKey]) -> Iterator[tuple[ViewKey, _R]]:
    """Yield the rows of some views, each with the key of its view."""
    for row in rows:
        if (key := (row.dataset, row.scene, row.view)) in views:
            yield key, row


def add_scores(views: Mapping[ViewKey, CommonView], rows: DataFrame, metrics: PixelMetrics) -> None:
    """Add to each view the scores of its restorations on own pixels. rows: of the score table."""
    names = {name for name, _ in metrics.by_code}
    scores = rows[(rows["status"] == "ok") & (rows["region"] == "image") & rows["metric"].isin(names)]
    for key, row in of_views(row_objects(scores), views):
        if row.method in views[key].whole and metrics.of(row):
            views[key].own_rows.append(row)


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
        keep_traceback(metrics.log, f"{base.dataset} / {base.scene} / {base.view} / common pixels")
        reason = one_line(fault)
    unknown: Kind = "unknown"
    return [CommonRow.of(replace(base, variant=unknown, status="failed", reason=reason), "", list(view.whole))]


def _row_of_view(view: CommonView) -> Row:
    return replace(
        view.base, method="", options="{}", options_id="", metric=COMMON_PIXELS, unit="share", better="none", code="",
        value=math.nan, time=now(),
    )  # fmt: skip


def _scored(view: CommonView, metrics: PixelMetrics, base: Row) -> list[CommonRow]:
    common, differing = _common_mask(view)
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
    for method in view.whole:
        known = {key: row for key, row in view.scores.items() if is_same and key[0] == method}
        rows += known.values()  # also by metrics that this run does not ask for
        todo = [row for row in view.own_rows if row.method == method and score_of(row) not in known]
        if todo:
            rows += _scores(metrics, view, method, todo, common, pixels)
    return rows


def _of_kind(base: Row, kind: Kind) -> Row:
    return replace(base, variant=kind)


def _common_mask(view: CommonView) -> tuple[Mask, float]:
    """The pixels (H, W) that all methods fill, and the share of the image that only some of them fill."""
    common = some = None
    for method, whole in view.whole.items():
        if whole.coverage == 1:
            continue
        mask = view.sources[method].mask()
        if common is not None and common.shape != mask.shape:
            raise _other_size(f"the mask of {method}", mask, common)
        common = mask if common is None else common & mask
        some = mask if some is None else some | mask
    if common is None or some is None:
        raise AssertionError("a view without holes is no candidate")
    is_filled = any(whole.coverage == 1 for whole in view.whole.values())
    return common, float((1.0 if is_filled else some.mean()) - common.mean())


def _scores(
    metrics: PixelMetrics, view: CommonView, method: str, own_rows: Sequence[Row], common: Mask, pixels: str
) -> Iterator[CommonRow]:
    """Score a restored image on the common pixels, by the metrics and variants that it has on its own pixels."""
    source = view.sources[method]
    picture = source.picture()
    if picture.shape[:2] != common.shape:
        raise _other_size(f"the restored image of {method}", picture, common)
    shown = locked(masked(picture / np.float32(255), common))
    scored, started = Scored(source.restoration(common), shown, view.view), now()
    for row in own_rows:
        scorer, base = metrics.of(row), replace(row, time=started)
        for made in variant_rows(scorer.metric, scored, base, metrics.log, metrics.limit_s) if scorer else ():
            if made.region == "image":
                yield CommonRow.of(made, pixels)


def _other_size(what: str, found: Mask | Picture, expected: Mask) -> InputError:
    sizes = [f"{w}x{h}" for h, w in (found.shape[:2], expected.shape)]
    return InputError(f"is {sizes[0]}, others are {sizes[1]}", what, "run that method again with overwrite=always")
