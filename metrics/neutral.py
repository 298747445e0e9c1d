"""Colour cast of the gray patches of colour charts."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_patches import measure
from sucre_bench.imaging.cielab import lab_d50
from sucre_bench.metrics.psi_and_de00 import chart_scores
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View


@metric(
    symbol=r"chroma of grays $C^*_{ab}$",
    needs={"charts"},
    requires=["cv2"],
    unit="C*ab",
    better="lower",
    range=(0, np.inf),
    cites="CIE 15:2004",
    variants={"chroma": "C*ab = sqrt(a*^2 + b*^2) of CIE Lab under D50"},
)
@dataclass(frozen=True)
class Neutral:
    """Mean chroma of the gray patches of a chart, as the picture shows them.

    A picture without a colour cast shows them gray, with chroma 0. A patch that is black or blown out to white has no
    chroma either, so read it beside psi or dE00.
    """

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per chart and per gray patch."""
        for chart in view.charts:
            readings = [reading for reading in measure(shown, chart) if not reading.patch.colour]
            lab = lab_d50(np.array([reading.rgb for reading in readings]).reshape(-1, 3))
            yield from chart_scores(chart, readings, np.hypot(lab[:, 1], lab[:, 2]))
