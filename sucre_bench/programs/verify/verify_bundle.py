"""Verifies a bundle: hashes first, then every score that can be computed again."""

import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Pixels
from sucre_bench.engine.score import Scorer
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError
from sucre_bench.machine import progress
from sucre_bench.plugins.call_method import with_truth
from sucre_bench.programs.verify import TOLERANCE
from sucre_bench.programs.verify.common_pixels import (
    LOOK_ALIKE,
    NO_PICTURES,
    BundledView,
    common_views,
    found_mask,
    on_mask,
    why_unused,
)
from sucre_bench.programs.verify.metrics import Metrics
from sucre_bench.programs.verify.open_data import Opened, open_data
from sucre_bench.programs.verify.pictures import Held, Restored, held, picture, restoration_of
from sucre_bench.programs.verify.tolerance import Key, Pictured, agrees, computed
from sucre_bench.results.bundle_format import COMMON, SCORES, Bundle
from sucre_bench.results.common_scores import common_frame
from sucre_bench.results.reasons import Reason, brief
from sucre_bench.results.rows import COSTS, KEYS, Row, restorations
from sucre_bench.scene import Arrays, Restoration, Scene, View


@dataclass(frozen=True)
class DifferingScore:
    """A score that another value comes out for."""

    dataset: str
    method: str
    scene: str
    view: str
    metric: str
    variant: str
    region: str
    pixels: Pixels
    stored: float
    computed: float


@dataclass
class Outcome:
    """What became of a bundle's check.

    id, by: see `Bundle`; n_files: number of checked hashes; faults: faults of files, data, pictures or units, one line
    each; differing: scores that differ; n_agree: number of scores that were computed again and agree; n_common: how
    many of these are on common pixels; unchecked: scores that were not computed again, by reason; needs_data: whether
    some of them need the data; other_versions: metrics whose code here is not the code that made the scores.
    """

    id: str
    by: str
    n_files: int
    faults: list[str] = field(default_factory=list)
    differing: list[DifferingScore] = field(default_factory=list)
    n_agree: int = 0
    n_common: int = 0
    unchecked: dict[str, int] = field(default_factory=Counter)
    needs_data: bool = False
    other_versions: list[str] = field(default_factory=list)

    @property
    def n_scores(self) -> int:
        """How many scores the bundle has; seconds and memory are none."""
        return self.n_agree + len(self.differing) + sum(self.unchecked.values())

    @property
    def is_whole(self) -> bool:
        """Whether every score was computed again and agrees."""
        return 0 < self.n_agree == self.n_scores

    @property
    def holds(self) -> bool:
        """Whether nothing differs."""
        return not self.faults and not self.differing


def verify(bundle: Bundle, data: Mapping[str, Path] | None = None, tolerance: float = TOLERANCE) -> Outcome:
    """Check a bundle. data: folders of the data, by dataset label; tolerance: allowed difference as share of a score.

    Raises InputError if the bundle has no score table.
    """
    rows = bundle.rows
    names = sorted(set(bundle.inside) | set(bundle.entries) - {"bundle.json"})
    file_faults = {name: fault for name in progress.track(names, "hashes") if (fault := bundle.fault_of(name))}
    common = _common(bundle, file_faults)
    opened = open_data(rows, data or {})
    outcome = Outcome(bundle.id, bundle.by, len(names), [f"{name}: {fault}" for name, fault in file_faults.items()])
    outcome.faults += [*opened.faults, *_wrong_meaning(SCORES, rows), *_wrong_meaning(COMMON, common)]
    check = _Check(bundle, opened, tolerance, rows, outcome)
    for of_restoration in progress.track(list(_by_restoration(rows)), "scoring again"):
        check.restoration(of_restoration)
    n_own = outcome.n_agree
    for of_view in progress.track(list(common_views(common, rows)), "scoring common pixels again"):
        check.view(of_view)
    outcome.n_common = outcome.n_agree - n_own
    outcome.unchecked = dict(sorted(outcome.unchecked.items(), key=lambda item: -item[1]))
    outcome.other_versions.sort()
    return outcome


def _common(bundle: Bundle, file_faults: dict[str, str]) -> DataFrame:
    """The scores on common pixels; no rows if there are none, or the table is damaged: then `file_faults` says so."""
    try:
        common = bundle.common
    except InputError as fault:
        common = None
        file_faults.setdefault(COMMON, fault.beside(bundle.path / COMMON))
    return common_frame([]) if common is None else common


def _by_restoration(rows: DataFrame) -> Iterator[DataFrame]:
    """The rows of each restoration that ended well: first the one that stands for it, then its scores."""
    whole = restorations(rows).index
    is_score = (rows["status"] == "ok") & ~rows["metric"].isin(COSTS)
    for _, of_restoration in rows[is_score | rows.index.isin(whole)].groupby(list(KEYS), sort=False):
        yield of_restoration


def _wrong_meaning(file: str, rows: DataFrame) -> Iterator[str]:
    """Metrics of which a table of the bundle says another unit or direction than they have."""
    known = plugins.usable("metric")
    once = rows[~rows["metric"].isin(COSTS)].drop_duplicates(["metric", "unit", "better"])
    for row in once.itertuples():
        plugin = known.get(row.metric)
        if plugin and (row.unit, row.better) != (plugin.unit, plugin.better):
            said, meant = f"'{row.unit}', {row.better} is better", f"'{plugin.unit}', {plugin.better}"
            yield f"{file}: {row.metric} in {said}; it is {meant}"


class _Check:
    """Scores restorations one after the other, and writes into an outcome what comes out."""

    def __init__(self, bundle: Bundle, opened: Opened, tolerance: float, rows: DataFrame, outcome: Outcome) -> None:
        self._bundle, self._opened, self._tolerance, self._outcome = bundle, opened, tolerance, outcome
        self._metrics = Metrics(bundle)
        scores = rows[(rows["status"] == "ok") & np.isfinite(rows["value"])]
        sizes = scores["value"].abs().groupby([scores["metric"], scores["variant"]]).median()
        # The median size of a column's scores: what a difference near zero is compared with.
        self._sizes = {(str(m), str(v)): float(size) for (m, v), size in sizes.items()}

    def restoration(self, rows: DataFrame) -> None:
        """Score a restoration again. rows: see `_by_restoration`."""
        whole, scores = restorations(rows), rows[~rows["metric"].isin(COSTS)]
        if whole.empty:
            self._outcome.faults.append(f"{_where(rows.iloc[0])}: has scores, but no row of the restoration")
            return
        row = next(whole.itertuples())
        try:
            names = held(self._bundle, row)
            if names is None:
                self._outcome.unchecked[NO_PICTURES] += len(scores)
            else:
                self._score(row, scores, names, restoration_of(self._bundle, names, int(row.n_pixels)))
        except ANY_FAULT as fault:  # whatever a stranger's file makes fail is a fault of that file
            self._add_fault(_where(rows.iloc[0]), fault)
            self._outcome.unchecked["the picture cannot be used"] += len(scores)

    def view(self, view: BundledView) -> None:
        """Find the common pixels of a view again, and score all methods on them again."""
        scores = view.scores[(view.scores["status"] == "ok") & view.scores["method"].isin(view.whole.keys())]
        try:
            why = why_unused(view)
            pixels = None if why else found_mask(self._bundle, view)
            if pixels is None:
                self._outcome.unchecked[why or NO_PICTURES] += len(scores)
                return
            for method, of_method in scores.groupby("method", sort=False):
                row = view.whole[str(method)]
                names = held(self._bundle, row)
                assert names is not None  # else there is no mask
                kept = restoration_of(self._bundle, names, int(row.n_pixels))
                self._score(row, of_method, names, on_mask(kept, *pixels))
        except ANY_FAULT as fault:  # as above
            self._add_fault(view.where, fault)
            self._outcome.unchecked["the common pixels cannot be found again"] += len(scores)

    def _add_fault(self, where: str, fault: BaseException) -> None:
        text = fault.beside(self._bundle.path) if isinstance(fault, SucreBenchError) else str(fault)
        self._outcome.faults.append(f"{where}: {text}")

    def _score(self, row: Any, scores: DataFrame, names: Held, kept: Restored) -> None:
        """Compute scores again, and judge each. row: of the restoration; kept: the same, or its common pixels."""
        scene = self._opened.scenes.get((row.dataset, row.scene))
        view = self._view(row, names, scene, kept.restoration)
        restoration = with_truth(kept.restoration, scene, view) if scene else kept.restoration
        asked = scores[["metric", "variant", "code"]].itertuples(index=False)
        chosen = {(metric, variant): self._metrics.of(metric, variant, code) for metric, variant, code in asked}
        pictured = Pictured(restoration, view)
        found = computed(restoration, view, [one for one in chosen.values() if isinstance(one, Scorer)])
        for score in scores.itertuples():
            scorer = chosen[score.metric, score.variant]
            doubt = "" if kept.is_sure else LOOK_ALIKE
            is_inexact = scene is None and isinstance(scorer, Scorer) and "reference" in scorer.plugin.needs
            if is_inexact:
                doubt = f"{score.metric} needs the exact reference of the data"  # the bundle has it as a JPEG
            self._judge(score, scorer, found, pictured, doubt, is_inexact)

    def _view(self, row: Any, names: Held, scene: Scene | None, restoration: Restoration) -> View:
        """The view from the data, or else from the bundle's pictures, as far as they go."""
        if scene is not None:
            view = scene[row.view]
            if view.rgb.shape != restoration.image.shape:
                raise InputError(f"{names.restored}: is not of the size of its view; ask who made the bundle")
            return view
        pixels = picture(self._bundle, names.view) if names.view else np.zeros_like(restoration.image)
        reference = picture(self._bundle, names.reference) if names.reference else None
        return View(row.view, Arrays(pixels, reference=reference))

    def _judge(
        self,
        score: Any,
        scorer: Scorer | str,
        found: Mapping[Key, Row],
        pictured: Pictured,
        doubt: str,
        is_inexact: bool,
    ) -> None:
        """Count a score as agreeing, differing or not checked.

        doubt: why a difference would prove nothing; is_inexact: the reason is that the data are not there.
        """
        outcome, again = self._outcome, found.get((score.metric, score.variant, score.region))
        if isinstance(scorer, str):
            outcome.unchecked[scorer] += 1
            return
        does_agree = again is not None and self._agrees(score, again, scorer, pictured)
        if again is None or not (again.status == "ok" or does_agree):  # nothing comes out now
            alone = again or found.get((score.metric, score.variant, "image"))
            if alone is not None and alone.status == "skipped" and Reason.of(alone.reason) is Reason.LACK:
                outcome.unchecked[f"{score.metric} {brief(alone.reason)} of the data"] += 1
                outcome.needs_data = True
            else:
                outcome.differing.append(_differing(score, math.nan))
        elif self._metrics.rests_on_unrounded(scorer, again, pictured.restoration, pictured.view):
            outcome.unchecked[f"{score.metric} needs the restoration before it was rounded"] += 1
        elif doubt and not does_agree:
            outcome.unchecked[doubt] += 1
            outcome.needs_data |= is_inexact
        else:
            if score.code.partition(".")[2] != scorer.code and score.metric not in outcome.other_versions:
                outcome.other_versions.append(score.metric)
            if does_agree:
                outcome.n_agree += 1
            else:
                outcome.differing.append(_differing(score, again.value))

    def _agrees(self, score: Any, again: Row, scorer: Scorer, pictured: Pictured) -> bool:
        """Whether a score is as it comes out again, as far as pictures of 8 bits can tell."""
        size = self._sizes.get((score.metric, score.variant), 0.0)
        if again.status == "ok" and agrees(score.value, again.value, scorer.plugin, size, self._tolerance):
            return True
        reach = pictured.reach(scorer, (score.metric, score.variant, score.region), again.value)
        if not math.isfinite(reach):
            return True
        return agrees(score.value, again.value, scorer.plugin, size, self._tolerance, reach)


def _differing(score: Any, value: float) -> DifferingScore:
    return DifferingScore(
        score.dataset,
        score.method,
        score.scene,
        score.view,
        score.metric,
        score.variant,
        score.region,
        "common" if hasattr(score, "pixels") else "own",
        float(score.value),
        value,
    )


def _where(row: Any) -> str:
    return f"{row['dataset']} / {row['method']} / {row['view']}"
