"""Draws captions into pictures, and maps of depth as pictures."""

from __future__ import annotations

from typing import IO, TYPE_CHECKING

import numpy as np

from sucre_bench.arrays import Array, Picture

if TYPE_CHECKING:
    import PIL.Image


def captioned(picture: Picture, text: str, right: bool = False) -> Picture:
    """Return a picture (H, W, 3) uint8 with a word on a dark ground in its upper left corner, or the right one.

    Letters are a thirtieth of the picture's height, at least 11 pixels; what does not fit its width is cut.
    """
    from PIL import Image, ImageDraw, ImageFont

    size = max(11, picture.shape[0] // 30)
    font, pad = ImageFont.load_default(size), size // 2
    while len(text) > 1 and font.getlength(text) + 2 * pad > picture.shape[1]:
        text = text[:-1]
    wide, high = round(font.getlength(text)) + 2 * pad, size + 2 * pad
    plate = Image.new("RGB", (wide, high), "#202020")
    ImageDraw.Draw(plate).text((pad, high // 2), text, fill="white", font=font, anchor="lm")
    words = np.asarray(plate)[: picture.shape[0], : picture.shape[1]]
    marked = picture.copy()
    place = slice(-words.shape[1], None) if right else slice(words.shape[1])
    marked[: words.shape[0], place] = words
    return marked


def save_marked(file: IO[bytes], picture: PIL.Image.Image, suffix: str) -> None:
    """Write a picture as a PNG or, for any other suffix, a JPEG, with a comment that sucre_bench wrote it."""
    from PIL.PngImagePlugin import PngInfo

    if suffix.lower() == ".png":
        mark = PngInfo()
        mark.add_text("Software", "sucre_bench")
        picture.save(file, "PNG", pnginfo=mark)
    else:
        picture.save(file, "JPEG", quality=92, comment="sucre_bench")


def depth_colours(depth: Array, near: float, far: float, unknown: int) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 RGB of a map (h, w), 0 = unknown.

    near, far: the values at the ends of the colour map; unknown: the gray, 0 to 255, for unknown values.
    """
    import cv2

    share = ((depth - near) / max(far - near, 1e-9)).clip(0, 1)
    coloured = cv2.applyColorMap(np.rint(255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO)[..., ::-1].copy()
    coloured[depth <= 0] = unknown
    return np.asarray(coloured)
