"""Scores one restoration: a row for each score, and a skipped or failed row if a metric gives none.

The rows of what failed or was skipped are made here for methods and datasets, too. They have status and reason, a line
on stderr, and the traceback in the log.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, coloured, locked
from sucre_bench.errors import NotApplicableError, PluginError, one_line, raise_if_stop
from sucre_bench.imaging.chart_kinds import kind_id
from sucre_bench.imaging.colour_profiles import view_in_srgb
from sucre_bench.imaging.resizing import (
    Form,
    changed_picture,
    changed_restoration,
    split_variant,
)
from sucre_bench.machine import progress
from sucre_bench.machine.processes import step
from sucre_bench.machine.text_formats import keep_traceback, short_hash
from sucre_bench.plugins.options import Choice, source_hash
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import PictureOnly
from sucre_bench.results.rows import RESTORATION, Row, RowCode, Status, fingerprint
from sucre_bench.scene import Restoration, Score, View

_ROUNDED = 1e-6  # of a bound, or of 1 if that is more: what float32 may exceed it by


@dataclass(frozen=True)
class Scorer:
    """A metric that is made once for all views of a job, a `Metric` or a `PairMetric`."""

    plugin: Plugin
    variants: tuple[str, ...]
    metric: Any

    code: str
    """See `metric_code`."""

    log: Path | None = None
    """Keeps tracebacks."""

    limit_s: float | None = None
    """How long a score may take; None for no limit."""

    def scores(
        self, base: Row, on: str, score: Callable[..., Iterable[Score]], *scored: Any
    ) -> list[Score]:
        """Return what a function of the metric gives, which is called at a step of its own.

        base: what the rows say of metric, variant and method; on: the views, as the step names them.
        """
        at = f"metric '{base.metric}:{base.variant}' on {on} by method '{base.method}'"
        with step(at, self.limit_s):
            scores = list(score(*scored))
            for region, n in Counter(score.region for score in scores).items():
                if n > 1:  # a table can hold one
                    raise PluginError(
                        f"two scores of region '{region}'",
                        remedy="yield one score for each region",
                    )
            low, high = self.plugin.range
            for value in (float(one.value) for one in scores):
                # the bounds in float32
                if value < low - _ROUNDED * max(1, abs(low)) or value > high + _ROUNDED * max(
                    1, abs(high)
                ):
                    fault = f"{base.metric}:{base.variant} is {value:.9g}, its range {low:g} to {high:g}"
                    raise PluginError(fault, remedy="mend the metric or its range=")
        return scores


def scorers(
    metrics: Iterable[Choice], log: Path | None = None, limit_s: float | None = None
) -> tuple[Scorer, ...]:
    """Make the metrics. Raises InputError if an option is not acceptable. log, limit_s: see `Scorer`."""
    return tuple(
        Scorer(m.plugin, m.variants, m.make(), metric_code(m), log, limit_s) for m in metrics
    )


def score_rows(
    restoration: Restoration,
    shown: Array,
    view: View,
    metrics: Iterable[Scorer],
    base: Row,
) -> list[Row]:
    """Return the rows of a restoration: what it took, then every score.

    restoration: in sRGB, see `colour_profiles`; shown: the restored image; base: what the rows say of view, method,
    options, code, data, seconds and memory.
    """
    valid = restoration.valid
    base = replace(
        base,
        device=str(restoration.info.get("device", "cpu")),
        n_pixels=int(np.count_nonzero(valid)),
        coverage=float(valid.mean()),
    )
    del valid
    took = (("seconds", "wall", "s", base.seconds), ("peak_mb", "resident", "MB", base.peak_mb))
    rows = [
        replace(base, metric=name, variant=variant, unit=unit, better="lower", value=value)
        for name, variant, unit, value in took
    ]
    # What this view offers to a metric; the scene may offer it in other views only.
    offers = {
        "depth": view.has_depth,
        "poses": view.cam_from_world is not None,
        "reference": view.reference is not None,
        "charts": bool(view.charts),
        "truth": "true_water" in restoration.info,
        "restoration": True,
    }
    offered = frozenset(name for name, is_there in offers.items() if is_there)
    scored = Scored(
        replace(restoration, image=locked(restoration.image)), locked(shown), view_in_srgb(view)
    )
    for scorer in metrics:
        plugin = scorer.plugin
        code = score_code(base, scorer.code, charts_id(plugin, [view]))
        of_metric = replace(base, metric=plugin.name, unit=plugin.unit, code=code)
        absent = plugins.missing_needs(plugin, offered, "view")
        for variant in scorer.variants:
            row = replace(of_metric, variant=variant, better=plugin.better_of(variant))
            if absent:
                rows.append(row_without_value(row, "skipped", absent))
            else:
                rows += variant_rows(scorer, scored, row)
    return rows


@dataclass(frozen=True, eq=False)
class Scored:
    """What is scored. Its arrays are read-only, so that no metric alters what the next one gets."""

    restoration: Restoration
    shown: Array
    view: View
    forms: dict[Form, Scored] = field(default_factory=dict)

    @functools.cached_property
    def share(self) -> float:
        """The share of pixels that have a colour."""
        return float(coloured(self.shown).mean())

    def at(self, form: Form) -> Scored:
        """Return the same in another form: at another size, say."""
        if form not in self.forms:
            shown, view = changed_picture(self.shown, self.view, form)
            if isinstance(self.restoration, PictureOnly):
                restoration: Restoration = self.restoration.at_size(shown.shape[:2])
            else:
                restoration = changed_restoration(self.restoration, self.view.encoding, form)
            self.forms[form] = Scored(restoration, shown, view)
        return self.forms[form]


def metric_code(metric: Choice) -> str:
    """Return what a metric's scores rest on beside the restoration: a hash of its source, and one of its options."""
    options = f"-{fingerprint(metric.options)[1]}" if metric.options else ""
    return f"{source_hash(metric.plugin)}{options}"


def score_code(base: Row, metric: str, seen: str = "") -> str:
    """Return the `code` of a score's row. base: of the restoration; metric, seen: see `RowCode`."""
    return str(RowCode(RowCode.read(base.code).restoration, metric, seen))


def charts_id(plugin: Plugin, views: Iterable[View]) -> str:
    """Return a hash of the charts of views; "" for a plugin that does not look at charts, and where there are none."""
    if "charts" not in plugin.needs | plugin.may_need:
        return ""
    charts = [
        (view.name, c.name, kind_id(c.kind), c.corners.tolist())
        for view in views
        for c in view.charts
    ]
    return short_hash(repr(charts)) if charts else ""


def variant_rows(scorer: Scorer, scored: Scored, base: Row) -> list[Row]:
    """Return the rows of one metric in one variant; a row with the reason if there is no score.

    base: what the rows say of view, method, metric and variant.
    """
    try:
        variant, form = split_variant(base.variant)
        of = scored.at(form) if form else scored
        share = scored.share if form else 1.0  # in another form holes are black pixels
        what = (of.restoration, of.shown, of.view, variant)
        rows = [
            replace(
                base,
                value=float(s.value),
                region=s.region,
                n_pixels=int(s.n_pixels),
                coverage=s.coverage * share,
            )
            for s in scorer.scores(base, f"view '{base.view}'", scorer.metric.score, *what)
        ]
    except BaseException as fault:
        return [row_of_fault(base, fault, scorer.log)]
    rows = [
        row_without_value(row, "skipped", Reason.NO_VALUE.value)
        if math.isnan(row.value)
        else row
        for row in rows
    ]
    return rows or [row_without_value(base, "skipped", Reason.NOTHING_TO_SCORE.value)]


def needs_unrounded(scorer: Scorer, picture: Restoration, view: View) -> bool:
    """Return whether scores change with the restoration while the restored image stays, or the metric fails.

    A bundle has only the restored image. picture: its image is that.
    """
    one, two = (
        score_rows(replace(picture, image=image), picture.image, view, [scorer], Row())
        for image in (picture.image, picture.image - np.float32(0.5))
    )
    if len(one) != len(two) or any(row.status == "failed" for row in one + two):
        return True
    first, second = ([row.value for row in rows] for rows in (one, two))
    return not np.allclose(first, second, rtol=1e-9, atol=0, equal_nan=True)


def row_without_value(base: Row, status: Status, reason: str) -> Row:
    """Return a row that says why there is no value."""
    return replace(base, value=math.nan, coverage=0.0, status=status, reason=reason)


def row_of_fault(
    base: Row, fault: BaseException, log: Path | None, is_said: bool = False
) -> Row:
    """Return the row for a fault that is being handled: skipped for NotApplicableError, or else failed.

    The traceback of a failure goes to `log`; is_said: print it as a line, too. A request to stop is raised again.
    """
    if isinstance(fault, NotApplicableError):
        return row_without_value(base, "skipped", one_line(fault))
    raise_if_stop(fault)
    metric = "" if base.metric == RESTORATION else f"{base.metric}:{base.variant}"
    where = " / ".join(filter(None, (base.dataset, base.scene, base.view, base.method, metric)))
    reason = one_line(fault)
    keep_traceback(log, where)
    if is_said:
        progress.say(f"failed  {where}: {reason}", is_fault=True)
    return row_without_value(base, "failed", reason)
