"""Scores on common pixels: of each view, the pixels that all methods fill.

They are rows of the score table whose variant ends in `rows.COMMON`, beside those on each method's own pixels. The
`code` of a score is that of the score on own pixels, with the hash of the common mask at its end.

A row of metric "common_pixels" and no method stands for a view: its value is the share of the image that all methods
fill, its `code` the hash of the mask, "" where there is none, and its `options` name the methods.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import DataFrame, Mask
from sucre_bench.errors import InputError
from sucre_bench.results.rows import restorations

# The metric of the row that stands for a view.
COMMON_PIXELS = "common_pixels"

# "equal": methods fill the same pixels, so nothing is scored; "common": they do not; "none": they share no pixel;
# "unknown": a mask or picture cannot be read.
Kind = Literal["equal", "common", "none", "unknown"]

# A view is scored on common pixels if more than this share of the image is filled by some methods only.
LEAST_DIFFERENCE = 0.01

# A method that fills a smaller share of an image would leave the others next to nothing: it has no score of this view.
LEAST_FILLED = 0.01


def kind_of(status: str, code: str) -> Kind:
    """Return what the row that stands for a view says of its common pixels."""
    if status == "ok":
        return "common" if code else "equal"
    return "none" if status == "skipped" else "unknown"


def methods_of(options: str) -> set[str]:
    """Return the methods that the row that stands for a view names; none if it does not name them in a list."""
    names = json.loads(options).get("methods")
    return {*map(str, names)} if isinstance(names, list) else set()


def filled_restorations(rows: DataFrame) -> DataFrame:
    """Return the rows of restorations that fill enough of their view to take part."""
    whole = restorations(rows)
    return whole[whole["coverage"] >= LEAST_FILLED]


@dataclass(frozen=True)
class CommonPixels:
    """The pixels of a view that all methods fill."""

    mask: Mask
    """(H, W)."""

    share: float
    """Which part of the image they are."""

    kind: Kind
    """Whether scores are on them."""

    id: str
    """Hash of the mask; "" if no scores are on them."""


def common_pixels(masks: Mapping[str, Mask | None]) -> CommonPixels:
    """Return the pixels that all methods fill.

    masks: by method, the pixels (H, W) with a colour; None for a method that fills all of them, but not for all
    methods. Raises InputError for masks of different sizes.
    """
    holed = {name: mask for name, mask in masks.items() if mask is not None}
    (_, first), *others = holed.items()
    for name, mask in others:
        if mask.shape != first.shape:
            own, other = (f"{w}x{h}" for h, w in (mask.shape, first.shape))
            remedy = "run that method again with overwrite=always"
            raise InputError(f"is {own}, others are {other}", f"the mask of {name}", remedy)
    common = np.logical_and.reduce([*holed.values()])
    some = (
        1.0
        if len(holed) < len(masks)
        else float(np.logical_or.reduce([*holed.values()]).mean())
    )
    share = float(common.mean())
    if some - share <= LEAST_DIFFERENCE:
        return CommonPixels(common, share, "equal", "")
    if not common.any():
        return CommonPixels(common, share, "none", "")
    content = str(common.shape).encode() + np.packbits(common).tobytes()
    hash_of_mask = hashlib.blake2b(content, digest_size=8).hexdigest()
    return CommonPixels(common, share, "common", hash_of_mask)
