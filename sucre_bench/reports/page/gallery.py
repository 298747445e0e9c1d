"""The page's pictures: thumbnails kept in the page, and maps of where a restoration has holes or is sure of itself.

A thumbnail is a WebP file in base64, in a block of its own that the page decodes when it shows it. The full picture
stays where it is, and the page reads it from there when someone looks closer.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Iterable, Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode, encode_png
from sucre_bench.machine.cores import usable_cores
from sucre_bench.results.restorations import read_full_arrays

__all__ = ["Block", "Gallery"]

Image = npt.NDArray[np.uint8]

# How many pictures a page keeps, and how wide: 50 kB each at 960 pixels, 20 kB at 560, so that a page of 10 methods on
# 40 full-HD views stays below 40 MB, and no page goes beyond it.
_WIDTHS = ((600, 960), (1400, 560))
_MAP_WIDTH = 480
_QUALITY = 75


@dataclass(frozen=True)
class Block:
    """A picture in the page. data: base64; about: attributes, such as the range of a map."""

    name: str
    kind: str
    data: str
    about: dict[str, str] = field(default_factory=dict)


class Gallery:
    """Collects pictures while sections are made, and encodes them meanwhile.

    out: the run's folder; planned: how many pictures there may be, from which their size follows.
    """

    def __init__(self, out: Path, planned: int) -> None:
        self._out = out
        self.width = next((width for most, width in _WIDTHS if planned <= most), _WIDTHS[-1][1])
        self.share = min(1.0, _WIDTHS[-1][0] / max(planned, 1))  # of the views that keep their pictures in the page
        self._pool = ThreadPoolExecutor(usable_cores())
        self._encoded: list[Future[list[Block]]] = []

    def picture(self, path: Path, kept: bool, has_holes: bool = False) -> dict[str, Any] | None:
        """Return what the page needs to show a picture; None where there is none.

        kept: whether the page holds a thumbnail of it; has_holes: whether pixels without a colour are to be marked.
        """
        if not path.is_file():
            return None
        link = "../" + quote("/".join(path.relative_to(self._out).parts))
        if not kept:
            return {"link": link}
        name = f"p{len(self._encoded)}"
        self._encoded.append(self._pool.submit(_blocks, name, path, self.width, has_holes))
        return {"id": name, "link": link}

    def blocks(self) -> Iterator[Block]:
        """Yield everything that was collected, in order, as it is ready."""
        for encoded in self._encoded:
            yield from encoded.result()
        self._pool.shutdown()


def _blocks(name: str, path: Path, width: int, has_holes: bool) -> list[Block]:
    import cv2

    try:
        image = decode(path, cv2.IMREAD_COLOR)
    except InputError:  # the page says that there is no picture
        return []
    small = _webp(_narrowed(image, width))
    wanted = ("confidence", *(["image"] if has_holes else []))
    arrays = read_full_arrays(path.with_suffix(".npz"), *wanted) if path.suffix == ".png" else {}
    return [Block(name, "image/webp", small), *_maps(name, image, arrays, has_holes)]


def _maps(name: str, image: Any, arrays: Mapping[str, Any], has_holes: bool) -> Iterable[Block]:
    """The holes of a restoration, and its confidence where it was kept."""
    if has_holes:
        kept = arrays.get("image")
        yield _holes(name, (image == 0).all(axis=-1) if kept is None else ~np.isfinite(kept).all(axis=-1))
    if "confidence" in arrays:
        yield from _confidence(name, arrays["confidence"])


def _holes(name: str, holes: npt.NDArray[np.bool_]) -> Block:
    """Holes as stripes over the picture."""
    share = _narrowed(holes.astype(np.uint8) * 255, _MAP_WIDTH)
    v, u = np.indices(share.shape)
    mark: Image = np.zeros((*share.shape, 4), dtype=np.uint8)
    mark[share > 127] = (90, 0, 150, 200)
    mark[(share > 127) & ((u + v) // 5 % 2 == 0)] = (220, 80, 255, 235)
    return Block(f"{name}-holes", "image/png", _png(mark))


def _confidence(name: str, values: npt.NDArray[np.float32]) -> Iterator[Block]:
    """A map from dark (small) to bright, between the percentiles 2 and 98."""
    import cv2

    known = np.isfinite(values)
    if not known.any():
        return
    low, high = (float(x) for x in np.percentile(values[known], [2, 98]))
    scaled = (np.where(known, values, low) - low) / (high - low if high > low else 1)
    painted = cv2.applyColorMap(_narrowed((scaled.clip(0, 1) * 255).astype(np.uint8), _MAP_WIDTH), cv2.COLORMAP_VIRIDIS)
    painted[_narrowed(known.astype(np.uint8) * 255, _MAP_WIDTH) < 128] = 0
    data = _webp(painted)
    yield Block(f"{name}-confidence", "image/webp", data, {"low": f"{low:.3g}", "high": f"{high:.3g}"})


def _narrowed(image: Any, width: int) -> Any:
    import cv2

    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def _webp(image: Any) -> str:
    """An image, BGR, as WebP in base64: method 2 takes half the time of the usual 4, for 5 % more bytes."""
    from PIL import Image as Pillow

    buffer = io.BytesIO()
    Pillow.fromarray(image[..., ::-1]).save(buffer, "WEBP", quality=_QUALITY, method=2)
    return base64.b64encode(buffer.getvalue()).decode()


def _png(image: Any) -> str:
    return base64.b64encode(encode_png(image)).decode()
