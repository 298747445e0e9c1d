"""The page's pictures: thumbnails with marks of holes and maps of confidence, and links to the full pictures.

A thumbnail is a WebP file in base64, in a block of its own that the page decodes when it shows it. The full picture
stays where it is, and the page reads it from there when someone looks closer.
"""

import base64
import io
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from sucre_bench.arrays import Mask, Picture
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import encode_png, read_bgr_8bit
from sucre_bench.machine.compute import usable_cores
from sucre_bench.results.restorations import read_full_arrays, read_mask

# (most pictures of a page, their width in pixels), widest first.
Widths = Sequence[tuple[int, int]]

# How many pictures a page keeps, and how wide: 50 kB each at 960 pixels, 20 kB at 560, so that a page of 10 methods on
# 40 full-HD views stays below 40 MB, and no page goes beyond it.
WIDTHS: Widths = ((600, 960), (1400, 560))

_MAP_WIDTH = 480
_QUALITY = 75


@dataclass(frozen=True)
class Block:
    """A picture in the page."""

    name: str
    kind: str

    data: str
    """In base64."""

    about: dict[str, str] = field(default_factory=dict)
    """Attributes, such as the range of a map."""


class Gallery:
    """Collects pictures while sections are made, and encodes them meanwhile.

    out: the run's folder; planned: how many pictures there may be, from which their size follows by
    `widths`.
    """

    def __init__(self, out: Path, planned: int, widths: Widths = WIDTHS) -> None:
        self._out = out
        self._width = next((width for most, width in widths if planned <= most), widths[-1][1])
        # of the views that keep their pictures in the page
        self.share = min(1.0, widths[-1][0] / max(planned, 1))
        self._pool = ThreadPoolExecutor(usable_cores())
        self._encoded: list[Future[list[Block]]] = []

    def picture(self, path: Path, kept: bool, has_holes: bool = False) -> dict[str, Any] | None:
        """Return what the page needs to show a picture; None where there is none.

        kept: whether the page holds a thumbnail of it.
        """
        if not path.is_file():
            return None
        link = {"link": "../" + quote("/".join(path.relative_to(self._out).parts))}
        if not kept:
            return link
        name = f"p{len(self._encoded)}"
        self._encoded.append(self._pool.submit(_blocks, name, path, self._width, has_holes))
        return {"id": name} | link

    def blocks(self) -> Iterator[Block]:
        """Yield everything that was collected, in order, as it is ready."""
        for encoded in self._encoded:
            yield from encoded.result()
        self._pool.shutdown()


def _blocks(name: str, path: Path, width: int, has_holes: bool) -> list[Block]:
    """The thumbnail of a picture, and the maps of its holes and its confidence, where it has some."""
    import cv2

    try:
        image = read_bgr_8bit(path)
    except InputError:  # the page says that there is no picture
        return []
    blocks = [Block(name, "image/webp", _webp(_narrowed(image, width)))]
    with suppress(InputError):  # a damaged mask
        mask = read_mask(path) if has_holes else None
        if mask is not None and mask.shape == image.shape[:2]:
            blocks.append(_holes(name, mask, image))
    if path.suffix != ".png":
        return blocks
    confidence = read_full_arrays(path.with_suffix(".npz"), "confidence").get("confidence")
    if confidence is not None and np.isfinite(confidence).any():
        # From dark (small) to bright, between the percentiles 2 and 98.
        known = np.isfinite(confidence)
        low, high = np.percentile(confidence[known], [2, 98])
        scaled = (np.where(known, confidence, low) - low) / (high - low if high > low else 1)
        small = _narrowed((scaled.clip(0, 1) * 255).astype(np.uint8), _MAP_WIDTH)
        painted = cv2.applyColorMap(small, cv2.COLORMAP_VIRIDIS)
        painted[_narrowed(known.astype(np.uint8) * 255, _MAP_WIDTH) < 128] = 0
        about = {"low": f"{low:.3g}", "high": f"{high:.3g}"}
        blocks.append(Block(f"{name}-confidence", "image/webp", _webp(painted), about))
    return blocks


def _holes(name: str, filled: Mask, image: Picture) -> Block:
    """Holes as stripes over the picture, which the style sheet lets shine through.

    filled: (H, W), the picture's mask. If holes are not black, `fill=true` guessed their colours.
    """
    share = _narrowed((~filled).astype(np.uint8) * 255, _MAP_WIDTH)
    v, u = np.indices(share.shape)
    mark = np.zeros((*share.shape, 4), dtype=np.uint8)
    mark[share > 127] = (90, 0, 150, 255)
    mark[(share > 127) & ((u + v) // 5 % 2 == 0)] = (220, 80, 255, 255)
    about = {"guesses": f"{1 - filled.mean():.6f}"} if image[~filled].any() else {}
    return Block(
        f"{name}-holes", "image/png", base64.b64encode(encode_png(mark)).decode(), about
    )


def _narrowed(image: Any, width: int) -> Any:
    """An image shrunk to a width in pixels, if it is wider."""
    import cv2

    if image.shape[1] <= width:
        return image
    height = max(1, round(image.shape[0] * width / image.shape[1]))
    return cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)


def _webp(image: Picture) -> str:
    """An image, BGR, as WebP in base64. Method 2 takes half the time of the default 4, for 5 % more bytes."""
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(image[..., ::-1]).save(buffer, "WEBP", quality=_QUALITY, method=2)
    return base64.b64encode(buffer.getvalue()).decode()
