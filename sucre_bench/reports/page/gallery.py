"""The page's pictures: thumbnails in the page, and links to the full pictures.

A thumbnail is a WebP file in base64, in a block of its own that the page decodes when it shows it. The full picture
stays where it is, and the page reads it from there when someone looks closer.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from sucre_bench.arrays import Mask, Picture, coloured
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode
from sucre_bench.machine.cores import usable_cores
from sucre_bench.reports.page.hole_maps import Block, maps, narrowed, webp
from sucre_bench.results.masks import read_mask
from sucre_bench.results.restorations import read_full_arrays

# (most pictures of a page, their width in pixels), widest first.
Widths = Sequence[tuple[int, int]]

# How many pictures a page keeps, and how wide: 50 kB each at 960 pixels, 20 kB at 560, so that a page of 10 methods on
# 40 full-HD views stays below 40 MB, and no page goes beyond it.
WIDTHS: Widths = ((600, 960), (1400, 560))


class Gallery:
    """Collects pictures while sections are made, and encodes them meanwhile.

    out: the run's folder; planned: how many pictures there may be, from which their size follows by
    `widths`.
    """

    def __init__(self, out: Path, planned: int, widths: Widths = WIDTHS) -> None:
        self._out = out
        self.width = next((width for most, width in widths if planned <= most), widths[-1][1])
        self.share = min(1.0, widths[-1][0] / max(planned, 1))  # of the views that keep their pictures in the page
        self._pool = ThreadPoolExecutor(usable_cores())
        self._encoded: list[Future[list[Block]]] = []

    def picture(self, path: Path, kept: bool, mask: Path | None = None) -> dict[str, Any] | None:
        """Return what the page needs to show a picture; None where there is none.

        kept: whether the page holds a thumbnail of it; mask: where the mask is stored of a picture with holes.
        """
        if not path.is_file():
            return None
        link = "../" + quote("/".join(path.relative_to(self._out).parts))
        if not kept:
            return {"link": link}
        name = f"p{len(self._encoded)}"
        self._encoded.append(self._pool.submit(_blocks, name, path, self.width, mask))
        return {"id": name, "link": link}

    def blocks(self) -> Iterator[Block]:
        """Yield everything that was collected, in order, as it is ready."""
        for encoded in self._encoded:
            yield from encoded.result()
        self._pool.shutdown()


def _blocks(name: str, path: Path, width: int, mask: Path | None) -> list[Block]:
    import cv2

    try:
        image = decode(path, cv2.IMREAD_COLOR)
    except InputError:  # the page says that there is no picture
        return []
    small = webp(narrowed(image, width))
    arrays = read_full_arrays(path.with_suffix(".npz"), "confidence") if path.suffix == ".png" else {}
    holes = None if mask is None else ~_filled(mask, path, image)
    return [Block(name, "image/webp", small), *maps(name, holes, image, arrays.get("confidence"))]


def _filled(mask: Path, path: Path, image: Picture) -> Mask:
    """The pixels (H, W) with a colour: by the mask, else by the stored arrays, else all that are not black."""
    try:
        return read_mask(mask)
    except InputError:
        kept = read_full_arrays(path.with_suffix(".npz"), "image").get("image")
        return np.asarray(image.any(axis=-1)) if kept is None else coloured(kept)
