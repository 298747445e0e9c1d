"""Display normalisations: they make the restored image from the result of a method.

A display normalisation has a name, and each score records it:

- "none" clips to [0, 1];
- "stretch-1-99" maps percentiles 1 and 99 of each channel to 0 and 1, and clips (SUCRe, sec. 4.2). Any two percentiles
  are allowed;
- "linear-stretch-1-99" does the same in linear light;
- "gray-world" scales each channel to the mean of all channels (Buchsbaum 1980);
- "white-99" scales each channel so that its percentile 99 becomes 1 (the white patch of Land 1977), and leaves black
  unchanged;
- "black-1-white-99" first subtracts one black from all channels: percentile 1 of all their values. A black for each
  channel would change hues;
- "linear-white-veil" scales linear light by 1 / (B gamma) of the water. Backscatter near the camera has the colour of
  the light that falls on the scene. One gain for all channels then maps percentile 99 of all values to 1.

With "@scene" behind the name, as in "stretch-1-99@scene", percentiles and means are those of all views of a scene, so
that mosaics and videos have one tone.
"""

import functools
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array, coloured, locked
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.percentiles import channel_percentiles
from sucre_bench.machine.compute import compiled
from sucre_bench.scene import Encoding, Restoration, Water

_Kind = Literal["none", "gray-world", "white", "stretch", "black-white", "veil"]
_P = r"(\d+(?:\.\d+)?)"  # a percentile
_FORMS: dict[_Kind, str] = {
    "none": "none",
    "gray-world": "gray-world",
    "white": f"white-{_P}",
    "stretch": f"(?:linear-)?stretch-{_P}-{_P}",
    "black-white": f"black-{_P}-white-{_P}",
    "veil": "linear-white-veil",
}
_KNOWN = (
    "none, gray-world or stretch-LOW-HIGH such as stretch-1-99, linear-stretch-1-99 in linear light, white-99, "
    "black-1-white-99, linear-white-veil; @scene behind it takes all views of a scene"
)


@dataclass(frozen=True)
class Normalisation:
    """What the name of a display normalisation says."""

    kind: _Kind

    # The percentiles that become 0 and 1.
    low: float
    high: float

    is_linear: bool
    """Whether it works in linear light."""

    is_of_scene: bool
    """Whether percentiles and means are those of all views of a scene."""

    @property
    def removes_offsets(self) -> bool:
        """Whether it subtracts a black of its own from each channel, whatever the water."""
        return self.kind == "stretch"


@functools.cache
def normalisation(how: str) -> Normalisation:
    """Return what the name of a display normalisation says. Raises InputError for a name that none has."""
    name = how.removesuffix("@scene")
    for kind, form in _FORMS.items():
        if found := re.fullmatch(form, name):
            low, high = (0.0, *([float(text) for text in found.groups()] or [100.0]))[-2:]
            if 0 <= low < high <= 100:
                return Normalisation(kind, low, high, name.startswith("linear-"), name != how)
    raise InputError("unknown", f"display '{how}'", f"use {_KNOWN}")


def display(
    image: Array,
    how: str,
    encoding: Encoding = "gamma",
    *,
    water: Water | None = None,
    over: Array | None = None,
) -> Array:
    """Return the restored image: (H, W, 3) float32 in [0, 1], gamma-encoded, NaN = no colour.

    - image: (H, W, 3), any range, NaN = no colour;
    - how: the name of a normalisation;
    - encoding: encoding of the image, "gamma" or "linear";
    - water: the estimated water, for "linear-white-veil";
    - over: (H, W, 3) or (N, 1, 3), the colours whose percentiles and means are used; default the image's own.

    Raises InputError for an unknown name, for "linear-white-veil" without a water, and for "@scene" without `over`.
    """
    chosen = normalisation(how)
    by_veil = chosen.kind == "veil"
    if chosen.is_of_scene and over is None:
        raise InputError(
            f"display '{how}': needs all views of the scene; use `sucre-bench run` with save=full"
        )
    may_stay = (
        chosen.kind == "none"
        and encoding == "gamma"
        and not by_veil
        and image.dtype == np.float32
    )
    if may_stay and image.size and image.min() >= 0 and image.max() <= 1:
        return image  # nothing to clip, no NaN: no picture of 12 megapixels is copied
    over = image if over is None else over
    if (chosen.is_linear or by_veil) and encoding == "gamma":
        image = _by_rows(srgb_decode, image)
        over = _by_rows(srgb_decode, over)
        encoding = "linear"
    shown = np.empty(image.shape, dtype=np.float32)
    veil = (
        water.veiling_light * water.backscatter
        if by_veil and water is not None
        else np.full(3, np.nan)
    )
    has_veil = bool((np.isfinite(veil) & (veil > 0)).all())
    limits = _limits(over, chosen, veil.mean() / veil if has_veil else None)
    compiled(_rescale)(locked(image), *limits, shown)
    return _by_rows(srgb_encode, shown) if encoding == "linear" else shown


def displayed(
    restoration: Restoration, how: str, encoding: Encoding, over: Array | None = None
) -> tuple[Array, Array | None]:
    """Return the restored image, see `display`, and its filled pixels shown alike; None where it has none."""
    shown = display(restoration.image, how, encoding, water=restoration.water, over=over)
    if restoration.filled is None:
        return shown, None
    over = restoration.image if over is None else over
    return shown, display(restoration.filled, how, encoding, water=restoration.water, over=over)


def is_of_scene(how: str) -> bool:
    """Return whether a normalisation takes percentiles and means over all views of a scene."""
    return normalisation(how).is_of_scene


def _limits(
    image: Array, chosen: Normalisation, veil_gains: Array | None
) -> tuple[Array, Array]:
    """Return what to subtract from each channel (3,), and what to divide it by then.

    veil_gains: (3,), which make light of the veil's colour white.
    """
    nothing, one = np.zeros(3), np.ones(3)
    valid = coloured(image)
    if veil_gains is not None:
        top = float(np.percentile(image[valid] * veil_gains, 99)) if valid.any() else 1.0
        return nothing, np.asarray((top if top > 1e-6 else 1.0) / veil_gains)
    if chosen.kind == "veil":
        raise InputError(
            "display 'linear-white-veil': the method estimates no veil; use white-99 or stretch-1-99"
        )
    if chosen.kind == "none" or not valid.any():
        return nothing, one
    if chosen.kind == "black-white":
        (white,) = channel_percentiles(image, [chosen.high], valid)
        lowest = float(np.percentile(image[valid], chosen.low))
        return np.full(3, lowest), np.where(white - lowest > 1e-6, white - lowest, 1)
    if chosen.kind == "gray-world":
        return nothing, 1 / _gain_of_means(
            np.array([image[valid, c].mean(dtype=np.float64) for c in range(3)])
        )
    if chosen.kind == "white":
        (white,) = channel_percentiles(image, [chosen.high], valid)
        return nothing, np.where(white > 1e-6, white, 1)
    low, high = channel_percentiles(image, [chosen.low, chosen.high], valid)
    flat = high - low < 1e-6
    return np.where(flat, 0, low), np.where(flat, 1, high - low)


def _rescale(image: Array, low: Array, span: Array, shown: Array) -> None:
    """Write (image - low) / span to `shown`, clipped to [0, 1], computed in float64; NaN if a channel is not finite."""
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            known = True
            for channel in range(3):
                known = known and np.isfinite(image[row, column, channel])
            for channel in range(3):
                value = (np.float64(image[row, column, channel]) - low[channel]) / span[channel]
                shown[row, column, channel] = min(max(value, 0.0), 1.0) if known else np.nan


def _by_rows(curve: Callable[[Array], Array], image: Array, rows: int = 64) -> Array:
    """Return a curve of an image (H, W, 3) as float32, computed in float64 on a few rows at a time."""
    curved = np.empty(image.shape, dtype=np.float32)
    for start in range(0, len(image), rows):
        band = slice(start, start + rows)
        curved[band] = curve(image[band].astype(np.float64))
    return curved


def stretch(image: Array, low: float = 1, high: float = 99, over: Array | None = None) -> Array:
    """Map the percentiles low and high of each channel to 0 and 1, and clip. A constant channel is only clipped.

    image: (..., 3); over: (P, 3) pixels to take the percentiles of, default the image's own.
    """
    bottom, top = channel_percentiles(image if over is None else over, [low, high])
    flat = top - bottom < 1e-6
    scaled = (image - np.where(flat, 0, bottom)) / np.where(flat, 1, top - bottom)
    return np.asarray(scaled.clip(0, 1))


def gray_world_gain(pixels: Array) -> Array:
    """Return the (3,) factors that bring each channel's mean (P, 3) to that of all; 1 for one that is not positive."""
    return _gain_of_means(pixels.mean(axis=0, dtype=np.float64))


def _gain_of_means(mean: Array) -> Array:
    usable = mean > 1e-6
    return np.asarray(np.where(usable, mean.mean() / np.where(usable, mean, 1), 1))
