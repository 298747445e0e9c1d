"""The options of a degradation, and how they appear in labels and hashes."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from sucre_bench.arguments import checked_fields
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.plugins.options import check_ranges
from sucre_bench.scene import Water

_PLACE = "degrade.add_water"


def read_water(given: Any) -> Water:
    """Return a water given as a `Water`, or as nine numbers: B, beta and gamma, each RGB.

    Raises InputError for anything else, and for values out of range: B in [0, 1], beta and gamma >= 0.
    """
    encoding = None
    parts = given
    if isinstance(given, Water):
        encoding = given.encoding
        parts = [given.veiling_light, given.attenuation, given.backscatter]
    try:
        numbers = np.empty(0) if np.iscomplexobj(given) else np.array(parts, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(0)
    if numbers.size != 9:
        remedy = "give nine numbers, [B, beta, gamma] each RGB"
        raise InputError("not a water", _PLACE, remedy)
    B, beta, gamma = numbers.reshape(3, 3)
    if not (np.isfinite(numbers).all() and (numbers >= 0).all() and (B <= 1).all()):
        remedy = "B is in [0, 1], beta and gamma are at least 0 per metre"
        raise InputError("no water has these values", _PLACE, remedy)
    return Water(B, beta, gamma, encoding)


_VERSION = 1  # increase this when equal degradations give other data than before

_RANGES = {
    "within": "[0, inf)",
    "keep": "[1, inf)",
    "blur_px": "[0, 100]",
    "scale": "[0.01, 1]",
    "noise": "[0, 1]",
    "bits": "[1, 16]",
    "jpeg_quality": "[1, 100]",
    "depth_noise": "[0, 1]",
    "depth_noise_px": "[0, 1000]",
    "depth_holes": "[0, 0.99]",
    "depth_hole_px": "[0, 1000]",
    "pose_noise_m": "[0, 1000]",
    "pose_noise_deg": "[0, 180]",
    "seed": "[0, inf)",
}
# Options that choose views.
VIEWS = ("within", "keep")
_POSES = ("pose_noise_m", "pose_noise_deg")
_DEPTHS = ("add_water", "depth_noise", "depth_holes")
_RANDOM = ("noise", "depth_noise", "depth_holes", *_POSES)
# Options without effect if another is off.
_OF = {
    "depth_noise_px": ("depth_noise",),
    "depth_hole_px": ("depth_holes",),
    "seed": ("keep", *_RANDOM),
}


@dataclass(frozen=True)
@checked_fields
class Degradation:
    """A known way to make a dataset worse. The default changes nothing.

    >>> Degradation(noise=0.02, jpeg_quality=50).noise
    0.02
    """

    within: int | None = None
    """Keep only views at most this many frames before or after the target, in capture order; null: all."""
    keep: int | None = None
    """Keep only this many views, after `within`: the target and others drawn at random; null: all."""
    add_water: Any = None
    """Add water to the reference, or to the image if the scene has no references. Nine numbers [B, beta, gamma], each
    RGB. It becomes the true water; the dry image becomes the reference."""
    blur_px: float = 0.0
    """Blur the image in linear light with a Gaussian of this standard deviation, in pixels of the original; 0: none."""
    scale: float = 1.0
    """Resize image, depth, reference, camera and charts by this factor, 0.01 to 1; 1: keep the size."""
    noise: float = 0.0
    """Add Gaussian noise to the stored intensities: standard deviation as a share of full scale; 0: none."""
    bits: int | None = None
    """Round the stored intensities to this many bits a channel, 1 to 16; null: do not."""
    jpeg_quality: int | None = None
    """Pass the image through a JPEG file of this quality, 1 to 100; null: do not."""
    depth_noise: float = 0.0
    """Add Gaussian noise to the depth: standard deviation as a share of the depth; 0: none."""
    depth_noise_px: float = 0.0
    """Smooth the depth noise with a Gaussian of this standard deviation, in pixels; 0: do not."""
    depth_holes: float = 0.0
    """Remove the depth of this share of the pixels with depth; 0: none."""
    depth_hole_px: float = 10.0
    """Size of the holes: standard deviation of the Gaussian that shapes them, in pixels; 0: single pixels."""
    pose_noise_m: float = 0.0
    """Move camera centres at random: standard deviation along each axis, in metres; 0: do not."""
    pose_noise_deg: float = 0.0
    """Turn cameras at random: standard deviation about each axis, in degrees; 0: do not."""
    seed: int = 0
    """Seed of all random degradations; the seed of the run does not change it."""

    def __post_init__(self) -> None:
        check_ranges(self, "degrade", **_RANGES)
        _ = self.water

    @classmethod
    def of(cls, options: Mapping[str, Any]) -> Degradation:
        """Return the degradation of these options. Raises InputError for an unknown name or a value out of range."""
        known = {f.name for f in fields(cls)}
        for name in options:
            if name not in known:
                raise unknown_name(f"degrade.{name}", name, known)
        return cls(**options)

    @functools.cached_property
    def water(self) -> Water | None:
        """The water to add, as numbers."""
        return None if self.add_water is None else read_water(self.add_water)

    @property
    def chooses_views(self) -> bool:
        """Whether a scene's views depend on the target."""
        return self.within is not None or self.keep is not None

    @property
    def alters_pixels(self) -> bool:
        """Whether any plane of a view changes."""
        return bool(self.identity(without=(*VIEWS, *_POSES)))

    @property
    def record(self) -> dict[str, Any]:
        """The given options, as rows store them; empty if nothing is degraded."""
        return {name: getattr(self, name) for name in self._given()}

    def needs(self) -> Iterator[tuple[str, str]]:
        """Yield the options that need something of `Scene.has`, each with its need."""
        for name in self._given():
            if name in (*_DEPTHS, *_POSES):
                yield name, "depth" if name in _DEPTHS else "poses"

    def labelled(self, dataset: str) -> str:
        """Return a dataset's label with the degradation: different degradations have different labels."""
        words = {name: str(getattr(self, name)) for name in self._given()}
        if "add_water" in words:
            words["add_water"] = "_".join(map(str, self._water_numbers()))
        return ",".join([dataset, *(f"{name}={word}" for name, word in words.items())])

    def identity(self, without: Collection[str] = ()) -> tuple[object, ...]:
        """Return what identifies the degraded data, without some options."""
        given = [name for name in self._given() if name not in without]
        active = [
            name
            for name in given
            if name not in _OF or any(other in given for other in _OF[name])
        ]
        return tuple(
            (n, self._water_numbers() if n == "add_water" else float(getattr(self, n)))
            for n in active
        )

    def data_id(self, original: str) -> str:
        """Return the data_id of rows: a hash of a scene's data and of the degradation, for any target."""
        return hashed(original, *self.identity())

    def _given(self) -> list[str]:
        """The options that differ from their defaults."""
        given = []
        for field in fields(self):
            value = getattr(self, field.name)
            # an array does not compare as a whole
            if value is not field.default and (field.default is None or value != field.default):
                given.append(field.name)
        return given

    def _water_numbers(self) -> list[float | str]:
        water = self.water
        assert water is not None
        numbers = [
            float(x)
            for part in (water.veiling_light, water.attenuation, water.backscatter)
            for x in part
        ]
        return [*numbers, *([water.encoding] if water.encoding else [])]


def hashed(original: str, *done: object) -> str:
    """Return the data_id of changed data; the original's if nothing changed or it has none."""
    if not (original and done):
        return original
    return hashlib.blake2b(repr((_VERSION, original, done)).encode(), digest_size=6).hexdigest()
