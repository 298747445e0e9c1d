"""Scores on common pixels of restorations in memory, by their pictures and masks, as a results folder stores them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import DataFrame, Mask, Picture
from sucre_bench.engine.common_pixels.of_view import CommonView, PixelMetrics, add_scores, of_views, rows_of
from sucre_bench.jobs.metric_words import metric_choices
from sucre_bench.results.common_scores import ViewKey, common_frame, differing_views, filled_restorations
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import PictureOnly
from sucre_bench.results.rows import row_objects
from sucre_bench.scene import Restoration, View

_Of = tuple[str, str]  # view, label


@dataclass(frozen=True, eq=False)
class InMemory:
    """A restoration as its picture (H, W, 3) and mask, at one bit a pixel: see `common_view.RestorationSource`."""

    shown: Picture
    bits: npt.NDArray[np.uint8]

    @classmethod
    def of(cls, shown: Picture, mask: Mask) -> InMemory:
        """shown: uint8 RGB, holes black."""
        return cls(shown, np.packbits(mask))

    def mask(self) -> Mask:
        """Return which pixels (H, W) have a colour."""
        height, width = self.shown.shape[:2]
        return np.unpackbits(self.bits, count=height * width).astype(np.bool_).reshape(height, width)

    def picture(self) -> Picture:
        """Return the picture."""
        return self.shown

    def restoration(self, mask: Mask) -> Restoration:
        """Return a restoration with a mask alone."""
        return PictureOnly(mask, Reason.NOT_HELD)


def score_in_memory(
    views: Sequence[View], rows: DataFrame, held: Mapping[_Of, InMemory], metrics: Sequence[str]
) -> DataFrame:
    """Return scores on common pixels of the views that methods fill differently, as `results.read_common` has them.

    rows: all scores of one scene; held: restorations by view and label; metrics: those of the rows, by name.
    """
    by_name, chosen = {view.name: view for view in views}, PixelMetrics.chosen(metric_choices(metrics))
    whole = filled_restorations(rows)
    made: dict[ViewKey, CommonView] = {}
    for key, row in of_views(row_objects(whole), differing_views(whole)):
        made.setdefault(key, CommonView(row, by_name[row.view])).add(row, held[row.view, row.method])
    add_scores(made, rows, chosen)
    return common_frame(row for view in made.values() for row in rows_of(view, chosen))
