"""Chooses how light that falls off across the images is removed: by a lamp's model, or by the place in the image.

A lamp (lamp.py) has a pose, and its light crosses the water too. It explains ground at varying distances better. Over
flat ground, or with daylight besides, both explain the observations equally well. Then the polynomial of the place
(falloff.py) is the simpler one, and it leaves no pixel out.
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import pixel_rays
from sucre_bench.methods.sucre.falloff import Falloff, without_falloff
from sucre_bench.methods.sucre.lamp import DARK, LampFit, lit
from sucre_bench.methods.sucre.sucre import typed
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import View

# A lamp is preferred if it leaves at most this share of the residuals that the polynomial leaves. On the deep-sea scene
# of `demo` it leaves .45, on surveys of flat ground .9 to 1.3.
_BETTER = 0.8

# Distances are alike if their percentile 95 is less than this many times their percentile 5.
_ALIKE = 1.5


class Removal(enum.Enum):
    """How uneven light was removed.

    UNSURE: not, because something else may be the cause; SINGLE_PIXELS: not, because of footprint=false.
    """

    NONE = "none"
    UNSURE = "unsure"
    SINGLE_PIXELS = "single_pixels"
    LAMP = "lamp"
    PLACE = "place"


_SENTENCES = {
    Removal.NONE: "the fitted water is wrong; use method.lamp=auto, which removes the falloff",
    Removal.UNSURE: "it explains too little to be removed; the fitted water may be wrong",
    Removal.SINGLE_PIXELS: "the fitted water is wrong; use method.footprint=true, which removes the falloff",
    Removal.LAMP: "a lamp on the camera was fitted, and its light removed",
    Removal.PLACE: "the falloff was removed; beta also holds how light falls with the distance from a lamp",
}


def sentence_of(falloff: Falloff, removal: Removal, options: Any) -> str:
    """Return what to say of a falloff; options: of `sucre`."""
    told = "" if falloff.is_separable or removal is Removal.LAMP else "distances do not separate it from attenuation; "
    lamp = typed(options, "lamp", True) if removal is Removal.UNSURE else ""
    remedy = f"; {lamp} fits a lamp" if lamp else ""
    return f"light falls off across the images, to {falloff.least:.0%} of its peak; {told}{_SENTENCES[removal]}{remedy}"


def explains_better(lamp: LampFit, falloff: Falloff) -> bool:
    """Return whether a lamp explains the observations clearly better than the place in the image."""
    return lamp.is_worth_it and lamp.noise < _BETTER * falloff.noise


@dataclass(frozen=True, eq=False)
class TargetLight:
    """The light on each pixel of the target.

    light: (H, W) in [0, 1], NaN where it is too dark; way: (H, W) metres through water, 0 = unknown.
    """

    light: Array
    way: Array


@dataclass(frozen=True, eq=False)
class UnevenLight:
    """A model of uneven light; lamp: None if the place in the image explains it as well."""

    falloff: Falloff | None
    lamp: LampFit | None

    @property
    def removal(self) -> Removal:
        return Removal.PLACE if self.lamp is None else Removal.LAMP

    def removed(self, observations: Observations) -> Observations:
        """Return the observations as they would be in even light; they need rays."""
        if self.lamp is not None:
            return lit(observations, self.lamp.lamp)
        assert self.falloff is not None
        return without_falloff(observations, self.falloff)

    def on(self, view: View) -> TargetLight:
        """Return the light on a view's pixels; the view needs a camera."""
        assert view.camera is not None
        rays = np.moveaxis(pixel_rays(view.camera), -1, 0)
        if self.lamp is None:
            assert self.falloff is not None
            return TargetLight(self.falloff.light(rays[:2]).astype(np.float32), view.distance)
        depth = view.depth.astype(np.float64)
        light, way = self.lamp.lamp.light(rays * depth)
        is_known = (depth > 0) & (light > DARK)
        lit_way = np.where(depth > 0, view.distance + way, 0)
        return TargetLight(np.where(is_known, light, np.nan).astype(np.float32), lit_way.astype(np.float32))

    def about(self) -> Mapping[str, Any]:
        """Return the record of the fit."""
        record: dict[str, Any] = {}
        if self.falloff is not None:
            record["falloff"] = record_of(self.falloff, self.removal)
        if self.lamp is not None:
            record["lamp"] = {
                **self.lamp.tested(),
                "lamp_from_cam": self.lamp.lamp.lamp_from_cam.tolist(),
                "precision": self.lamp.lamp.precision.tolist(),
            }
        return record


def record_of(falloff: Falloff, removal: Removal) -> dict[str, Any]:
    """Return the figures of a falloff, and how it was removed."""
    return {
        "least": falloff.least,
        "noise": falloff.noise,
        "noise_without": falloff.noise_without,
        "removed_by": removal.value,
    }


def limits_of_lamp(sample: Observations) -> tuple[str, ...]:
    """Say how wrong attenuation may be if distances are alike.

    Light may fall with the square of its way d from the lamp, which the lobe does not model. Over the whole way of
    about 2 d, that is d log(d^-2) / d(2 d) = -1 / d, as much as attenuation of 1 / d.
    """
    if not is_flat(sample):
        return ()
    near, middle, far = np.quantile(sample.distance, (0.05, 0.5, 0.95))
    return (
        f"distances are alike ({near:.3g} to {far:.3g} m), and a lamp's falloff with distance looks like attenuation "
        f"there: beta may be {1 / middle:.2g} 1/m too high",
    )


def is_flat(sample: Observations) -> bool:
    """Return whether distances are alike."""
    near, far = np.quantile(sample.distance, (0.05, 0.95))
    return bool(far <= _ALIKE * near)
