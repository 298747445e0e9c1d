"""The quality of a prepared scene, as numbers and as a page that opens from disk."""

import base64
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at
from sucre_bench.imaging.drawing import depth_colours
from sucre_bench.imaging.image_files import decode
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.html_pages import filled_in
from sucre_bench.programs.prepare.prepare_json import Prepared, Quality
from sucre_bench.programs.prepare.registered_photos import Shot

_THUMBNAIL = 420  # pixels wide
_MOST_SHOWN = 100


def quality_of(shot: Shot, depth: Array, metres_per_unit: float) -> Quality:
    """Return the figures of an image. depth: (H, W) in the model's unit, as the shot's points are."""
    xy, z = shot.seen_points()
    off = np.linalg.norm(xy - shot.xy, axis=1)
    off = off[np.isfinite(off)]
    there = depth_at(depth, xy)
    error = np.abs(there[there > 0] / z[there > 0] - 1)
    filled = depth[depth > 0]
    near, far = np.quantile(filled, [0.01, 0.99]) * metres_per_unit if len(filled) else (np.nan, np.nan)
    return Quality(
        shot.name,
        len(z),
        float(off.mean()) if len(off) else float("nan"),
        float((depth > 0).mean()),
        float(np.median(error)) if len(error) else float("nan"),
        float(near),
        float(far),
    )


def thumbnails(image: Path, depth: Array, bounds: tuple[float, float]) -> tuple[str, str]:
    """Return an image and its depth map, coloured between bounds (near, far; black: none), as data URIs."""
    import cv2

    stored = decode(image, cv2.IMREAD_COLOR)
    size = (_THUMBNAIL, max(1, round(stored.shape[0] * _THUMBNAIL / stored.shape[1])))
    small = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT)
    coloured = depth_colours(np.asarray(small), *bounds, unknown=0)[..., ::-1]
    return _uri(cv2.resize(stored, size, interpolation=cv2.INTER_AREA)), _uri(coloured)


def _uri(image: npt.NDArray[Any]) -> str:
    import cv2

    encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 82])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.tobytes()).decode()}"


def shown(names: Sequence[str]) -> frozenset[str]:
    """The images on the page: all, or evenly chosen ones of a long dive."""
    return frozenset(names[:: -(-len(names) // _MOST_SHOWN)])


def write_page(made: Prepared, facts: Mapping[str, str], pictures: Mapping[str, tuple[str, str]]) -> None:
    """Write the page. facts: of the whole scene; pictures: see `thumbnails`, by image."""
    page = filled_in(
        __package__,
        "quality.html.j2",
        title=made.out.resolve().name,
        unit="m" if made.scale.is_metric else "no unit",
        made=made,
        facts=facts,
        pictures=pictures,
    )
    write_atomically(made.out / "quality.html", page)
