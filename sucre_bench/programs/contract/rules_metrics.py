"""Rules for metrics: values in their range, none without anything to score, the best for a perfect result.

A metric scores one restored view, or pairs of them. `_rows` tries either kind on a scene.
"""

import math

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.engine.across_views import Entrant, pair_rows
from sucre_bench.engine.score import score_rows, scorers
from sucre_bench.imaging.display import display
from sucre_bench.plugins.options import Choice
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.contract.contract import Lines, Rule, Subject
from sucre_bench.programs.contract.made_scenes import (
    HARD,
    TARGET,
    WATER,
    charted,
    least,
    submerged,
    wall,
)
from sucre_bench.restored_pair import RestoredView
from sucre_bench.results.rows import Row
from sucre_bench.scene import Chart, Restoration, Scene, View, Water


def rules(plugin: Plugin) -> list[Rule]:
    """Return the rules for a metric, of one view or of pairs."""
    is_ordered = plugin.better != "none"
    of_holes = [scores_no_holes] if is_ordered or plugin.is_of_pairs else []
    knows_what_is_perfect = bool(plugin.needs & {"reference", "charts", "truth"})
    of_order = [prefers_the_truth] if is_ordered and knows_what_is_perfect else []
    return [stays_in_range, *of_holes, runs_with_least, *of_order, gives_the_same_twice]


def _rows(
    subject: Subject, scene: Scene, holes: float = 0.0, water: Water | None = WATER
) -> list[Row]:
    """The scores of a scene's images as restorations, by every variant. holes: share of pixels without a colour."""
    drawn = np.random.default_rng(1)
    images = {
        view.name: np.where(
            drawn.random((*view.rgb.shape[:2], 1)) < holes, np.float32(np.nan), view.rgb
        )
        for view in scene
    }
    if not subject.plugin.is_of_pairs:
        return _rows_of(subject, images[TARGET], scene[TARGET], water)
    bases = {name: Row(view=name) for name in images}
    entrant = Entrant(
        bases, lambda name: _restored(scene[name], images[name]), scorers([_choice(subject)])
    )
    return pair_rows(scene, [entrant])[0]


def _rows_of(
    subject: Subject, image: Array, view: View, water: Water | None = WATER
) -> list[Row]:
    """The scores of an image (H, W, 3) by every variant, as the engine stores them."""
    restoration = Restoration(
        image, water, info={"true_water": WATER} if "truth" in subject.plugin.needs else {}
    )
    shown = display(image, "none", view.encoding)
    rows = score_rows(restoration, shown, view, scorers([_choice(subject)]), Row())
    return [row for row in rows if row.metric == subject.plugin.name]


def _choice(subject: Subject) -> Choice:
    subject.make()
    plugin = subject.plugin
    return Choice(plugin, plugin.name, subject.options, variants=tuple(plugin.variants))


def _restored(view: View, image: Array) -> RestoredView:
    """A view whose restoration, and picture, is an image (H, W, 3)."""
    return RestoredView(
        view, lambda: np.clip(image, 0, 1, dtype=np.float32), lambda: image.astype(np.float32)
    )


def _faults(subject: Subject, rows: list[Row], where: str, heard: set[str]) -> Lines:
    """Yield the faults of rows. heard: faults already reported, which are not repeated; new ones are added."""
    low, high = subject.plugin.range
    for row in rows:
        at = f"{where}, {row.variant}"
        if row.status == "failed" and row.reason not in heard:
            heard.add(row.reason)
            remedy = "mend it; where there is nothing to score, yield nothing"
            yield f"{at}: {row.reason.split('; ')[0]}; {remedy}"
        elif row.status == "ok" and not low <= row.value <= high:
            yield f"{at}: {row.region} scores {row.value:g}, not in {low:g} to {high:g}; correct it, or range="
        elif row.status == "ok" and not (0 <= row.coverage <= 1 and row.n_pixels >= 0):
            yield f"{at}: {row.region} has coverage {row.coverage:g}; it is a share of the region's pixels"
    if silent := sorted(set(subject.plugin.variants) - {row.variant for row in rows}):
        yield f"{where}: no score and no reason of {', '.join(silent)}; every variant of variants= is computed"


def stays_in_range(subject: Subject) -> Lines:
    """Stays in its range on difficult images."""
    chart = Chart("c", "dgk", np.array([[2.0, 2], [60, 2], [60, 44], [2, 44]]))
    heard = set[str]()
    for name, rgb in HARD.items():
        yield from _faults(
            subject, _rows(subject, wall(rgb, charts=[chart]), holes=0.3), name, heard
        )


def scores_no_holes(subject: Subject) -> Lines:
    """Gives no value where nothing has a colour."""
    rows = _rows(subject, charted(), holes=1.0, water=None)
    yield from _faults(subject, rows, "all NaN", set())
    for row in rows:
        if (
            row.status == "ok"
            and subject.plugin.better != "none"
            and not (row.n_pixels and row.coverage)
        ):
            yield f"{row.variant}: scores {row.value:g} of no pixel; yield NaN where there is none"


def runs_with_least(subject: Subject) -> Lines:
    """Runs with no more than it declares in needs=."""
    # Without depth and poses the engine finds no points that two views share.
    needs = subject.plugin.needs | ({"depth", "poses"} if subject.plugin.is_of_pairs else set())
    scene = submerged() if subject.plugin.is_of_pairs else charted()
    rows = _rows(subject, least(scene, needs, cameras="depth" in needs))
    noun = "restored views" if subject.plugin.is_of_pairs else "a view"
    has = " and ".join(sorted(needs - {"restored_views"})) or "an image"
    yield from _faults(subject, rows, f"{noun} with {has}", set())
    # a made picture has no notes of a method
    if "restoration" not in needs and not any(row.status == "ok" for row in rows):
        yield f"no variant gives a score there, {rows[0].reason}; add what it uses to needs="


def prefers_the_truth(subject: Subject) -> Lines:
    """Declares the better direction.

    Compare known answers: the reference with itself plus a cast, the true water with another.
    """
    view = charted()[TARGET]
    reference = np.asarray(view.reference)
    cast = reference * np.array([0.3, 0.8, 1]) + 0.1 * np.random.default_rng(2).random(
        reference.shape
    )
    wrong = Water(WATER.veiling_light * 1.5, WATER.attenuation * 1.5, WATER.backscatter * 1.5)
    tried = (
        _rows_of(subject, reference, view),
        _rows_of(subject, cast.astype(np.float32), view, wrong),
    )
    # Of the image and of charts, not of patches, which may be better by chance.
    perfect, spoilt = (
        {
            (row.variant, row.region): row.value
            for row in rows
            if row.status == "ok" and "/" not in row.region
        }
        for rows in tried
    )
    sign = 1 if subject.plugin.better == "higher" else -1
    for (variant, region), best in perfect.items():
        worse = spoilt.get((variant, region), math.nan)
        if sign * best <= sign * worse:
            yield f"{variant}: {region} scores {best:g} when perfect, {worse:g} when spoilt; see better="
    if not perfect:
        yield "gives no score for a perfect result; it must have one where all is known"


def gives_the_same_twice(subject: Subject) -> Lines:
    """Gives the same score twice."""
    scene = submerged() if subject.plugin.is_of_pairs else charted()
    first, second = (
        {(row.variant, row.region, repr(row.value)) for row in _rows(subject, scene)}
        for _ in range(2)
    )
    for variant in sorted({variant for variant, *_ in first ^ second}):
        yield f"{variant}: another score the second time; seed what is random"
