"""Verifies a bundle: hashes first, then every score that can be computed again."""

import contextlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, DataFrame, Mask
from sucre_bench.compare import Pixels
from sucre_bench.engine.score import Scorer
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError
from sucre_bench.imaging.image_files import decode_bytes, size_of_bytes
from sucre_bench.machine import progress
from sucre_bench.plugins.call_method import with_truth
from sucre_bench.programs.verify import TOLERANCE
from sucre_bench.programs.verify.open_data import Scenes, open_data
from sucre_bench.programs.verify.score_again import Pictured, metrics_of
from sucre_bench.results.bundle_format import COMMON, LIMITS, SCORES, Bundle
from sucre_bench.results.common_scores import COMMON_PIXELS, common_frame, common_pixels, filled_restorations
from sucre_bench.results.layout import possible_places
from sucre_bench.results.reasons import Reason, brief
from sucre_bench.results.restorations import masked
from sucre_bench.results.rows import COSTS, KEYS, restorations
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Arrays, Restoration, View

_NO_PICTURES = "the bundle has no pictures"
_LOOK_ALIKE = "black pixels and holes look alike"
_VIEW = ["dataset", "scene", "view"]
_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"


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
    rows, common = bundle.rows, common_frame([])
    names = sorted(set(bundle.inside) | set(bundle.entries) - {"bundle.json"})
    faults = {name: fault for name in progress.track(names, "hashes") if (fault := bundle.fault_of(name))}
    try:
        common = common if bundle.common is None else bundle.common
    except InputError as fault:
        faults.setdefault(COMMON, fault.beside(bundle.path / COMMON))
    scenes, data_faults = open_data(rows, data or {})
    outcome = Outcome(bundle.id, bundle.by, len(names), [f"{name}: {fault}" for name, fault in faults.items()])
    outcome.faults += [*data_faults, *_wrong_meaning(SCORES, rows), *_wrong_meaning(COMMON, common)]
    check = _Check(bundle, scenes, tolerance, outcome)
    is_whole = rows.index.isin(restorations(rows).index)
    is_score = (rows["status"] == "ok") & ~rows["metric"].isin(COSTS)
    groups = rows[is_score | is_whole].groupby(list(KEYS), sort=False)
    for _, of_restoration in progress.track(list(groups), "scoring again"):
        check.restoration(of_restoration)
    n_own = outcome.n_agree
    is_view = common["metric"] == COMMON_PIXELS
    scores = dict(iter(common[~is_view & (common["status"] == "ok")].groupby(_VIEW, sort=False)))
    for view in progress.track(list(common[is_view].itertuples()), "scoring common pixels again"):
        if view.variant != "unknown":
            check.view(view, scores.get((view.dataset, view.scene, view.view), common[:0]))
    outcome.n_common = outcome.n_agree - n_own
    outcome.unchecked = dict(sorted(outcome.unchecked.items(), key=lambda item: -item[1]))
    outcome.other_versions.sort()
    return outcome


def _wrong_meaning(file: str, rows: DataFrame) -> Iterator[str]:
    """Metrics of which a table of the bundle says another unit or direction than they have."""
    known = plugins.usable("metric")
    once = rows[~rows["metric"].isin(COSTS)].drop_duplicates(["metric", "unit", "better"])
    for row in once.itertuples():
        plugin = known.get(row.metric)
        if plugin and (row.unit, row.better) != (plugin.unit, plugin.better):
            said, meant = f"'{row.unit}', {row.better} is better", f"'{plugin.unit}', {plugin.better}"
            yield f"{file}: {row.metric} in {said}; it is {meant}"


def _picture(bundle: Bundle, name: str) -> Array:
    """Return a picture of a bundle, (H, W, 3) float32 RGB in [0, 1]. InputError if it is none of ordinary size.

    A restored image is a PNG; views and references may be JPEG files, which are not exact.
    """
    import cv2

    content = bundle.read(name)
    if not content.startswith(_PNG if name.endswith(".png") else (_PNG, _JPEG)):
        raise InputError(f"{name}: is no PNG or JPEG", bundle.path, "ask who made the bundle for another")
    width, height = size_of_bytes(content) or (0, 0)
    if 3 * width * height > max(1 << 20, LIMITS.ratio * len(content)):
        fault = f"{name}: would decode to {3 * width * height / 1e6:.0f} MB, far more than its size"
        raise InputError(fault, bundle.path, "ask who made the bundle for another")
    try:
        stored = decode_bytes(content, cv2.IMREAD_COLOR, name)[..., ::-1]
    except InputError as fault:
        raise fault.within(bundle.path) from fault
    return np.asarray(stored, dtype=np.float32) / 255


@dataclass(frozen=True)
class _Kept:
    """A restoration of a bundle. Names of its restored image, record, view and reference; "" for what is not there."""

    bundle: Bundle
    image: str
    record: str
    view: str
    reference: str

    @classmethod
    def of(cls, bundle: Bundle, row: Any) -> "_Kept | None":
        """Return the one that a row stands for; None if the bundle does not have the restored image."""
        root = Path()
        for place in possible_places(row.dataset, row.scene, row.view):
            image = place.restored(root, row.method)
            files = (image, image.with_suffix(".json"), place.original(root), place.reference(root))
            names = [file.as_posix() if file.as_posix() in bundle.inside else "" for file in files]
            if names[0]:
                return cls(bundle, *names)
        return None

    def open(self, n_coloured: int) -> tuple[Restoration, bool]:
        """Return the restoration, and whether it is known which black pixels are holes.

        Its image is the restored image, NaN = a hole. n_coloured: how many pixels have a colour, as its row says.
        Raises InputError for a picture or record that cannot be read, and for one that does not fit the row.
        """
        image, remedy = _picture(self.bundle, self.image), "ask who made the bundle"
        black = (image == 0).all(axis=-1)
        n_black, holes = int(black.sum()), black.size - n_coloured
        if not 0 <= holes <= n_black:
            fault = f"{black.size - n_black} pixels have a colour, the score table says {n_coloured}"
            raise InputError(f"{self.image}: {fault}", self.bundle.path, remedy)
        if holes:
            image = np.where(black[..., None], np.float32(np.nan), image)
        try:
            record = json.loads(self.bundle.read(self.record)) if self.record else {}
        except (ValueError, RecursionError) as fault:
            raise InputError(f"{self.record}: is no JSON", self.bundle.path, f"{remedy} for another") from fault
        record = record if isinstance(record, dict) else {}
        water = water_of(record, self.bundle.path / self.record)
        record.pop("true_water", None)  # metrics get that of the data
        return Restoration(image, water, info=record), holes in (0, n_black)


class _Check:
    """Scores restorations one after the other, and writes into an outcome what comes out."""

    def __init__(self, bundle: Bundle, scenes: Scenes, tolerance: float, outcome: Outcome) -> None:
        self._bundle, self._scenes, self._tolerance, self._outcome = bundle, scenes, tolerance, outcome
        self._metric = metrics_of(bundle)
        self._unrounded: dict[tuple[str, str, str], bool] = {}
        rows = bundle.rows
        scores = rows[(rows["status"] == "ok") & np.isfinite(rows["value"])]
        # The median size of a column's scores: what a difference near zero is compared with.
        self._sizes = scores["value"].abs().groupby([scores["metric"], scores["variant"]]).median().to_dict()
        self._whole: dict[tuple[str, ...], dict[str, Any]] = {}  # by view, then by method
        for row in filled_restorations(rows).itertuples():
            self._whole.setdefault((row.dataset, row.scene, row.view), {})[row.method] = row

    def restoration(self, rows: DataFrame) -> None:
        """Score a restoration again. rows: the one that stands for it, and its scores."""
        whole, scores = restorations(rows), rows[~rows["metric"].isin(COSTS)]
        first = rows.iloc[0]
        where = f"{first['dataset']} / {first['method']} / {first['view']}"
        if whole.empty:
            self._outcome.faults.append(f"{where}: has scores, but no row of the restoration")
            return
        with self._faults(where, scores, "the picture cannot be used"):
            self._score(next(whole.itertuples()), scores)

    def view(self, said: Any, scores: DataFrame) -> None:
        """Find the common pixels of a view again, and score all methods on them again. said: the view's row."""
        whole = self._whole.get((said.dataset, said.scene, said.view), {})
        scores = scores[scores["method"].isin(whole.keys())]
        with self._faults(f"{COMMON}: {said.dataset} / {said.view}", scores, "the common pixels cannot be found again"):
            if {*json.loads(said.methods)} != whole.keys():
                reason = "common to other methods than the bundle has"
            elif any(row.time > said.time for row in whole.values()):
                reason = "on common pixels of earlier restorations, which no table shows"
            elif (pixels := self._common_pixels(said, whole)) is None:
                reason = _NO_PICTURES
            else:
                for method, of_method in scores.groupby("method", sort=False):
                    self._score(whole[str(method)], of_method, *pixels)
                return
            self._outcome.unchecked[reason] += len(scores)

    @contextlib.contextmanager
    def _faults(self, where: str, scores: DataFrame, reason: str) -> Iterator[None]:
        """Whatever a stranger's file makes fail is a fault of that file, and the scores are not checked."""
        try:
            yield
        except ANY_FAULT as fault:
            text = fault.beside(self._bundle.path) if isinstance(fault, SucreBenchError) else str(fault)
            self._outcome.faults.append(f"{where}: {text}")
            self._outcome.unchecked[reason] += len(scores)

    def _common_pixels(self, said: Any, whole: Mapping[str, Any]) -> tuple[Mask, bool] | None:
        """Return the pixels (H, W) that all methods fill, and whether they are known for sure; None without pictures.

        They are not for sure if a restored image has black pixels besides its holes. Raises InputError if a picture
        cannot be used, or if the bundle says other pixels than the pictures have.
        """
        masks, is_sure = dict[str, Mask | None](), True
        for method, row in whole.items():
            if (kept := _Kept.of(self._bundle, row)) is None:
                return None
            restoration, is_this_sure = kept.open(int(row.n_pixels))
            masks[method] = restoration.valid
            is_sure &= is_this_sure
        common = common_pixels(masks)
        is_as_said = (common.kind, common.id) == (said.variant, said.pixels)
        is_of_share = math.isclose(common.share, said.value, abs_tol=1e-6)  # it is written as text
        if is_sure and not (is_as_said and is_of_share):
            there, here = (
                "methods fill the same pixels" if kind == "equal" else f"methods have {100 * of:.6g} % in common"
                for kind, of in ((said.variant, said.value), (common.kind, common.share))
            )
            raise InputError(f"{there}, in the pictures {here}")
        return common.mask, is_sure or is_as_said

    def _score(self, row: Any, scores: DataFrame, common: Mask | None = None, is_common_sure: bool = True) -> None:
        """Compute scores again, and judge each. row: of the restoration; common: the pixels (H, W) to score."""
        if (kept := _Kept.of(self._bundle, row)) is None:
            self._outcome.unchecked[_NO_PICTURES] += len(scores)
            return
        restoration, is_sure = kept.open(int(row.n_pixels))
        if common is not None:
            restoration, is_sure = replace(restoration, image=masked(restoration.image, common)), is_common_sure
        if (scene := self._scenes.get((row.dataset, row.scene))) is not None:
            view = scene[row.view]
            if view.rgb.shape != restoration.image.shape:
                raise InputError(f"{kept.image}: is not of the size of its view; ask who made the bundle")
            restoration = with_truth(restoration, scene, view)
        else:  # from the bundle's pictures, as far as they go
            rgb = _picture(self._bundle, kept.view) if kept.view else np.zeros_like(restoration.image)
            reference = _picture(self._bundle, kept.reference) if kept.reference else None
            view = View(row.view, Arrays(rgb, reference=reference))
        chosen = [self._metric(score.metric, score.variant, score.code) for score in scores.itertuples()]
        pictured = Pictured(restoration, view, [*{id(one): one for one in chosen if isinstance(one, Scorer)}.values()])
        for score, scorer in zip(scores.itertuples(), chosen, strict=True):
            if isinstance(scorer, str):
                self._outcome.unchecked[scorer] += 1
                continue
            doubt = "" if is_sure else _LOOK_ALIKE
            if scene is None and "reference" in scorer.plugin.needs:  # the bundle has it as a JPEG
                doubt = f"{score.metric} needs the exact reference of the data"
            self._judge(score, scorer, pictured, doubt)

    def _judge(self, score: Any, scorer: Scorer, pictured: Pictured, doubt: str) -> None:
        """Count a score as agreeing, differing or not checked. doubt: why a difference would prove nothing."""
        outcome, key = self._outcome, (score.metric, score.variant, score.region)
        again, size = pictured.rows.get(key), self._sizes.get(key[:2], 0.0)
        is_equal = again is not None and pictured.agrees(scorer, key, score.value, size, self._tolerance)
        metric = (*key[:2], scorer.code)
        if again is None or not (again.status == "ok" or is_equal):  # nothing comes out now
            alone = again or pictured.rows.get((score.metric, score.variant, "image"))
            if alone is not None and alone.status == "skipped" and Reason.of(alone.reason) is Reason.LACK:
                outcome.unchecked[f"{score.metric} {brief(alone.reason)} of the data"] += 1
                outcome.needs_data = True
                return
        else:
            if metric not in self._unrounded:
                self._unrounded[metric] = pictured.needs_unrounded(scorer, key)
            if self._unrounded[metric]:
                outcome.unchecked[f"{score.metric} needs the restoration before it was rounded"] += 1
                return
            if doubt and not is_equal:
                outcome.unchecked[doubt] += 1
                outcome.needs_data |= doubt != _LOOK_ALIKE
                return
            if score.code.partition(".")[2] != scorer.code and score.metric not in outcome.other_versions:
                outcome.other_versions.append(score.metric)
        if is_equal:
            outcome.n_agree += 1
            return
        names = (score.dataset, score.method, score.scene, score.view, *key)
        pixels: Pixels = "common" if hasattr(score, "pixels") else "own"
        value = again.value if again and again.status == "ok" else math.nan
        outcome.differing.append(DifferingScore(*names, pixels, float(score.value), value))
