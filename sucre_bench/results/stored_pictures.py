"""Reads the pictures and masks of a results folder to score them again; no method runs a second time."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask, Picture
from sucre_bench.errors import DamagedFileError, InputError, MissingFileError, NotApplicableError
from sucre_bench.imaging.image_files import decode
from sucre_bench.results.layout import Place
from sucre_bench.results.masks import read_mask
from sucre_bench.results.reasons import Reason
from sucre_bench.results.restorations import read_full
from sucre_bench.results.rows import Row
from sucre_bench.scene import Restoration


class PictureOnly(Restoration):
    """A restoration of which there are picture and mask, but not the computed image.

    Asking for `image` raises NotApplicableError. mask: (H, W), the pixels with a colour; reason: why it is not there.
    """

    def __init__(self, mask: Mask, reason: Reason = Reason.NOT_STORED) -> None:
        object.__setattr__(self, "_reason", reason)
        object.__setattr__(self, "_mask", mask)
        object.__setattr__(self, "info", {})

    def __getattr__(self, name: str) -> Any:
        if name == "image":
            raise NotApplicableError(self.__dict__["_reason"].value)
        raise AttributeError(name)

    def at_size(self, side: int) -> PictureOnly:
        """Return the same for a square of other size, where holes are black pixels."""
        return PictureOnly(np.ones((side, side), np.bool_), self.__dict__["_reason"])

    @property
    def valid(self) -> Mask:
        mask: Mask = self.__dict__["_mask"]
        return mask


def stored_picture(out: Path, place: Place, method: str) -> Picture:
    """Return a restored image (H, W, 3), uint8 RGB, holes black. Raises MissingFileError or DamagedFileError."""
    import cv2

    path = place.restored(out, method)
    if not path.is_file():
        raise MissingFileError("is gone", path, "repeat its run's command")
    return np.ascontiguousarray(decode(path, cv2.IMREAD_COLOR)[..., ::-1])


def stored_mask(out: Path, place: Place, base: Row) -> Mask:
    """Return which pixels (H, W) of a restoration have a colour. base: its row, which says how many they are.

    Where the mask is gone, it is taken from save=full, or from the picture if that has no black but its holes.
    Raises InputError if the mask is gone or damaged.
    """
    try:
        mask = read_mask(place.mask(out, base.method))
    except InputError:
        known = _mask_of_arrays(out, place, base)
        mask = known if known is not None else np.asarray(stored_picture(out, place, base.method).any(-1))
        if int(mask.sum()) != base.n_pixels:
            raise
    if int(mask.sum()) != base.n_pixels:
        path = place.mask(out, base.method)
        raise DamagedFileError("is of another restoration", path, f"run {base.method} again with overwrite=always")
    return mask


def _mask_of_arrays(out: Path, place: Place, base: Row) -> Mask | None:
    kept = read_full(place.restored(out, base.method).with_suffix(".npz"), base)
    return kept.restoration.valid if kept else None


def stored_restoration(out: Path, place: Place, base: Row, mask: Mask) -> Restoration:
    """Return a restoration with holes outside a mask (H, W); with its computed image if save=full stored it."""
    kept = read_full(place.restored(out, base.method).with_suffix(".npz"), base)
    if kept is None:
        return PictureOnly(mask)
    restored = kept.restoration
    return Restoration(masked(restored.image, mask), restored.water, restored.confidence, restored.info)


def masked(image: Array, mask: Mask) -> Array:
    """Return an image (H, W, 3) as float32 with NaN outside a mask (H, W)."""
    return np.where(mask[..., None], image, np.float32(np.nan)).astype(np.float32)
