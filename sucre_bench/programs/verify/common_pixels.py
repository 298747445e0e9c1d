"""Finds the common pixels of a bundle's views again, from the pictures of all methods."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

from sucre_bench.arrays import DataFrame, Mask
from sucre_bench.errors import InputError
from sucre_bench.programs.verify.pictures import Restored, held, restoration_of
from sucre_bench.results.bundle_format import COMMON, Bundle
from sucre_bench.results.common_scores import COMMON_PIXELS, common_mask, filled_restorations, kind_of
from sucre_bench.results.restorations import masked
from sucre_bench.results.rows import values_of

NO_PICTURES = "the bundle has no pictures"
LOOK_ALIKE = "black pixels and holes look alike"
_ROUNDING = 1e-6  # of a share of the image that is written as text
_VIEW = ["dataset", "scene", "view"]


@dataclass(frozen=True, eq=False)
class BundledView:
    """A view of ``common.csv``.

    said: the row that stands for it; scores: its scores; whole: by method, the row of the restoration.
    """

    said: Any
    scores: DataFrame
    whole: Mapping[str, Any]

    @property
    def where(self) -> str:
        """The place that a fault of it names."""
        return f"{COMMON}: {self.said.dataset} / {self.said.view}"


def common_views(common: DataFrame, rows: DataFrame) -> Iterator[BundledView]:
    """Yield the views of a table of scores on common pixels. rows: the bundle's score table."""
    by_view: dict[tuple[str, ...], dict[str, Any]] = {}
    for row in filled_restorations(rows).itertuples():
        by_view.setdefault((row.dataset, row.scene, row.view), {})[row.method] = row
    is_view = common["metric"] == COMMON_PIXELS
    scores = dict(iter(common[~is_view].groupby(_VIEW, sort=False)))
    is_known = is_view & (common["variant"] != "unknown")
    for key, said in zip(values_of(common[is_known], *_VIEW), common[is_known].itertuples(), strict=True):
        yield BundledView(said, scores.get(key, common.iloc[:0]), by_view.get(key, {}))


def why_unused(view: BundledView) -> str:
    """Return why its scores cannot be computed again, or are in no table; empty if they can."""
    if {*json.loads(view.said.methods)} != view.whole.keys():
        return "common to other methods than the bundle has"
    if any(whole.time > view.said.time for whole in view.whole.values()):
        return "on common pixels of earlier restorations, which no table shows"
    return ""


def found_mask(bundle: Bundle, view: BundledView) -> tuple[Mask, bool] | None:
    """Return the pixels (H, W) that all methods fill, and whether they are known for sure; None without pictures.

    They are not for sure if a restored image has black pixels besides its holes. Raises InputError if a picture cannot
    be used, or if the bundle says other pixels than the pictures have.
    """
    masks, is_sure = dict[str, Mask | None](), True
    for method, whole in view.whole.items():
        names = held(bundle, whole)
        if names is None:
            return None
        kept = restoration_of(bundle, names, int(whole.n_pixels))
        masks[method] = kept.restoration.valid
        is_sure &= kept.is_sure
    common, differing = common_mask(masks)
    share, (kind, pixels) = float(common.mean()), kind_of(common, differing)
    is_as_said = (kind, pixels) == (view.said.variant, view.said.pixels)
    if is_sure and not (is_as_said and math.isclose(share, view.said.value, abs_tol=_ROUNDING)):
        raise InputError(f"{_in_words(view.said.variant, view.said.value)}, in the pictures {_in_words(kind, share)}")
    return common, is_sure or is_as_said


def on_mask(kept: Restored, common: Mask, is_sure: bool) -> Restored:
    """Return a restoration on the common pixels (H, W) only."""
    image = masked(kept.restoration.image, common)
    return Restored(replace(kept.restoration, image=image), is_sure)


def _in_words(kind: str, share: float) -> str:
    if kind == "equal":
        return "methods fill the same pixels"
    return f"methods have {100 * share:.6g} % of the image in common"
