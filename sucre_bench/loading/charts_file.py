"""Reads charts.json: the corners of colour charts in the images.

    {"kind": "dgk", "images": {"sub/a.png": {"chart1": [[x, y], [x, y], [x, y], [x, y]],
                                             "chart2": {"kind": "colorchecker24", "corners": [...]}}}}

Corners are pixels of the image as stored, of the chart's frame: top left, top right, bottom right, bottom left as the
chart is read. "kind" applies to charts without a kind of their own; its default is "dgk". It may be the path, relative
to charts.json, of a CSV file that describes the chart (see `imaging.chart_kinds`). Other entries are ignored.
"""

import difflib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Size
from sucre_bench.errors import InputError, in_one_line
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.imaging.chart_patches import are_corners
from sucre_bench.machine.files import read_json
from sucre_bench.scene import Chart


def read_charts(path: Path, sizes: Mapping[str, Size]) -> dict[str, tuple[Chart, ...]]:
    """Return the charts of each image that has some; none if the file does not exist.

    sizes: (width, height) in pixels of every image, by name. Raises InputError, naming the entry, if the file is not in
    the format above. Also if it names an unknown image, an unknown kind, or corners that form no chart in the image.
    """
    content = read_json(path, "mend it there", of_data=True)
    if content is None:
        return {}
    images = content.get("images") if isinstance(content, dict) else None
    if not isinstance(images, dict) or not all(
        isinstance(charts, dict) for charts in images.values()
    ):
        raise InputError(
            f'{path}: no charts by image; write {{"images": {{"a.png": {{"chart1": [[x, y], ...]}}}}}}'
        )
    for name in images:
        if name not in sizes:
            near = difflib.get_close_matches(name, sizes, n=1, cutoff=0)
            what = f"'{in_one_line(name)}' is not an image of the scene"
            raise InputError(what, path, f"write names as there, like '{near[0]}'")
    usual = content.get("kind", "dgk")
    return {
        name: tuple(
            chart_of(path, name, chart, entry, usual, sizes[name])
            for chart, entry in charts.items()
        )
        for name, charts in images.items()
        if charts
    }


def chart_of(path: Path, image: str, name: str, entry: Any, kind: Any, size: Size) -> Chart:
    """Return the chart that an entry of the file `path` describes. Raises InputError, naming a wrong entry.

    image, name: the image's and the chart's; kind: of a chart without one of its own; size: (width, height), the
    image's.
    """
    place = f"{path}: {in_one_line(image)}, {in_one_line(name)}"
    if isinstance(entry, dict):
        kind, entry = entry.get("kind", kind), entry.get("corners")
    kind = str(path.parent / kind) if str(kind).lower().endswith(".csv") else str(kind)
    try:
        chart_kind(kind)
    except InputError as fault:
        raise fault.within(place) from fault
    corners = np.empty(0)
    with suppress(TypeError, ValueError, OverflowError):
        corners = np.array(entry, dtype=np.float64)
    if not are_corners(corners):
        remedy = "give [x, y] of top left, top right, bottom right, bottom left"
        raise InputError("not four corners in this order", place, remedy)
    if (corners < 0).any() or (corners > size).any():
        raise InputError(
            f"a corner is outside of the image of {size[0]}x{size[1]}",
            place,
            "give pixels of that image",
        )
    return Chart(name, kind, corners)
