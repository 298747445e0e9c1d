"""Writes a caption into a corner of a picture."""

import numpy as np

from sucre_bench.arrays import Picture


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
