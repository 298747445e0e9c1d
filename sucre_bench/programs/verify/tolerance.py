"""Decides whether a stored score agrees with the score of the 8-bit picture."""

import functools
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from sucre_bench.engine.score import Scorer, score_rows
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.plugins.plugin import Plugin
from sucre_bench.results.restorations import Measured
from sucre_bench.results.rows import Row
from sucre_bench.scene import Restoration, View

Key = tuple[str, str, str]  # metric, variant, region

_HALF_STEP = np.float32(0.5 / 255)


def agrees(stored: float, value: float, plugin: Plugin, size: float, tolerance: float, reach: float = 0.0) -> bool:
    """Whether two scores differ by no more than a share of their size, and than the reach of rounding.

    size: the median size of the column; it stands for that of a score near zero.
    """
    if not (math.isfinite(stored) and math.isfinite(value)):
        return stored == value
    size = plugin.period / 2 if math.isfinite(plugin.period) else max(abs(stored), size)
    return _difference(stored, value, plugin.period) <= tolerance * size + reach + 1e-9


def _difference(one: float, other: float, period: float) -> float:
    apart = abs(one - other)
    return min(apart % period, period - apart % period) if math.isfinite(period) else apart


def computed(restoration: Restoration, view: View, chosen: Sequence[Scorer]) -> dict[Key, Row]:
    """Score a restoration whose image is the restored image, as it is shown."""
    shown = restoration.image
    if view.encoding == "linear":  # metrics get the restoration in the view's encoding
        restoration = replace(restoration, image=srgb_decode(restoration.image).astype(np.float32))
    rows = score_rows(Measured(restoration, math.nan, math.nan), shown, view, chosen, Row())
    return {(row.metric, row.variant, row.region): row for row in rows}


@dataclass(frozen=True, eq=False)
class Pictured:
    """A restoration whose image is a picture of 8 bits, and how far the rounding moves scores of its chart patches.

    Rounding moves the median of a patch by half a step of 8 bits at most, so the unrounded median is in a cube around
    the one in the picture. Scores at the cube's corners tell how far a score may be from the one at its centre.
    """

    restoration: Restoration
    view: View
    _corners: dict[tuple[str, str], list[Mapping[Key, Row]]] = field(default_factory=dict, init=False)

    def reach(self, scorer: Scorer, key: Key, value: float) -> float:
        """Return how far rounding may have moved a score from a value.

        0 for a metric that needs no charts. Infinite where the picture gives no value and a corner does: a patch that
        is gray in 8 bits has no hue, whichever it had before.
        """
        if "charts" not in scorer.plugin.needs or not self.view.charts:
            return 0.0
        if key[:2] not in self._corners:
            self._corners[key[:2]] = [computed(corner, self.view, [scorer]) for corner in self._shifted]
        around = [rows[key].value for rows in self._corners[key[:2]] if key in rows]
        known = [one for one in around if math.isfinite(one)]
        if not math.isfinite(value):
            return math.inf if known else 0.0
        return max((_difference(one, value, scorer.plugin.period) for one in known), default=0.0)

    @functools.cached_property
    def _shifted(self) -> list[Restoration]:
        signs = np.array(list(itertools.product((-1, 1), repeat=3)), dtype=np.float32)
        image = self.restoration.image
        return [replace(self.restoration, image=(image + _HALF_STEP * sign).clip(0, 1)) for sign in signs]
