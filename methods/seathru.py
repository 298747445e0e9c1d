"""Sea-thru (Akkaynak & Treibitz 2019), for 8-bit images: Sea-thru* of the SUCRe paper.

D. Akkaynak and T. Treibitz, Sea-thru: A Method for Removing Water From Underwater Images, CVPR 2019. The method is made
for raw images. SUCRe's authors adapted it to 8 bits (supplementary material, Sea-thru*) but did not publish how. The
adaptations here are our own, and each is documented where it is made. Intensities are in [0, 1], distances Euclidean,
in metres.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, Water, method
from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.display import gray_world_gain
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.fill import FillOption
from sucre_bench.imaging.image_formation import (
    ChannelWater,
    TwoTerm,
    distances,
    trusted,
    undetermined,
    without_water,
)
from sucre_bench.plugins.options import check_ranges
from sucre_bench.scene import Encoding

if TYPE_CHECKING:
    from scipy.sparse import csr_array


# The local illuminant: local space average colour (Ebner 2013; Akkaynak & Treibitz 2019, sec. 4.4, eqs. 12-14).
#
# A pixel's average a takes a share p of its own colour and the rest from its neighbours, a = p D + (1 - p) mean(a of
# the 4-neighbours about as far from the camera). The equation is linear and has one solution. Chebyshev's semi-
# iteration (Golub & Varga 1961) reaches it in some 80 rounds where plain repetition takes a thousand (p = 0.01), so
# that the result does not depend on where one starts or stops.

_ROUNDS = 100
_CONVERGED = 1e-5


def local_average(direct: Array, z: Array, p: float, eps: float) -> Array:
    """Return the local space average colour (P, 3) float32 of the P pixels with z > 0, in reading order.

    direct: (P, 3), the image without backscatter at those pixels; z: (H, W) metres, 0 = unknown; p: share of the
    pixel's own colour, (0, 1]; eps: neighbours are no farther from each other than this share of the range of z.
    A pixel with no such neighbour keeps its colour.
    """
    mean = _neighbour_mean(z, eps)
    here, rest = (p * direct).astype(np.float32), np.float32(1 - p)
    before: Array = direct.astype(np.float32)
    average: Array = here + rest * (mean @ before)
    omega = 2.0
    for _ in range(_ROUNDS):
        omega = 1 / (1 - (1 - p) ** 2 * omega / 4)
        following = before + np.float32(omega) * (here + rest * (mean @ average) - before)
        before, average = average, following
        if np.abs(average - before).max() < _CONVERGED:
            break
    return average


def _neighbour_mean(z: Array, eps: float) -> csr_array:
    """The (P, P) matrix that averages over each pixel's neighbours; a pixel without any is its own."""
    from scipy.sparse import coo_array

    known: Mask = z > 0
    number = np.cumsum(known, dtype=np.int32).reshape(z.shape) - 1
    tolerance = eps * (z[known].max() - z[known].min())
    pairs = []
    for a, b in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])):
        near = known[a] & known[b] & (np.abs(z[a] - z[b]) <= tolerance)
        pairs.append(np.stack([number[a][near], number[b][near]]))
    ends = np.concatenate(pairs, axis=1)
    n = int(known.sum())
    lonely = np.flatnonzero(np.bincount(ends.ravel(), minlength=n) == 0).astype(np.int32)
    row, column = np.concatenate([ends, ends[::-1], np.stack([lonely, lonely])], axis=1)
    weight = (1 / np.bincount(row, minlength=n)).astype(np.float32)
    return coo_array((weight[row], (row, column)), shape=(n, n)).tocsr()


# Backscatter from the darkest pixels of each range of distances (Akkaynak & Treibitz 2019, sec. 4.3, eq. 10).
#
# What reaches the camera from the darkest pixels is backscatter, and what little light they still reflect: I = Binf (1
# - exp(-b z)) + J' exp(-b' z). Only the first term is the water's: the second is fitted so that it does not end up in
# the first, and stays in the image.

# Starts of the two rates, 1/m, for each pair of which the two factors follow linearly; as many as are worth refining.
_RATES = (0.05, 0.2, 0.8, 3.0)
_REFINED = 3
_GREATEST_RATE = 5.0
# Residuals beyond two grey levels count linearly only: among the darkest pixels are noise and dead ones.
_OUTLIER = 2 / 255
# Weight of (J' exp(-b' z))^2. A residual that hardly decays is a constant, and so is a veil that is nearly full: 8 bits
# cannot tell them apart, and what they leave open is given to the veil. Over five views of each of three made waters,
# the veil's error is 0.024 rms without it, 0.015 with any weight from 0.0003 to 0.03; true residuals of 0.05 to 0.15
# are told apart best with the smaller ones.
_DARKNESS = 0.001


@dataclass(frozen=True, slots=True)
class Backscatter:
    """The fitted curves, each field (3,)."""

    veiling_light: Array
    """Is Binf."""

    rate: Array
    """Is b, 1/m."""

    residual: Array
    """Is J'."""

    residual_rate: Array
    """Is b', 1/m."""

    def veil(self, z: Array, channel: int) -> Array:
        """Return the water's own light at distances z (P,), without the residual."""
        return np.asarray(self.veiling_light[channel] * -np.expm1(-self.rate[channel] * z))


def dark_pixels(intensity: Array, z: Array, bins: int, share: float, most: int) -> np.ndarray:
    """Return the indices of the darkest pixels of every bin of distances, by the mean of their channels.

    intensity: (P, 3); z: (P,) metres; bins: of equal width, from the nearest to the farthest pixel; share: of a bin's
    pixels, at least one; most: of them. Pixels in the nearest tenth of the range are left out where there are others:
    there is least backscatter and most residual.
    """
    near, far = float(z.min()), float(z.max())
    bin_of = np.minimum(
        ((z - near) * (bins / max(far - near, 1e-6))).astype(np.int64), bins - 1
    )
    order = np.lexsort((intensity.mean(axis=-1), bin_of))
    ends = np.searchsorted(bin_of[order], np.arange(bins + 1))
    darkest = [
        order[a : a + min(int(np.ceil(share * (b - a))), most)]
        for a, b in itertools.pairwise(ends)
    ]
    chosen = np.concatenate(darkest)
    beyond = chosen[z[chosen] > near + 0.1 * (far - near)]
    return beyond if beyond.size else chosen


def fit_backscatter(intensity: Array, z: Array) -> Backscatter:
    """Fit eq. 10 to dark pixels (P, 3) at distances (P,) by robust least squares, each channel for itself.

    Bounds: Binf and J' in [0, 1], b and b' in [0, 5] 1/m. Starts are a grid: equal inputs give equal curves.
    """
    z = z.astype(np.float64)
    return Backscatter(
        *np.transpose([_fitted(intensity[:, c].astype(np.float64), z) for c in range(3)])
    )


def _fitted(dark: Array, z: Array) -> Any:
    """Return Binf, b, J', b' of one channel: the best of the most promising starts."""
    from scipy.optimize import nnls

    def terms(b: float, rest: float) -> tuple[Array, Array]:
        return -np.expm1(-b * z), np.exp(-rest * z)

    def residuals(x: Array) -> Array:
        veil, rest = terms(x[1], x[3])
        return np.concatenate(
            [x[0] * veil + x[2] * rest - dark, np.sqrt(_DARKNESS) * x[2] * rest]
        )

    starts = []
    for b, rest in itertools.product(_RATES, _RATES):
        veil, faded = terms(b, rest)
        system = np.stack(
            [np.append(veil, 0 * z), np.append(faded, np.sqrt(_DARKNESS) * faded)], axis=1
        )
        (B, J), misfit = nnls(system, np.append(dark, 0 * z))
        starts.append((misfit, (min(B, 1.0), b, min(J, 1.0), rest)))
    return _refined(residuals, starts, [1, _GREATEST_RATE, 1, _GREATEST_RATE], _OUTLIER)


def _refined(
    residuals: Callable[[Array], Array],
    starts: list[Any],
    greatest: list[float],
    outlier: float,
) -> Any:
    """Return the four parameters, in [0, greatest], that fit best of the most promising (misfit, start).

    outlier: residuals beyond count linearly only.
    """
    from scipy.optimize import least_squares

    how: dict[str, Any] = {"bounds": ([0] * 4, greatest), "loss": "soft_l1", "f_scale": outlier}
    fits = [least_squares(residuals, start, **how) for _, start in sorted(starts)[:_REFINED]]
    return tuple(float(x) for x in min(fits, key=lambda fit: fit.cost).x)


# Attenuation from how the local illuminant fades with distance (Akkaynak & Treibitz 2019, sec. 4.4, eqs. 11, 15-17).
#
# With E the illuminant, -ln E = beta(z) z. beta is either constant or beta(z) = a exp(-b z) + c exp(-d z).

Kind = Literal["two_term", "constant"]

_STEPS = 100  # of distance, a median each
_GREATEST_FACTOR = 100.0  # of a and c, 1/m
_GREATEST_EXPONENT = 100.0  # of b and d, 1/m
_GREATEST_CONSTANT = 5.0  # 1/m, as of the backscatter
_AT_BOUND = 1e-3  # of a bound: fits end this near to it, not on it
_EXPONENTS = (0.0, 0.05, 0.2, 0.8, 3.0)
_LOG_OUTLIER = 0.1  # in -ln E: beyond 10 % residuals count linearly only


def amplified(beta: TwoTerm, z: Array, amplification: float) -> Array:
    """Return (P,) how much fades up to distances z (P,) metres, and is to be undone: J = D exp(optical depth).

    It is beta(z) z, made to rise with distance. More water never lets more light through, but two fitted terms may say
    so where few pixels are, or where a seabed seen from above fades only a little. It ends at ln(amplification).
    """
    at = np.geomspace(z.min(), z.max(), 1024)
    depth = np.maximum.accumulate(beta.optical_depth(at)).clip(max=np.log(amplification))
    return np.interp(z, at, depth).astype(np.float32)


def at_bound(beta: TwoTerm) -> bool:
    """Return whether a fitted factor is the greatest there may be: the light does not say how great it is."""
    greatest = _GREATEST_FACTOR if beta.b or beta.c else _GREATEST_CONSTANT
    return max(beta.a, beta.c) >= (1 - _AT_BOUND) * greatest


def illuminant_by_distance(illuminant: Array, z: Array) -> tuple[Array, Array]:
    """Return the middle distances (K,) of steps of 1 % of the range of z, and the median illuminant (K, 3) in each.

    illuminant: (P, 3); z: (P,) metres. Empty steps are left out. Medians also bear pixels that are black because
    8 bits hold no less.
    """
    order = np.argsort(z, kind="stable")
    near, far = float(z[order[0]]), float(z[order[-1]])
    edges = np.searchsorted(z[order], np.linspace(near, far, _STEPS + 1)[1:-1])
    steps = [step for step in np.split(order, edges) if step.size]
    return (
        np.array([np.median(z[step]) for step in steps], dtype=np.float64),
        np.array([np.median(illuminant[step], axis=0) for step in steps], dtype=np.float64),
    )


def constant_attenuation(z: Array, E: Array) -> float:
    """Return the beta, in [0, 5] 1/m, with the least squares of beta z + ln E; z, E: (K,), E > 0. 0 without any."""
    return float(np.clip(-(z @ np.log(E)) / (z @ z), 0, _GREATEST_CONSTANT)) if z.size else 0.0


def fit_attenuation(z: Array, E: Array, kind: Kind) -> TwoTerm:
    """Fit beta(z) to the illuminant E (K,) > 0 at distances z (K,) in metres.

    What is made small, by robust least squares, is beta(z) z + ln E.
    The publication compares z with -ln E / beta(z): the same zero, but a division by what may be 0. Starts are a grid;
    for each pair of rates the factors follow linearly. Bounds: a, c in [0, 100], b, d in [0, 100] 1/m.
    """
    from scipy.optimize import nnls

    if kind == "constant" or not z.size:
        return TwoTerm(constant_attenuation(z, E))

    def residuals(x: Array) -> Array:
        return TwoTerm(*x).optical_depth(z) + np.log(E)

    starts = []
    for b, d in itertools.combinations(_EXPONENTS, 2):
        (a, c), misfit = nnls(
            np.stack([z * np.exp(-b * z), z * np.exp(-d * z)], axis=1), -np.log(E)
        )
        starts.append((misfit, (min(a, _GREATEST_FACTOR), b, min(c, _GREATEST_FACTOR), d)))
    return TwoTerm(
        *_refined(residuals, starts, [_GREATEST_FACTOR, _GREATEST_EXPONENT] * 2, _LOG_OUTLIER)
    )


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
        check_ranges(
            self, bins="[1, inf)", most="[1, inf)", amplification="[1, inf)", size="[16, inf)"
        )
        check_ranges(self, f="(0, inf)", p="(0, 1]", eps="(0, 1]", share="(0, 1]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth; it may leave [0, 1]. NotApplicableError if no pixel has depth."""
        z, along = distances(view)
        light: Encoding = "linear" if self.raw else "gamma"
        n = -(-max(z.shape) // self.size)
        # Every n-th pixel; not their mean, which knows no darkest pixel and mixes near with far.
        taken = (slice(None, None, n), slice(None, None, n))
        taken = taken if (z[taken] > 0).any() else (slice(None), slice(None))
        level = float(converted(np.array(_GREY_LEVEL), "gamma", light))
        few = converted(view.rgb[taken], view.encoding, light)
        few_z = z[taken]
        n_dark, backscatter, beta, constant = self._fitted(few, few_z, level)
        of_channels = list(map(ChannelWater, backscatter.veiling_light, backscatter.rate, beta))

        def without(image: Array, z: Array) -> Array:
            """Remove the water from an image (H, W, 3) at distances z (H, W)."""
            return without_water(
                image, z, of_channels, lambda of, z: amplified(of, z, self.amplification)
            )

        # The white balance is of J as it would be shown, so that amplified noise beyond does not count. A channel below
        # `level` is noise: it is neither lifted to the others, nor are they lowered to it.
        J = without(few, few_z)[few_z > 0]
        gain, shown = np.ones(3, dtype=np.float32), J.clip(0, 1)
        lit = shown.mean(axis=0, dtype=np.float64) > level
        if self.white_balance == "gray-world" and lit.any():
            gain[lit] = gray_world_gain(shown[:, lit])

        def at(z: Array) -> Array:
            image = without(converted(view.rgb, view.encoding, light), z) * gain
            return converted(image, light, view.encoding).astype(np.float32, copy=False)

        water = Water(
            backscatter.veiling_light, np.array(constant), backscatter.rate, encoding=light
        )
        doubts = {
            "attenuation": water.attenuation <= 0,
            "beta(z), at its bound,": np.array([at_bound(b) for b in beta]),
            "veiling light": water.veiling_light >= 1 - _GREY_LEVEL,
        }
        most = np.log(self.amplification)
        far = few_z[few_z > 0]
        info: dict[str, Any] = {
            "along": along,
            "dark_pixels": n_dark,
            "residual": backscatter.residual.tolist(),
            "residual_rate": backscatter.residual_rate.tolist(),
            "beta_terms": [[b.a, b.b, b.c, b.d] for b in beta],
            # of pixels
            "limited_share": [float((amplified(b, far, np.inf) > most).mean()) for b in beta],
            "gain": gain.tolist(),
            "negative_share": (J < 0).mean(axis=0).tolist(),
            "undetermined": undetermined(
                few_z[trusted(few_z)], "veil and attenuation are one choice of many", doubts
            ),
        }
        return self.filled(Restoration(at(z), water, info=info), view, at)

    def _fitted(
        self, image: Array, z: Array, level: float
    ) -> tuple[int, Backscatter, list[TwoTerm], list[float]]:
        """Fit an image (H, W, 3) at distances (H, W).

        Return the number of dark pixels, the backscatter, beta(z) of each channel, and the constant nearest to it.
        level: of intensity, below which the average of a step is black to 8 bits, and has no logarithm.
        """
        fitted = trusted(z)
        intensity, far = image[fitted], z[fitted]  # (P, 3), (P,)
        dark = dark_pixels(intensity, far, self.bins, self.share, self.most)
        backscatter = fit_backscatter(intensity[dark], far[dark])
        # Where the veil is brighter than the pixel, noise or the fit is to blame: no light is left to average, and the
        # pixel stays a little below 0 in the result.
        direct = (
            intensity - np.stack([backscatter.veil(far, c) for c in range(3)], axis=-1)
        ).clip(min=0)
        illuminant = self.f * local_average(direct, np.where(fitted, z, 0), self.p, self.eps)
        at, E = illuminant_by_distance(illuminant, far)
        lit = level * self.f < E
        seen = [(at[lit[:, c]], E[lit[:, c], c]) for c in range(3)]
        beta = [fit_attenuation(*of, self.attenuation) for of in seen]
        return len(dark), backscatter, beta, [constant_attenuation(*of) for of in seen]
