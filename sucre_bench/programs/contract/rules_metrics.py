"""Rules for metrics: values in their range, none without anything to score, the best for a perfect result."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.engine.score import score_rows, scorers
from sucre_bench.imaging.display import display
from sucre_bench.imaging.once import locked
from sucre_bench.jobs.job import MetricChoice
from sucre_bench.plugins.options import Choice
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Finding, Subject, breach, note, rule
from sucre_bench.programs.contract.made_scenes import HARD, TARGET, WATER, charted, least, wall
from sucre_bench.programs.contract.process_state import watched
from sucre_bench.results.restorations import Measured
from sucre_bench.results.rows import Row
from sucre_bench.scene import Chart, Restoration, View, Water

_JUDGED = frozenset({"reference", "charts", "truth"})  # needs that define a perfect restoration


def _is_of_one_view(plugin: Plugin) -> bool:
    """Metrics of pairs have rules of their own, rules_pair_metrics.py."""
    return not plugin.is_of_pairs


def _rows(subject: Subject, image: Array, view: View, water: Water | None = WATER) -> list[Row]:
    """The scores of an image (H, W, 3) by every variant, as the engine stores them."""
    subject.make()
    choice = Choice(subject.plugin, subject.plugin.name, subject.options)
    restoration = Restoration(image, water, info={"true_water": WATER} if "truth" in subject.plugin.needs else {})
    measured = Measured(restoration, 0.0, 0.0)
    rows = score_rows(
        measured,
        display(image, "none", view.encoding),
        view,
        scorers([MetricChoice(choice, tuple(subject.plugin.variants))]),
        Row(),
    )
    return [row for row in rows if row.metric == subject.plugin.name]


def faults(subject: Subject, rows: list[Row], where: str, heard: set[str] | None = None) -> Iterator[Finding]:
    """Yield the faults of rows. heard: faults already reported, which are not repeated; new ones are added."""
    low, high = subject.plugin.range
    heard = set() if heard is None else heard
    for row in rows:
        at = f"{where}, {row.variant}"
        if row.status == "failed":
            if row.reason not in heard:
                yield breach(f"{at}: {row.reason.split('; ')[0]}; {_remedy(row.reason)}")
            heard.add(row.reason)
        elif row.status == "ok" and not low <= row.value <= high:
            yield breach(f"{at}: {row.region} scores {row.value:g}, not in {low:g} to {high:g}; correct it, or range=")
        elif row.status == "ok" and not (0 <= row.coverage <= 1 and row.n_pixels >= 0):
            yield breach(f"{at}: {row.region} has coverage {row.coverage:g}; it is a share of the region's pixels")
    if silent := sorted(set(subject.plugin.variants) - {row.variant for row in rows}):
        yield breach(f"{where}: no score and no reason of {', '.join(silent)}; every variant of variants= is computed")


def _remedy(reason: str) -> str:
    if "read-only" in reason:
        return "work on a copy"
    if "not iterable" in reason:
        return "score() yields each Score, it does not return one"
    return "mend it; where there is nothing to score, yield nothing"


@rule("stays in its range, whatever the image", "metric", applies=_is_of_one_view)
def stays_in_range(subject: Subject) -> Iterator[Finding]:
    chart, heard = Chart("c", "dgk", np.array([[2.0, 2], [60, 2], [60, 44], [2, 44]])), set[str]()
    for name, rgb in HARD.items():
        holes = np.random.default_rng(1).random((*rgb.shape[:2], 1)) < 0.3
        view = wall(rgb, charts=[chart])[TARGET]
        yield from faults(subject, _rows(subject, np.where(holes, np.nan, rgb).astype(np.float32), view), name, heard)


@rule(
    "gives no value where nothing has a colour", "metric", applies=lambda p: p.better != "none" and _is_of_one_view(p)
)
def scores_no_holes(subject: Subject) -> Iterator[Finding]:
    view = charted()[TARGET]
    rows = _rows(subject, np.full_like(view.rgb, np.nan), view, water=None)
    yield from faults(subject, rows, "all NaN")
    for row in rows:
        if row.status == "ok" and not (row.n_pixels and row.coverage):
            yield breach(f"{row.variant}: scores {row.value:g} of no pixel; yield NaN where there is none")


@rule("runs with no more than it says it needs", "metric", applies=_is_of_one_view)
def runs_with_least(subject: Subject) -> Iterator[Finding]:
    scene = least(charted(), subject.plugin.needs, cameras="depth" in subject.plugin.needs)
    rows = _rows(subject, scene[TARGET].rgb, scene[TARGET])
    yield from faults(subject, rows, f"a view with {' and '.join(sorted(subject.plugin.needs)) or 'an image'}")
    is_of_a_method = "restoration" in subject.plugin.needs  # what that told of its work is not here
    if not is_of_a_method and not any(row.status == "ok" for row in rows):
        yield breach(f"no variant gives a score there, {rows[0].reason}; add what it uses to needs=")


def _is_judged(plugin: Plugin) -> bool:
    return plugin.better != "none" and bool(plugin.needs & _JUDGED) and _is_of_one_view(plugin)


@rule("says truly which direction is better", "metric", applies=_is_judged)
def prefers_the_truth(subject: Subject) -> Iterator[Finding]:
    """Compare known answers: the reference with itself plus a cast, the true water with another."""
    view = charted()[TARGET]
    reference = np.asarray(view.reference)
    cast = reference * np.array([0.3, 0.8, 1]) + 0.1 * np.random.default_rng(2).random(reference.shape)
    wrong = Water(WATER.veiling_light * 1.5, WATER.attenuation * 1.5, WATER.backscatter * 1.5)
    perfect = _values(subject, _rows(subject, reference, view))
    spoilt = _values(subject, _rows(subject, cast.astype(np.float32), view, wrong))
    sign = 1 if subject.plugin.better == "higher" else -1
    for (variant, region), best in perfect.items():
        worse = spoilt.get((variant, region), math.nan)
        if sign * best <= sign * worse:
            yield breach(f"{variant}: {region} scores {best:g} when perfect, {worse:g} when spoilt; see better=")
    if not perfect:
        yield breach("gives no score for a perfect result; it must have one where all is known")
    else:
        yield note(f"{next(iter(perfect.values())):g} for a perfect result")


def _values(subject: Subject, rows: list[Row]) -> dict[tuple[str, str], float]:
    """Scores of the image and of charts, not of patches, which may be better by chance."""
    return {(row.variant, row.region): row.value for row in rows if row.status == "ok" and "/" not in row.region}


@rule("gives the same twice, and leaves its input and the process as they were", "metric", applies=_is_of_one_view)
def leaves_all_as_it_was(subject: Subject) -> Iterator[Finding]:
    view = charted()[TARGET]
    image = view.rgb.copy()
    shown = display(image, "none")
    restoration = Restoration(image, WATER, info={"true_water": WATER})
    planes = [image, shown, *(np.asarray(p) for p in (view.rgb, view.depth, view.reference))]
    kept, metric, shared = [plane.copy() for plane in planes], subject.make(), locked(shown)
    with watched() as changes:
        for variant in subject.plugin.variants:
            # Of a read-only picture metrics may remember what they compute, see `imaging.once`.
            pictures = (shown, shared, shared)
            given = [[repr(s) for s in metric.score(restoration, picture, view, variant)] for picture in pictures]
            if given[1:] != given[:-1]:
                yield breach(f"{variant}: another score the second time; seed what is random")
    yield from changes
    if any(not np.array_equal(now, was, equal_nan=True) for now, was in zip(planes, kept, strict=True)):
        yield breach("writes into what it is given; work on a copy")


@rule("scores images in linear light", "metric", applies=_is_of_one_view)
def bears_linear_images(subject: Subject) -> Iterator[Finding]:
    view = replace(charted()[TARGET], encoding="linear")
    yield from faults(subject, _rows(subject, view.rgb, view), "linear")
