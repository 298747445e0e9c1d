"""Draws captions into pictures, maps of depth as pictures, and contact sheets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import IO, TYPE_CHECKING

import numpy as np

from sucre_bench.arrays import Array, Picture

if TYPE_CHECKING:
    import PIL.Image
    import PIL.ImageFont

# pixels between the pairs of a contact sheet, and of the height of a caption
_GAP = 8
_TEXT = 20


def font(size: int) -> PIL.ImageFont.FreeTypeFont:
    """Return a font with the letters of European languages, in pixels."""
    from matplotlib import get_data_path
    from PIL import ImageFont

    return ImageFont.truetype(Path(get_data_path()) / "fonts" / "ttf" / "DejaVuSans.ttf", size)


def captioned(picture: Picture, text: str) -> Picture:
    """Return a picture (H, W, 3) uint8 with a word on a dark ground in its upper left corner.

    Letters are a thirtieth of the picture's height, at least 11 pixels; what does not fit its width is cut.
    """
    from PIL import Image, ImageDraw

    size = max(11, picture.shape[0] // 30)
    letters = font(size)
    pad = size // 2
    while len(text) > 1 and letters.getlength(text) + 2 * pad > picture.shape[1]:
        text = text[:-1]
    wide, high = round(letters.getlength(text)) + 2 * pad, size + 2 * pad
    plate = Image.new("RGB", (wide, high), "#202020")
    ImageDraw.Draw(plate).text((pad, high // 2), text, fill="white", font=letters, anchor="lm")
    words = np.asarray(plate)[: picture.shape[0], : picture.shape[1]]
    marked = picture.copy()
    marked[: words.shape[0], : words.shape[1]] = words
    return marked


def contact_sheet(
    pairs: Sequence[tuple[PIL.Image.Image, PIL.Image.Image]],
    captions: Sequence[str],
    wide: int,
    top: int = _GAP,
) -> PIL.Image.Image:
    """Return pairs of pictures in one to three columns, each pair side by side above its caption, on white.

    wide: most pixels of a picture's width; top: pixels above the first pair.
    """
    from PIL import Image, ImageDraw

    columns = 1
    if len(pairs) > 3:
        columns = 2 if len(pairs) <= 12 else 3
    high = max(picture.height for pair in pairs for picture in pair) + _TEXT + _GAP
    across = 2 * wide + 2 + _GAP
    sheet = Image.new(
        "RGB", (columns * across + _GAP, top + -(-len(pairs) // columns) * high), "white"
    )
    pen, letters = ImageDraw.Draw(sheet), font(13)
    for place, (pair, caption) in enumerate(zip(pairs, captions, strict=True)):
        x, y = _GAP + place % columns * across, top + place // columns * high
        for left, picture in zip((x, x + wide + 2), pair, strict=True):
            sheet.paste(picture, (left, y))
        pen.text(
            (x, y + max(picture.height for picture in pair) + 2),
            caption,
            fill="black",
            font=letters,
        )
    return sheet


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
    coloured = cv2.applyColorMap(
        np.rint(255 * (1 - share)).astype(np.uint8), cv2.COLORMAP_TURBO
    )[..., ::-1].copy()
    coloured[depth <= 0] = unknown
    return np.asarray(coloured)
