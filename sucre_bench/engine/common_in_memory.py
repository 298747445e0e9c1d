"""Scores on common pixels of restorations in memory, by their pictures and masks, as a results folder stores them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Mask, Picture
from sucre_bench.engine.common_view import CommonView, PixelMetrics, rows_of
from sucre_bench.engine.score import scorers
from sucre_bench.jobs.job import metric_choices
from sucre_bench.results.common_scores import LEAST_FILLED, common_frame
from sucre_bench.results.rows import COLUMNS, Row, restorations
from sucre_bench.results.stored_pictures import PictureOnly
from sucre_bench.scene import Restoration, View

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["InMemory", "score_in_memory"]

_Of = tuple[str, str]  # view, label


@dataclass(frozen=True, eq=False)
class InMemory:
    """A restoration as its picture (H, W, 3) and mask (H, W), at one bit a pixel: see `common_view.Held`."""

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
        return PictureOnly(mask)


def score_in_memory(
    views: Sequence[View], rows: pd.DataFrame, held: Mapping[_Of, InMemory], metrics: Sequence[str]
) -> pd.DataFrame:
    """Return scores on common pixels of the views that methods fill differently, as `results.read_common` has them.

    rows: all scores of one scene; held: restorations by view and label; metrics: those of the rows, by name.
    """
    chosen = scorers(choice for choice in metric_choices(metrics) if choice.plugin.is_of_pixels)
    by_code = PixelMetrics({(scorer.plugin.name, scorer.code): scorer for scorer in chosen})
    made = (_view(view, rows[rows["view"] == view.name], held, by_code) for view in views)
    return common_frame(row for view in made if view for row in rows_of(view, by_code))


def _view(view: View, rows: pd.DataFrame, held: Mapping[_Of, InMemory], metrics: PixelMetrics) -> CommonView | None:
    """A view that several methods restored, one of them with holes."""
    whole = restorations(rows)
    whole = whole[whole["coverage"] >= LEAST_FILLED]
    if len(whole) < 2 or not (whole["coverage"] < 1).any():
        return None
    made = CommonView(next(_rows(whole)), view)
    for row in _rows(whole):
        made.add(row, held[view.name, row.method])
    scores = rows[(rows["status"] == "ok") & (rows["region"] == "image") & rows["method"].isin(made.whole)]
    made.own_rows += [row for row in _rows(scores) if metrics.of(row)]
    return made


def _rows(table: pd.DataFrame) -> Iterator[Row]:
    for values in table[list(COLUMNS)].itertuples(index=False, name=None):
        yield Row(**dict(zip(COLUMNS, values, strict=True)))
