"""Finds ColorChecker Classics in an image with OpenCV's detector.

Its model of the Digital SG is not used: it found clearly visible painted charts mirrored, or not at all.
"""

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import ChartKind, chart_kind
from sucre_bench.imaging.chart_patches import are_corners
from sucre_bench.imaging.display import stretch
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.scene import Chart

DETECTABLE = ("colorchecker24",)

_MOST = 4  # charts in an image; more take more time


def detect(shown: Array, kind: str) -> list[Chart]:
    """Return the charts of a kind in a picture, named chart1, chart2 from the largest on.

    shown: (H, W, 3) gamma-encoded, [0, 1]. The picture is stretched, because water leaves little contrast; if nothing
    is found, it is tried unchanged. The list is empty for a kind that OpenCV does not know.
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
        if are_corners(corners) and (corners >= 0).all() and (corners <= np.array(shown.shape[1::-1])).all():
            found.append(corners)
    found.sort(key=lambda corners: -abs(float(cv2.contourArea(corners.astype(np.float32)))))
    return [Chart(f"chart{number}", kind, corners) for number, corners in enumerate(found, 1)]


def _corners(patches: Array, kind: ChartKind) -> Array:
    """A chart's corners (4, 2), from the patches (P, 4, 2) of the detector, row by row.

    The detector's patches are wider than the chart's; only their centres are right.
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
