"""Sea-thru (Akkaynak & Treibitz 2019), for 8-bit images: Sea-thru* of the SUCRe paper.

D. Akkaynak and T. Treibitz, Sea-thru: A Method for Removing Water From Underwater Images, CVPR 2019. The method is made
for raw images. SUCRe's authors adapted it to 8 bits (supplementary material, Sea-thru*) but did not publish how, so the
adaptations here are our own; each is documented where it is made. Intensities are in [0, 1], distances Euclidean, in
metres.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, Water, method
from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.display import gray_world_gain
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import FillOption, with_filled
from sucre_bench.imaging.image_formation import TwoTerm, channels, distances, is_flat, trusted, without_water
from sucre_bench.methods.seathru.attenuation import (
    Kind,
    amplified,
    at_bound,
    constant_attenuation,
    fit_attenuation,
    illuminant_by_distance,
)
from sucre_bench.methods.seathru.backscatter import Backscatter, dark_pixels, fit_backscatter
from sucre_bench.methods.seathru.illuminant import local_average
from sucre_bench.scene import Encoding

_GREY_LEVEL = 1 / 255


@method(
    needs={"depth"},
    requires=("scipy",),
    cites="Akkaynak & Treibitz 2019, Sea-thru; adapted to 8 bits as in Boittiaux et al. 2024 (Sea-thru*)",
)
@dataclass(frozen=True)
class Seathru(FillOption):
    """Estimate backscatter from the darkest pixels and attenuation from the local illuminant, and remove both.

    The method uses a single view and its distances (Sea-thru*). Pixels without depth have no colour. The reported water
    has a constant attenuation, also if the image is restored with one that changes with distance.
    """

    raw: bool = False
    """Work in linear light, as on raw images. Gamma-encoded views are decoded (sRGB), and the result encoded again."""

    attenuation: Kind = "two_term"
    """Attenuation over distance: "two_term", a exp(-b z) + c exp(-d z), or "constant", as in SUCRe's model."""

    white_balance: Literal["gray-world", "none"] = "gray-world"
    """Last step, over pixels with depth: "gray-world" makes the means of the channels equal; "none" switches it off."""

    f: float = 2.0
    """Illuminant divided by the local average colour: 2 for a scene with mean 0.5; 5 is better in linear light."""

    p: float = 0.01
    """Share of a pixel's own colour in its local average; the average reaches over some 1 / sqrt(p) pixels."""

    eps: float = 0.1
    """Neighbours are averaged if their distances differ by at most this share of the view's range of distances."""

    bins: int = 10
    """Number of bins of distance in which dark pixels are looked for."""

    share: float = 0.01
    """Share of each bin's pixels that counts as dark."""

    most: int = 20
    """Greatest number of dark pixels of a bin."""

    amplification: float = 25.0
    """Largest factor that corrects attenuation: at 25, one of 255 levels becomes a tenth of full scale."""

    size: int = 1024
    """Longest side, pixels, of the grid on which water and illuminant are estimated: every n-th pixel counts."""

    def __post_init__(self) -> None:
        for name, least in (("bins", 1), ("most", 1), ("amplification", 1), ("size", 16)):
            if not getattr(self, name) >= least:
                raise InputError(f"seathru.{name}: {getattr(self, name)} is too small; give {least} or more")
        if not 0 < self.f < np.inf:
            raise InputError(
                f"seathru.f: {self.f} is not positive and finite; give the illuminant over the average, such as 2"
            )
        for name in ("p", "eps", "share"):
            if not 0 < getattr(self, name) <= 1:
                raise InputError(f"seathru.{name}: {getattr(self, name)} is not a share; give more than 0, at most 1")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth; it may leave [0, 1]. NotApplicableError if no pixel has depth."""
        z, along = distances(view)
        light: Encoding = "linear" if self.raw else "gamma"
        taken = self._taken(z)
        level = float(converted(np.array(_GREY_LEVEL), "gamma", light))
        few, few_z = converted(view.rgb[taken], view.encoding, light), z[taken]
        found = self._fitted(few, few_z, level)
        J = found.removed_from(few, few_z)[few_z > 0]
        gain = self._gain(J, level)

        def at(z: Array) -> Array:
            image = found.removed_from(converted(view.rgb, view.encoding, light), z) * gain
            return converted(image, light, view.encoding).astype(np.float32, copy=False)

        water = found.water(light)
        info: dict[str, Any] = {
            "along": along,
            **found.about(few_z[few_z > 0]),
            "gain": gain.tolist(),
            "negative_share": (J < 0).mean(axis=0).tolist(),
            "undetermined": _undetermined(few_z[trusted(few_z)], water, found.beta),
        }
        restoration = Restoration(at(z), water, info=info)
        return with_filled(restoration, view, at) if self.fill else restoration

    def _fitted(self, image: Array, z: Array, level: float) -> _Fit:
        """Return what is removed from an image (H, W, 3) at distances (H, W); level: see `_attenuation`."""
        fitted = trusted(z)
        intensity, far = image[fitted], z[fitted]  # (P, 3), (P,)
        dark = dark_pixels(intensity, far, self.bins, self.share, self.most)
        backscatter = fit_backscatter(intensity[dark], far[dark])
        # Where the veil is brighter than the pixel, noise or the fit is to blame: no light is left to average, and the
        # pixel stays a little below 0 in the result.
        direct = (intensity - np.stack([backscatter.veil(far, c) for c in range(3)], axis=-1)).clip(min=0)
        illuminant = self.f * local_average(direct, np.where(fitted, z, 0), self.p, self.eps)
        return _Fit(backscatter, len(dark), *self._attenuation(illuminant, far, level), self.amplification)

    def _taken(self, z: Array) -> tuple[slice, slice]:
        """Every n-th pixel; not their mean, which knows no darkest pixel and mixes near with far."""
        n = -(-max(z.shape) // self.size)
        taken = (slice(None, None, n), slice(None, None, n))
        return taken if (z[taken] > 0).any() else (slice(None), slice(None))

    def _attenuation(self, illuminant: Array, z: Array, level: float) -> tuple[list[TwoTerm], list[float]]:
        """Each channel's beta(z), and the constant nearest to it, from the distances where there is light to see.

        level: of intensity, below which the average of a step is black to 8 bits, and has no logarithm.
        """
        at, E = illuminant_by_distance(illuminant, z)
        lit = level * self.f < E
        seen = [(at[lit[:, c]], E[lit[:, c], c]) for c in range(3)]
        beta = [fit_attenuation(*of, self.attenuation) for of in seen]
        return beta, [constant_attenuation(*of) for of in seen]

    def _gain(self, J: Array, level: float) -> Array:
        """The (3,) white balance; of J (P, 3) as it would be shown, so that amplified noise beyond does not count.

        A channel below `level` is noise: it is neither lifted to the others, nor are they lowered to it.
        """
        gain, shown = np.ones(3, dtype=np.float32), J.clip(0, 1)
        lit = shown.mean(axis=0, dtype=np.float64) > level
        if self.white_balance == "gray-world" and lit.any():
            gain[lit] = gray_world_gain(shown[:, lit])
        return gain


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """The water of an image: backscatter, from so many dark pixels; beta(z) of each channel, and the constant nearest
    to it; amplification: the largest that is undone."""

    backscatter: Backscatter
    n_dark: int
    beta: list[TwoTerm]
    constant: list[float]
    amplification: float

    def removed_from(self, image: Array, z: Array) -> Array:
        """Return an image (H, W, 3) at distances z (H, W) without the water."""

        def optical_depth(through: Array, c: int) -> Array:
            return amplified(self.beta[c], through, self.amplification)

        return without_water(image, z, self.backscatter.veil, optical_depth)

    def water(self, encoding: Encoding) -> Water:
        return Water(self.backscatter.veiling_light, np.array(self.constant), self.backscatter.rate, encoding=encoding)

    def about(self, z: Array) -> dict[str, Any]:
        """Return the record of the fit; limited_share: of pixels (P,) at z that beta would multiply by more."""
        most = np.log(self.amplification)
        return {
            "dark_pixels": self.n_dark,
            "residual": self.backscatter.residual.tolist(),
            "residual_rate": self.backscatter.residual_rate.tolist(),
            "beta_terms": [[b.a, b.b, b.c, b.d] for b in self.beta],
            "limited_share": [float((amplified(b, z, np.inf) > most).mean()) for b in self.beta],
        }


def _undetermined(z: Array, water: Water, beta: list[TwoTerm]) -> str:
    """Say what the view cannot tell; "" where it can."""
    if is_flat(z):
        return "all pixels are about equally far: veil and attenuation are one choice of many"
    doubts = (
        ("attenuation", water.attenuation <= 0),
        ("beta(z), at its bound,", np.array([at_bound(b) for b in beta])),
        ("veiling light", water.veiling_light >= 1 - _GREY_LEVEL),
    )
    return "; ".join(f"{what} of {channels(where)}" for what, where in doubts if where.any())
