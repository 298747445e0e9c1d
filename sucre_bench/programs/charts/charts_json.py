"""Writes the charts of images into charts.json, which `sucre_bench.loading.charts_file` reads."""

import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sucre_bench.machine.files import read_json, write_atomically
from sucre_bench.scene import Chart


def store_charts(path: Path, charts: Mapping[str, Sequence[Chart]]) -> None:
    """Make these the charts of some images, atomically; other images and entries of the file stay.

    charts: by image, with none for an image that has no chart any more. Raises OutputError.
    """
    content = read_json(path, "mend it there", of_data=True) or {"images": {}}
    for image, of_image in charts.items():
        content["images"].pop(image, None)
        if of_image:
            content["images"][image] = {chart.name: _entry(path, chart) for chart in of_image}
    if content["images"] or path.is_file():
        text = json.dumps(content, indent=1, ensure_ascii=False) + "\n"
        write_atomically(path, text.encode())


def _entry(path: Path, chart: Chart) -> dict[str, Any]:
    kind = chart.kind
    if kind.lower().endswith(".csv"):  # relative to the file, as it is read
        kind = Path(os.path.relpath(kind, path.parent)).as_posix()
    return {"kind": kind, "corners": chart.corners.round(2).tolist()}
