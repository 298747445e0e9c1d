"""Finds ColorChecker Classics in an image with OpenCV's detector.

Its model of the Digital SG is left out: painted charts in plain sight were found mirrored, or not at all.
"""

from __future__ import annotations

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.charts.kinds import ChartKind, chart_kind
from sucre_bench.imaging.charts.reading import check_corners
from sucre_bench.imaging.display import stretch
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.scene import Chart

__all__ = ["DETECTABLE", "detect"]

DETECTABLE = ("colorchecker24",)

_MOST = 4  # charts in an image; the detector's time grows with it


def detect(shown: Array, kind: str) -> list[Chart]:
    """Return the charts of a kind in a picture, named chart1, chart2 from the largest on.

    shown: (H, W, 3) gamma-encoded, [0, 1]; it is stretched first, for water leaves little contrast, and tried as it is
    where that shows nothing. A kind that OpenCV does not know, and a picture without any, have none.
    """
    import cv2

    if kind not in DETECTABLE:
        return []
    about, shown = chart_kind(kind), np.nan_to_num(shown)
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    pictures = (np.ascontiguousarray(to_8bit(tried)[..., ::-1]) for tried in (stretch(shown), shown))
    if min(shown.shape[:2]) < 64 or not any(detector.process(picture, _MOST) for picture in pictures):
        return []
    found = []
    for checker in detector.getListColorChecker():
        patches = np.array(checker.getColorCharts(), dtype=np.float64).reshape(-1, 4, 2)
        corners = _corners(patches, about)
        if _is_chart(corners) and (corners >= 0).all() and (corners <= np.array(shown.shape[1::-1])).all():
            found.append(corners)
    found.sort(key=lambda corners: -abs(float(cv2.contourArea(corners.astype(np.float32)))))
    return [Chart(f"chart{number}", kind, corners) for number, corners in enumerate(found, 1)]


def _corners(patches: Array, kind: ChartKind) -> Array:
    """A chart's corners (4, 2), of the patches (P, 4, 2) that the detector says it has, row by row.

    Its model has wider patches than the chart: only their centres are the chart's.
    """
    import cv2

    if len(patches) != len(kind.patches):
        return np.full((4, 2), np.nan)
    boxes = np.array([patch.box for patch in kind.patches])
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    homography, _ = cv2.findHomography(centres, patches.mean(axis=1))
    unit = np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
    # OpenCV has pixel centres at whole numbers.
    return np.asarray(cv2.perspectiveTransform(unit, homography)[0] + 0.5, dtype=np.float64)


def _is_chart(corners: Array) -> bool:
    """Whether they are a quadrilateral, from its front."""
    try:
        check_corners("", corners)
    except InputError:
        return False
    return True
