"""What a notebook shows of a scene, a view or a restoration: small pictures with captions, above their text."""

import base64
import io
from collections.abc import Mapping
from html import escape

import numpy as np

from sucre_bench.arrays import Array

_WIDTH = 240  # pixels, at most


def as_html(text: str, pictures: Mapping[str, Array]) -> str:
    """Return a piece of a page: pictures (H, W, 3) side by side, by caption, and the text below.

    Pictures are gamma-encoded, 1 is white, and NaN, no colour, is black. Captions and text are escaped.
    """
    figures = [
        f'<figure style="display:inline-block;margin:0 8px 8px 0"><img src="{_jpeg(picture)}" alt="{escape(caption)}">'
        f"<figcaption>{escape(caption)}</figcaption></figure>"
        for caption, picture in pictures.items()
    ]
    return f"<div>{''.join(figures)}<pre>{escape(text)}</pre></div>"


def _jpeg(picture: Array) -> str:
    """The address of a small copy of a picture, which holds its bytes."""
    from PIL import Image

    small = Image.fromarray((np.nan_to_num(picture, nan=0).clip(0, 1) * 255).astype(np.uint8))
    small.thumbnail((_WIDTH, small.height))
    encoded = io.BytesIO()
    small.save(encoded, "JPEG")
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.getvalue()).decode()}"
