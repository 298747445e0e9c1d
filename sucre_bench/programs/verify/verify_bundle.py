"""Verifies a bundle: hashes first, then every score that can be computed again."""

import contextlib
import functools
import io
import json
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sucre_bench import plugins
from sucre_bench.arrays import Array, DataFrame, Mask, locked
from sucre_bench.compare import Pixels
from sucre_bench.engine.score import Scorer, needs_unrounded
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError
from sucre_bench.imaging.image_files import decode_bytes, image_size, to_unit
from sucre_bench.machine import progress
from sucre_bench.machine.files import reading
from sucre_bench.plugins.call_method import with_truth
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.programs.verify import TOLERANCE
from sucre_bench.programs.verify.score_again import Pictured, Scenes, metric_of, open_data
from sucre_bench.results.bundle_format import LIMITS, SCORES, Bundle
from sucre_bench.results.common_scores import (
    COMMON_PIXELS,
    common_pixels,
    filled_restorations,
    kind_of,
    methods_of,
)
from sucre_bench.results.layout import possible_places
from sucre_bench.results.reasons import Reason, brief
from sucre_bench.results.restorations import mask_in, masked
from sucre_bench.results.rows import COMMON, COSTS, KEYS, RESTORATION, RowCode, tuples
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Arrays, Restoration, View

_NO_PICTURES = "the bundle has no pictures; ask for one of `bundle --pictures restored`"
_ROUNDED = "needs the restoration before it was rounded"
_VIEW = ["dataset", "scene", "view"]
# Rounding moves pixels over the limits of a share: 6.5e-5 of them at most, in 24 restored images of D5 by six methods.
_MOVED = 0.001
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8\xff"


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
    """What became of a bundle's check."""

    # See `Bundle`.
    id: str
    by: str

    n_files: int
    """Number of checked hashes."""

    faults: list[str] = field(default_factory=list)
    """Of files, data, pictures or units, one line each."""

    differing: list[DifferingScore] = field(default_factory=list)
    """Scores that differ."""

    n_agree: int = 0
    """Number of scores that were computed again and agree."""

    n_common: int = 0
    """How many of the scores that agree are on common pixels."""

    largest: float = 0.0
    """The largest difference of the scores that agree, as a share of the score."""

    unchecked: dict[str, int] = field(default_factory=Counter)
    """Number of scores that were not computed again, by reason."""

    needs_data: bool = False
    """Whether some of the unchecked scores need the data."""

    other_versions: list[str] = field(default_factory=list)
    """Metrics whose code here is not the code that made the scores."""

    def skip(self, reason: str, count: int = 1, of_data: bool = False) -> None:
        """Note scores that cannot be computed again. of_data: they can with the data."""
        self.unchecked[reason] += count
        self.needs_data |= of_data

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


def verify(
    bundle: Bundle, data: Mapping[str, Path] | None = None, tolerance: float = TOLERANCE
) -> Outcome:
    """Check a bundle. data: folders of the data, by dataset label; tolerance: allowed difference as share of a score.

    Raises InputError if the bundle has no score table.
    """
    rows = bundle.rows
    names = sorted(set(bundle.inside) | set(bundle.entries) - {"bundle.json"})
    found = {name: bundle.fault_of(name) for name in progress.track(names, "hashes")}
    faults = [f"{name}: {fault}" for name, fault in found.items() if fault]
    scenes, data_faults = open_data(rows, data or {})
    outcome = Outcome(bundle.id, bundle.by, len(names), faults)
    outcome.faults += [*data_faults, *_wrong_meaning(rows)]
    if rows.empty:
        outcome.faults.append(f"{SCORES}: has no rows")
    check = _Check(bundle, scenes, tolerance, outcome)
    is_whole = (rows["metric"] == RESTORATION) & (rows["view"] != "")
    is_wanted = (rows["status"] == "ok") & (is_whole | ~rows["metric"].isin(COSTS))
    # A view's restorations follow each other: they share its picture and reference.
    groups = _grouped(rows[is_wanted].sort_values(_VIEW, kind="stable"), *KEYS)
    for of_restoration in progress.track(groups.values(), "scoring again", len(groups)):
        check.restoration(of_restoration)
    n_own = outcome.n_agree
    common = bundle.common.assign(
        variant=bundle.common["variant"].str.removesuffix(COMMON), pixels="common"
    )
    is_view = common["metric"] == COMMON_PIXELS
    scores = _grouped(common[~is_view & (common["status"] == "ok")], *_VIEW)
    for view in progress.track(list(tuples(common[is_view])), "scoring common pixels again"):
        if kind_of(view.status, view.code) != "unknown":
            check.view(view, scores.get((view.dataset, view.scene, view.view), []))
    outcome.n_common = outcome.n_agree - n_own
    outcome.unchecked = dict(sorted(outcome.unchecked.items(), key=lambda item: -item[1]))
    outcome.other_versions.sort()
    return outcome


def _grouped(rows: DataFrame, *columns: str) -> dict[tuple[str, ...], list[Any]]:
    """The rows of a table as tuples, by their values in some columns."""
    groups: dict[tuple[str, ...], list[Any]] = {}
    of = attrgetter(*columns)
    for row in tuples(rows):
        groups.setdefault(of(row), []).append(row)
    return groups


def _wrong_meaning(rows: DataFrame) -> Iterator[str]:
    """Metrics of which the score table says another unit or direction than they have."""
    known = plugins.usable("metric")
    once = rows[~rows["metric"].isin(COSTS)].drop_duplicates(["metric", "unit", "better"])
    for row in once.itertuples():
        plugin = known.get(row.metric)
        if plugin and (row.unit, row.better) != (plugin.unit, plugin.better):
            said = f"{SCORES}: {row.metric} in '{row.unit}', {row.better} is better"
            yield f"{said}; it is '{plugin.unit}', {plugin.better}"


class _Picture(NamedTuple):
    """A picture of a bundle."""

    pixels: Array
    """(H, W, 3) float32 RGB in [0, 1]."""

    step: float
    """Between two levels."""


def _picture(bundle: Bundle, name: str) -> _Picture:
    """Return a picture of a bundle. InputError if it is none of ordinary size.

    A restored image is a PNG; views and references may be JPEG files, which are not exact.
    """
    import cv2

    content = bundle.read(name)
    if not content.startswith(_PNG if name.endswith(".png") else (_PNG, _JPEG)):
        raise InputError(
            f"{name}: is no PNG or JPEG", bundle.path, "ask who made the bundle for another"
        )
    width, height = image_size(content) or (0, 0)
    if 3 * width * height > max(1 << 20, LIMITS.ratio * len(content)):
        fault = (
            f"{name}: would decode to {3 * width * height / 1e6:.0f} MB, far more than its size"
        )
        raise InputError(fault, bundle.path, "ask who made the bundle for another")
    try:
        stored = decode_bytes(content, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH, name)
    except InputError as fault:
        raise fault.within(bundle.path) from fault
    pixels = locked(to_unit(stored[..., ::-1]))
    return _Picture(pixels, 1 / np.iinfo(stored.dtype).max)


def _is_share(plugin: Plugin) -> bool:
    """Whether a metric counts pixels beyond limits."""
    return plugin.unit == "share" and plugin.role != "coverage"


class _Opened(NamedTuple):
    """A restoration of a bundle."""

    restoration: Restoration
    """Its image is the restored image, NaN = a hole."""

    step: float
    """Between two levels of it; 0 where scores were made from the stored picture."""

    # Names of the pictures, "" for what is not there.
    image: str
    view: str
    reference: str


def _opened(bundle: Bundle, picture_of: Callable[[str], _Picture], row: Any) -> _Opened | None:
    """Open the restoration of a row; None if the bundle does not have its restored image. picture_of: see `_picture`.

    Raises InputError for a picture or record that cannot be read, and for one that does not fit the row.
    """
    places = possible_places(row.dataset, row.scene, row.view)
    place = next(
        (one for one in places if one.restored(Path(), row.method).as_posix() in bundle.inside),
        None,
    )
    if place is None:
        return None
    image = place.restored(Path(), row.method)
    files = (image, image.with_suffix(".json"), place.original(Path()), place.reference(Path()))
    names = map(Path.as_posix, files)
    name, record_name, view, reference = (one if one in bundle.inside else "" for one in names)
    picture, step = picture_of(name)
    remedy = "ask who made the bundle"
    with reading(bundle.path / name, f"{remedy} for another"):
        mask = mask_in(io.BytesIO(bundle.read(name)), bundle.path / name)
    n_coloured = picture[..., 0].size if mask is None else int(mask.sum())
    if n_coloured != int(row.n_pixels):
        fault = f"{n_coloured} pixels have a colour, the score table says {int(row.n_pixels)}"
        raise InputError(f"{name}: {fault}", bundle.path, remedy)
    picture = picture if mask is None else masked(picture, mask)
    with reading(bundle.path / record_name, f"{remedy} for another"):
        record = json.loads(bundle.read(record_name)) if record_name else {}
    record = record if isinstance(record, dict) else {}
    water = water_of(record, bundle.path / record_name)
    record.pop("true_water", None)  # metrics get that of the data
    return _Opened(Restoration(picture, water, info=record), step, name, view, reference)


class _Check:
    """Scores restorations one after the other, and writes into an outcome what comes out."""

    def __init__(
        self, bundle: Bundle, scenes: Scenes, tolerance: float, outcome: Outcome
    ) -> None:
        self._bundle = bundle
        self._scenes = scenes
        self._metric = functools.cache(metric_of)
        self._tolerance = tolerance
        self._outcome = outcome
        self._picture = functools.lru_cache(maxsize=4)(functools.partial(_picture, bundle))
        self._opened = functools.partial(_opened, bundle, self._picture)
        self._unrounded: dict[tuple[str, str, str], bool] = {}
        rows = bundle.rows
        scores = rows[(rows["status"] == "ok") & np.isfinite(rows["value"])]
        # The median size of a column's scores: what a difference near zero is compared with.
        self._sizes = (
            scores["value"]
            .abs()
            .groupby([scores["metric"], scores["variant"]])
            .median()
            .to_dict()
        )
        self._whole: dict[tuple[str, ...], dict[str, Any]] = {}  # by view, then by method
        for row in tuples(filled_restorations(rows)):
            self._whole.setdefault((row.dataset, row.scene, row.view), {})[row.method] = row

    def restoration(self, rows: Sequence[Any]) -> None:
        """Score a restoration again. rows: the one that stands for it, and its scores."""
        whole = next((row for row in rows if row.metric == RESTORATION), None)
        scores = [row for row in rows if row.metric != RESTORATION]
        where = f"{rows[0].dataset} / {rows[0].method} / {rows[0].view}"
        if whole is None:
            self._outcome.faults.append(f"{where}: has scores, but no row of the restoration")
            return
        with self._faults(where, scores, "the picture cannot be used"):
            if opened := self._opened(whole):
                self._score(whole, opened, scores)
            else:
                self._outcome.skip(_NO_PICTURES, len(scores))

    def view(self, said: Any, scores: Sequence[Any]) -> None:
        """Find the common pixels of a view again, and score all methods on them again. said: the view's row."""
        whole = self._whole.get((said.dataset, said.scene, said.view), {})
        scores = [score for score in scores if score.method in whole]
        with self._faults(
            f"{SCORES}: {said.dataset} / {said.view}",
            scores,
            "the common pixels cannot be found again",
        ):
            if methods_of(said.options) != whole.keys():
                self._outcome.skip("common to other methods than the bundle has", len(scores))
                return
            if any(row.time > said.time for row in whole.values()):
                reason = "on common pixels of earlier restorations, which no table shows"
                self._outcome.skip(reason, len(scores))
                return
            every = {method: self._opened(row) for method, row in whole.items()}
            found = {method: opened for method, opened in every.items() if opened}
            if len(found) < len(whole):
                self._outcome.skip(_NO_PICTURES, len(scores))
                return
            common = self._common_pixels(said, found)
            for method, opened in found.items():
                image = masked(opened.restoration.image, common)
                restoration = replace(opened.restoration, image=image)
                on_common = opened._replace(restoration=restoration, step=0.0)
                of_method = [score for score in scores if score.method == method]
                self._score(whole[method], on_common, of_method)

    @contextlib.contextmanager
    def _faults(self, where: str, scores: Sequence[Any], reason: str) -> Iterator[None]:
        """Whatever a stranger's file makes fail is a fault of that file, and the scores are not checked."""
        try:
            yield
        except ANY_FAULT as fault:
            text = str(fault)
            if isinstance(fault, SucreBenchError):
                text = fault.beside(self._bundle.path)
            self._outcome.faults.append(f"{where}: {text}")
            self._outcome.skip(reason, len(scores))

    def _common_pixels(self, said: Any, found: Mapping[str, _Opened]) -> Mask:
        """Return the pixels (H, W) that all methods fill. Raises InputError if the bundle says others."""
        common = common_pixels(
            {method: opened.restoration.valid for method, opened in found.items()}
        )
        # it is written as text
        is_of_share = math.isclose(common.share, said.value, abs_tol=1e-6)
        kind = kind_of(said.status, said.code)
        if (common.kind, common.id) != (kind, said.code) or not is_of_share:
            there, here = (
                "methods fill the same pixels"
                if one == "equal"
                else f"methods have {100 * of:.6g} % in common"
                for one, of in ((kind, said.value), (common.kind, common.share))
            )
            raise InputError(f"{there}, in the pictures {here}")
        return common.mask

    def _score(self, row: Any, opened: _Opened, scores: Sequence[Any]) -> None:
        """Compute scores of a restoration again, and judge each. row: of the restoration."""
        restoration = opened.restoration
        scene = self._scenes.get((row.dataset, row.scene))
        if scene is not None:
            view = scene[row.view]
            if view.rgb.shape != restoration.image.shape:
                raise InputError(
                    f"{opened.image}: is not of the size of its view; ask who made the bundle"
                )
            restoration = with_truth(restoration, scene, view)
        else:  # from the bundle's pictures, as far as they go
            rgb = np.zeros_like(restoration.image)
            if opened.view:
                rgb = self._picture(opened.view).pixels
            reference = None
            if opened.reference:
                reference = self._picture(opened.reference).pixels
            view = View(row.view, Arrays(rgb, reference=reference))
        chosen = [
            self._metric(score.metric, score.variant, RowCode.read(score.code).metric_options)
            for score in scores
        ]
        pictured = Pictured(
            restoration,
            opened.step,
            view,
            [*{id(one): one for one in chosen if isinstance(one, Scorer)}.values()],
        )
        for score, scorer in zip(scores, chosen, strict=True):
            if isinstance(scorer, str):
                self._outcome.skip(scorer)
                continue
            # The bundle has references as JPEG files, and no charts, which shares of pixels leave out.
            is_inexact = scene is None and (
                "reference" in scorer.plugin.needs or _is_share(scorer.plugin)
            )
            self._judge(score, scorer, pictured, is_inexact)

    def _judge(self, score: Any, scorer: Scorer, pictured: Pictured, is_inexact: bool) -> None:
        """Count a score as agreeing, differing or not checked. is_inexact: a difference may be that of the data."""
        outcome = self._outcome
        key = (score.metric, score.variant, score.region)
        again, size = pictured.rows.get(key), self._sizes.get(key[:2], 0.0)
        apart = (
            math.inf
            if again is None
            else pictured.difference(scorer, key, score.value, size, self._tolerance)
        )
        is_equal = apart <= self._tolerance
        metric = (*key[:2], scorer.code)
        if again is None or not (again.status == "ok" or is_equal):  # nothing comes out now
            alone = again or pictured.rows.get((score.metric, score.variant, "image"))
            if (
                alone is not None
                and alone.status == "skipped"
                and Reason.of(alone.reason) is Reason.LACK
            ):
                outcome.skip(f"{score.metric} {brief(alone.reason)} of the data", of_data=True)
                return
        else:
            if metric not in self._unrounded:
                self._unrounded[metric] = needs_unrounded(
                    scorer, pictured.restoration, pictured.view
                )
            if self._unrounded[metric]:
                outcome.skip(f"{score.metric} {_ROUNDED}")
                return
            if is_inexact and not is_equal:
                reason = f"{score.metric} needs the reference or charts of the data"
                outcome.skip(reason, of_data=True)
                return
            if (
                RowCode.read(score.code).metric != scorer.code
                and score.metric not in outcome.other_versions
            ):
                outcome.other_versions.append(score.metric)
        if is_equal:
            outcome.n_agree += 1
            outcome.largest = max(outcome.largest, apart)
            return
        plugin = scorer.plugin
        value = again.value if again and again.status == "ok" else math.nan
        if plugin.faults or (_is_share(plugin) and abs(value - score.value) <= _MOVED):
            outcome.skip(f"{score.metric} {_ROUNDED}")
            return
        names = (score.dataset, score.method, score.scene, score.view, *key)
        pixels: Pixels = "common" if hasattr(score, "pixels") else "own"
        outcome.differing.append(DifferingScore(*names, pixels, float(score.value), value))
