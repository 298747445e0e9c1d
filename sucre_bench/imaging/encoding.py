"""Encodings of intensities: sRGB gamma, linear, 8 bit; and the palette of an 8-bit picture."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Mask, locked, once
from sucre_bench.machine.compute import compiled
from sucre_bench.scene import Encoding


def srgb_decode(encoded: Array) -> Array:
    """sRGB transfer function inverted, [0, 1] -> linear [0, 1] (IEC 61966-2-1); the curve goes on beyond."""
    return np.where(
        encoded <= 0.04045, encoded / 12.92, ((np.maximum(encoded, 0) + 0.055) / 1.055) ** 2.4
    )


def srgb_encode(linear: Array) -> Array:
    """sRGB transfer function, linear [0, 1] -> [0, 1] (IEC 61966-2-1); the curve goes on beyond."""
    return np.where(
        linear <= 0.0031308, linear * 12.92, 1.055 * np.maximum(linear, 0) ** (1 / 2.4) - 0.055
    )


def converted(image: Array, source: Encoding, target: Encoding) -> Array:
    """Return an image in another encoding, "gamma" being sRGB's curve; itself where it is encoded so already."""
    if source == target:
        return image
    return srgb_decode(image) if target == "linear" else srgb_encode(image)


def is_grey(image: AnyArray) -> bool:
    """Whether an image (H, W, 3) has no colours: in each pixel all channels are equal. A black one is not grey."""
    # a few pixels tell most images from grey ones
    few = image[::16, ::16]
    return all(bool((part == part[..., :1]).all()) for part in (few, image)) and bool(
        image.any()
    )


def to_8bit(shown: Array) -> np.ndarray:
    """Round a picture in [0, 1] to uint8; pixels without colour become black (SUCRe's convention)."""
    return to_levels(shown, 8)


def to_levels(shown: Array, bits: int) -> np.ndarray:
    """Round a picture in [0, 1] to uint8 or uint16, of 8 or 16 bits; pixels without colour become black."""
    levels = np.empty(shown.shape, np.uint8 if bits == 8 else np.uint16)
    rows = 64
    for start in range(0, len(shown), rows):  # pictures of 100 megapixels are 1.2 GB
        band = slice(start, start + rows)
        levels[band] = np.nan_to_num(shown[band], nan=0.0).clip(0, 1) * (2**bits - 1) + 0.5
    return levels


Bytes = npt.NDArray[np.uint8]


@dataclass(frozen=True, slots=True, eq=False)
class EightBit:
    """A picture of 8 bits."""

    planes: Bytes
    """Red, green, blue, (3, H, W) uint8; 0 where there is no colour."""

    valid: Mask
    """Where there is a colour, (H, W)."""

    n_valid: int
    """How many pixels have a colour."""

    @property
    def is_whole(self) -> bool:
        """Whether every pixel has a colour."""
        return self.n_valid == self.valid.size


@dataclass(frozen=True, slots=True, eq=False)
class Palette:
    """The colours of a picture."""

    rgb: Bytes
    """Each colour once, (U, 3) uint8."""

    counts: npt.NDArray[np.int64]
    """Pixels of each colour, (U,)."""


@once
def eight_bit(shown: AnyArray) -> EightBit:
    """Round a picture (H, W, 3) in [0, 1] to 8 bits; a pixel has a colour where all three channels are finite."""
    height, width, _ = shown.shape
    planes, valid = np.empty((3, height, width), np.uint8), np.empty((height, width), np.bool_)
    n_valid = compiled(_round)(locked(shown), planes, valid)
    return EightBit(locked(planes), locked(valid), int(n_valid))


def _round(shown: Array, planes: Bytes, valid: Mask) -> int:
    """In float32, as `colour.to_8bit` does."""
    n_valid = 0
    zero, one, scale, half = np.float32(0), np.float32(1), np.float32(255), np.float32(0.5)
    for row in range(shown.shape[0]):
        for column in range(shown.shape[1]):
            total = shown[row, column, 0] + shown[row, column, 1] + shown[row, column, 2]
            known = total - total == 0  # False for NaN and infinity
            valid[row, column] = known
            n_valid += known
            for channel in range(3):
                level = np.float32(shown[row, column, channel]) if known else zero
                planes[channel, row, column] = np.uint8(
                    min(max(level, zero), one) * scale + half
                )
    return n_valid


_FEW_PIXELS = 500_000  # that are sorted sooner than a table of all colours is searched


@once
def palette(shown: AnyArray) -> Palette:
    """Return the colours of a picture (H, W, 3) in [0, 1], rounded to 8 bits; none where nothing has a colour."""
    picture = eight_bit(shown)
    codes: AnyArray
    counts: AnyArray
    if picture.n_valid < _FEW_PIXELS:
        flat = picture.planes.reshape(3, -1)
        red, green, blue = (
            flat if picture.is_whole else flat[:, picture.valid.ravel()]
        ).astype(np.uint32)
        codes, counts = np.unique(red << 16 | green << 8 | blue, return_counts=True)
    else:
        table = np.zeros(1 << 24, np.uint32)
        compiled(_count_colours)(picture.planes, picture.valid, table)
        codes = np.flatnonzero(table)
        counts = table[codes]
    rgb = np.ascontiguousarray(codes.astype("<u4").view(np.uint8).reshape(-1, 4)[:, 2::-1])
    return Palette(locked(rgb), locked(counts.astype(np.int64)))


def _count_colours(planes: Bytes, valid: Mask, counts: npt.NDArray[np.uint32]) -> None:
    for row in range(valid.shape[0]):
        for column in range(valid.shape[1]):
            if valid[row, column]:
                red, green, blue = (
                    planes[0, row, column],
                    planes[1, row, column],
                    planes[2, row, column],
                )
                counts[np.uint32(red) << 16 | np.uint32(green) << 8 | np.uint32(blue)] += 1
