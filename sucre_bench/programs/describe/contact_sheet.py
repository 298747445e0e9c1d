"""The contact sheet: each view with its charts outlined, beside its depth in colours; one colour scale for all."""

import io
from collections.abc import Sequence
from typing import Any

import numpy as np

from sucre_bench.arrays import evenly
from sucre_bench.imaging.drawing import depth_colours
from sucre_bench.programs.describe.view_facts import Look, ViewFacts

_MOST = 60  # views on a sheet, evenly chosen
_WIDE, _GAP, _TEXT, _HEAD = 300, 8, 20, 64  # pixels
_GRAY = 128


def contact_sheet(
    title: str, facts: Sequence[ViewFacts], looks: Sequence[Look], unit: str = "m", suffix: str = ".png"
) -> bytes:
    """Return the sheet as an image file with that suffix. unit: of distances."""
    from PIL import Image, ImageDraw, ImageFont

    chosen = evenly(len(looks), _MOST)
    columns = 1 if len(chosen) <= 3 else 2 if len(chosen) <= 12 else 3
    high = max(_height(looks[k]) for k in chosen)
    tile = (2 * _WIDE + 2 + _GAP, high + _TEXT + _GAP)
    rows = -(-len(chosen) // columns)
    sheet = Image.new("RGB", (columns * tile[0] + _GAP, _HEAD + rows * tile[1] + _GAP), "white")
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(14)
    low, top = _range(looks)
    pen.text((_GAP, _GAP), title, fill="black", font=ImageFont.load_default(18))
    bar = np.tile(np.linspace(low, top, 256), (10, 1))
    sheet.paste(Image.fromarray(depth_colours(bar, low, top, _GRAY)), (_GAP, 34))
    pen.text((_GAP + 264, 30), f"distance {low:.3g} to {top:.3g} {unit}, gray: unknown", fill="black", font=font)
    for place, k in enumerate(chosen):
        row, column = divmod(place, columns)
        at = (_GAP + column * tile[0], _HEAD + row * tile[1])
        sheet.paste(_tile((tile[0] - _GAP, tile[1] - _GAP), facts[k], looks[k], (low, top)), at)
    content = io.BytesIO()
    sheet.save(content, "PNG" if suffix.lower() == ".png" else "JPEG", quality=92)
    return content.getvalue()


def _tile(size: tuple[int, int], view: ViewFacts, look: Look, limits: tuple[float, float]) -> Any:
    """Return one view as a picture of that size. limits: the distances at the ends of the colour scale."""
    from PIL import Image, ImageDraw, ImageFont

    tile = Image.new("RGB", size, "white")
    pen, font = ImageDraw.Draw(tile), ImageFont.load_default(14)
    high = _height(look)
    depth = None if look.distance is None else depth_colours(look.distance, *limits, _GRAY)
    for x, picture, absent, how in (
        (0, look.picture, "cannot be read", Image.Resampling.BOX),
        (_WIDE + 2, depth, "no depth", Image.Resampling.NEAREST),
    ):
        if picture is None:
            pen.rectangle((x, 0, x + _WIDE - 1, high - 1), fill="#dddddd")
            pen.text((x + 8, 8), absent, fill="black", font=font)
        else:
            tile.paste(Image.fromarray(picture).resize((_WIDE, high), how), (x, 0))
    if look.picture is not None:
        for corners in look.charts * (_WIDE / look.picture.shape[1]):
            pen.line([tuple(corner) for corner in (*corners, corners[0])], fill="#ff2d6f", width=2)
    said = f"{view.name}   depth on {view.coverage:.0%}" if view.has_depth else view.name
    pen.text((0, high + 2), said[-80:], fill="black", font=font)
    return tile


def _height(look: Look) -> int:
    plane = look.picture if look.picture is not None else look.depth
    return _WIDE * 3 // 4 if plane is None else max(1, round(_WIDE * plane.shape[0] / plane.shape[1]))


def _range(looks: Sequence[Look]) -> tuple[float, float]:
    """The distances at the ends of the colour scale: percentiles 1 and 99 of all."""
    known = [distance[distance > 0][::16] for look in looks if (distance := look.distance) is not None]
    values = np.concatenate(known) if known else np.empty(0)
    if not values.size:
        return 0.0, 1.0
    low, top = (float(v) for v in np.percentile(values, [1, 99]))
    return low, max(top, low * 1.001)
