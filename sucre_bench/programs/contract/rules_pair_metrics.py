"""Rules for metrics of pairs of restored views; those for all metrics are in rules_metrics.py."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.engine.score import scorers
from sucre_bench.engine.score_pairs import Entrant, pair_rows
from sucre_bench.errors import NotApplicableError
from sucre_bench.jobs.job import MetricChoice
from sucre_bench.multiview.common_points import SharedPoints
from sucre_bench.plugins.options import Choice
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Finding, Subject, breach, rule
from sucre_bench.programs.contract.made_scenes import HARD, least, submerged, wall
from sucre_bench.programs.contract.process_state import watched
from sucre_bench.programs.contract.rules_metrics import faults
from sucre_bench.restored_pair import RestoredPair, RestoredView
from sucre_bench.results.rows import Row
from sucre_bench.scene import Scene, Score, View


def _is_of_pairs(plugin: Plugin) -> bool:
    return plugin.is_of_pairs


def _restored(view: View, image: Array) -> RestoredView:
    """A view whose restoration, and picture, is an image (H, W, 3)."""
    return RestoredView(view, lambda: np.clip(image, 0, 1, dtype=np.float32), lambda: image.astype(np.float32))


def _rows(subject: Subject, scene: Scene, holes: float = 0.0) -> list[Row]:
    """The scores, by every variant, of a scene's images as restorations. holes: share of pixels without a colour."""
    drawn = np.random.default_rng(1)
    images = {
        view.name: np.where(drawn.random((*view.rgb.shape[:2], 1)) < holes, np.nan, view.rgb) for view in scene.views
    }
    choice = MetricChoice(Choice(subject.plugin, subject.plugin.name, subject.options), tuple(subject.plugin.variants))
    subject.make()
    bases = {view.name: Row(view=view.name) for view in scene.views}
    entrant = Entrant(bases, lambda name: _restored(scene[name], images[name]), scorers([choice]))
    return pair_rows(scene, [entrant])[0]


@rule("stays in its range, whatever the images", "metric", applies=_is_of_pairs)
def stays_in_range(subject: Subject) -> Iterator[Finding]:
    heard = set[str]()
    for name, rgb in HARD.items():
        yield from faults(subject, _rows(subject, wall(rgb), holes=0.3), name, heard)


@rule("gives no value where nothing has a colour", "metric", applies=_is_of_pairs)
def scores_no_holes(subject: Subject) -> Iterator[Finding]:
    rows = _rows(subject, wall(), holes=1.0)
    yield from faults(subject, rows, "all NaN")
    for row in rows:
        if row.status == "ok" and subject.plugin.better != "none" and not row.coverage:
            yield breach(f"{row.variant}: scores {row.value:g} of no pixel; yield NaN where there is none")


@rule("runs with no more than it says it needs", "metric", applies=_is_of_pairs)
def runs_with_least(subject: Subject) -> Iterator[Finding]:
    # Without depth and poses the engine finds no points that two views share.
    needs = subject.plugin.needs | {"depth", "poses"}
    rows = _rows(subject, least(submerged(), needs))
    yield from faults(subject, rows, f"views with {' and '.join(sorted(needs))}")
    if not any(row.status == "ok" for row in rows):
        yield breach(f"no variant gives a score there, {rows[0].reason}; add what it uses to needs=")


def _pair(scene: Scene, turned: bool = False) -> RestoredPair:
    """The two views of a scene, their images as restorations."""
    views = scene.views[::-1] if turned else scene.views
    shared = SharedPoints(views)
    points = shared.of(shared.overlaps()[0])
    assert points is not None
    here, there = (_restored(view, view.rgb) for view in views)
    return RestoredPair(here, there, points)


@rule("does not depend on which view is the first", "metric", applies=_is_of_pairs)
def is_symmetric(subject: Subject) -> Iterator[Finding]:
    metric = subject.make()
    for variant in subject.plugin.variants:
        one, other = (_scores(metric, _pair(submerged(), turned), variant) for turned in (False, True))
        if [score.region for score in one] != [score.region for score in other] or not all(map(_alike, one, other)):
            yield breach(f"{variant}: another score when the views change places; a pair has no order")


def _scores(metric: Any, pair: RestoredPair, variant: str) -> list[Score]:
    """The scores of a pair; none if the variant does not apply to it: other variants may."""
    try:
        return list(metric.score_pair(pair, variant))
    except NotApplicableError:
        return []


def _alike(one: Score, other: Score) -> bool:
    both_nan = math.isnan(one.value) and math.isnan(other.value)
    return both_nan or math.isclose(one.value, other.value, rel_tol=1e-4, abs_tol=1e-6)


@rule("gives the same twice, and leaves its input and the process as they were", "metric", applies=_is_of_pairs)
def leaves_all_as_it_was(subject: Subject) -> Iterator[Finding]:
    pair, metric = _pair(submerged()), subject.make()
    points = [pair.points.here, pair.points.there, pair.points.distance]
    planes = [*points, pair.here.view.rgb, pair.here.view.depth]  # what is restored is read-only
    kept = [plane.copy() for plane in planes]
    with watched() as changes:
        for variant in subject.plugin.variants:
            first, again = ([repr(score) for score in _scores(metric, pair, variant)] for _ in range(2))
            if first != again:
                yield breach(f"{variant}: another score the second time; seed what is random")
    yield from changes
    if any(not np.array_equal(now, was) for now, was in zip(planes, kept, strict=True)):
        yield breach("writes into what it is given; work on a copy")


@rule("scores images in linear light", "metric", applies=_is_of_pairs)
def bears_linear_images(subject: Subject) -> Iterator[Finding]:
    scene = submerged()
    views = [replace(view, encoding="linear") for view in scene.views]
    yield from faults(subject, _rows(subject, replace(scene, views=views)), "linear")
