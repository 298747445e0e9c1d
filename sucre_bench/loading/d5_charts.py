"""The charts of Sea-thru D5: 152 DGK charts in 43 images, from the table that is published for them.

The table's corners are those of the patches' extent, not of the chart's black frame. Against frames read by hand in two
images (8 charts, to 4 px of 1877) they lie up to 14 px inside. Once carried out to the frame by the chart's layout they
are 2.5 px off on average. They belong to the photographs as taken, with their lens' distortion. Undistorted along with
the image they come to those 2.5 px, without that to 4.4 px.
"""

import csv
import functools
from importlib.resources import files

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.scene import Chart

FULL_SIZE = (7360, 4912)


@functools.cache
def published_charts() -> dict[str, tuple[Chart, ...]]:
    """Return the charts of each image, by its name without suffix; corners of the frame, in pixels of FULL_SIZE.

    A chart's name is its number in the table: of the same chart in each of four images where that was checked.
    """
    lines = (
        files(__package__).joinpath("d5_charts.csv").read_text(encoding="utf-8").splitlines()
    )
    found: dict[str, tuple[Chart, ...]] = {}
    for row in csv.DictReader(line for line in lines if not line.startswith("#")):
        patches = np.array([[float(row[f"{axis}{k}"]) for axis in "xy"] for k in range(1, 5)])
        chart = Chart(f"chart{row['chart']}", "dgk", _frame(patches))
        found[row["image"]] = (*found.get(row["image"], ()), chart)
    return found


def _frame(patches: Array) -> Array:
    """Return the corners (4, 2) of a chart's frame from those of its patches' extent, through the chart's plane."""
    import cv2

    from sucre_bench.imaging.chart_kinds import chart_kind

    boxes = np.array([patch.box for patch in chart_kind("dgk").patches])
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    extent = np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)], dtype=np.float32)
    image_from_chart = cv2.getPerspectiveTransform(extent, patches.astype(np.float32)).astype(
        np.float64
    )
    unit = np.array([[[0, 0], [1, 0], [1, 1], [0, 1]]], dtype=np.float64)
    return np.asarray(cv2.perspectiveTransform(unit, image_from_chart)[0], dtype=np.float64)
