"""Distances: of colour charts (chart_distance), and their variance over a view (distance_variance).

Both are of the view, whatever the method. Distances are Euclidean, from the camera's centre, as the water has them.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, distance_map, unproject
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.chart_patches import chart_mask
from sucre_bench.plugins.plugin import metric
from sucre_bench.scene import Restoration, Score, View


@metric(
    role="chart-distance",
    needs={"charts", "depth"},
    requires=["cv2"],
    unit="m",
    better="none",
    range=(0, np.inf),
    variants={"median": "over the chart's pixels with depth"},
)
@dataclass(frozen=True)
class ChartDistance:
    """Distance of each colour chart from the camera, metres."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield a score per chart, NaN where no pixel of it has depth. NotApplicableError without a camera."""
        camera = _camera(view)
        for chart in view.charts:
            inside = chart_mask(chart, camera.size)
            v, u = np.nonzero(inside & (view.depth > 0))
            points = unproject(camera, u + 0.5, v + 0.5, view.depth[v, u].astype(np.float64))
            known = np.linalg.norm(points, axis=0)
            value = float(np.median(known)) if known.size else np.nan
            yield Score(value, chart.name, known.size, known.size / max(int(inside.sum()), 1))


@metric(
    role="distance-variance",
    needs={"depth"},
    unit="m^2",
    better="none",
    range=(0, np.inf),
    cites="Boittiaux et al. 2024",
    variants={"image": "over the pixels with depth"},
)
@dataclass(frozen=True)
class DistanceVariance:
    """Variance of a view's distances, square metres: if it is small, the view hardly determines the water."""

    def score(
        self, restored: Restoration, shown: Array, view: View, variant: str
    ) -> Iterator[Score]:
        """Yield one score, NaN where no pixel has depth. NotApplicableError without a camera."""
        distance = distance_map(_camera(view), view.depth)
        known = distance[distance > 0].astype(np.float64)
        value = float(known.var()) if known.size else np.nan
        yield Score(value, n_pixels=known.size, coverage=known.size / distance.size)


def _camera(view: View) -> Camera:
    if view.camera is None:
        raise NotApplicableError(
            f"{view.name}: no camera, so that its depth is no distance; give its calibration"
        )
    return view.camera
