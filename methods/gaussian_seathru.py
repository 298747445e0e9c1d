"""Gaussian Sea-thru: estimates the water of one view by maximum likelihood, with normally distributed colours.

A variant of Sea-thru by the authors of SUCRe. In each channel, J ~ N(mu, sigma^2) at every distance. So
I ~ N(m(z), s(z)^2) with m(z) = mu exp(-beta z) + B (1 - exp(-gamma z)) and s(z) = sigma exp(-beta z). Intensities are
gamma-encoded, in [0, 1]; distances Euclidean, in metres; beta and gamma 1/m.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, Water, method
from sucre_bench.arrays import Array
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

Kind = Literal["constant", "two_term"]

# Starts of B, gamma and beta (1/m); the first is the authors' own. On the made scenes, each start ends in a worse
# minimum than another one in some channel, by up to 1.5 in the likelihood.
_STARTS = ((0.25, 0.1, 0.1), (0.25, 0.5, 0.5), (0.1, 0.2, 0.3))
_LEAST = 1e-6
_GREATEST_LIGHT = 1.0
_GREATEST_RATE = 5.0


def negative_log_likelihood(water: ChannelWater, intensity: Array, z: Array) -> float:
    """Return mean ln(s sqrt(2 pi)) + mean(((I - m) / s)^2) / 2 for I (P,) and z (P,), with mu and sigma those of J.

    Since (I - m) / s = (J - mu) / sigma, the second term is 1/2. The first is ln(sigma sqrt(2 pi)) - mean(beta(z) z).
    Returns inf where all J are equal: they have no normal distribution.
    """
    tau = water.beta.optical_depth(z)
    most = float(tau.max())  # factored out, so that no exponential overflows
    sigma = float(((intensity - water.veil(z)) * np.exp(tau - most)).std())
    if sigma == 0:
        return np.inf
    return float(np.log(sigma * np.sqrt(2 * np.pi)) + most - tau.mean() + 0.5)


@method(
    needs={"depth"},
    requires=("scipy",),
    cites="Boittiaux et al., Gaussian Sea-thru (a single-view variant of Akkaynak & Treibitz 2019)",
    display="stretch-1-99",
    encoding="gamma",
)
@dataclass(frozen=True)
class GaussianSeathru(FillOption):
    """Fit the water with which colours have the same normal distribution at all distances.

    One view and its distances are enough; the method looks for no dark pixels and no illuminant. Pixels without depth
    have no colour. Results are shown stretched, as SUCRe's are, because the likelihood leaves the overall brightness
    open.
    """

    attenuation: Kind = "constant"
    """How attenuation depends on distance: "constant", as in SUCRe, or "two_term", a exp(-b z) + c exp(-d z)."""

    sample: int = 20000
    """Number of pixels in the likelihood, drawn at random from all but the farthest 1 %; all pixels if there are
    fewer."""

    seed: int = 0
    """Seed of the random pixels; equal seeds give equal results."""

    most_evaluations: int = 10_000
    """Most evaluations of the likelihood in a search; each channel has three searches. On made scenes a search took up
    to 5,500. info["undetermined"] names channels whose best search reached this limit."""

    def __post_init__(self) -> None:
        check_ranges(self, sample="[2, inf)", seed="[0, inf)", most_evaluations="[1, inf)")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth; it may leave [0, 1].

        info: along, cost, mu, sigma, beta_terms, negative_share, and undetermined (what the view cannot tell). Raises
        NotApplicableError when no pixel has depth.
        """
        z, along = distances(view)
        seen = np.flatnonzero(trusted(z))  # all with depth but the farthest 1 %
        if seen.size > self.sample:
            seen = seen[np.random.default_rng(self.seed).integers(seen.size, size=self.sample)]
        intensity, far = (
            view.rgb.reshape(-1, 3)[seen].astype(np.float64),
            z.ravel()[seen].astype(np.float64),
        )
        fits = [
            _fitted(intensity[:, c], far, self.attenuation, self.most_evaluations)
            for c in range(3)
        ]
        water = [of for of, _, _ in fits]
        drawn = without_water(intensity[None], far[None], water)[0]
        within = [
            0.01 < of.B < 0.99 and 0.01 < of.gamma < 0.99 * _GREATEST_RATE for of in water
        ]
        unfinished = np.array([not done for _, _, done in fits])
        doubts = {"veil": ~np.array(within), "simplex, unfinished,": unfinished}
        info: dict[str, Any] = {
            "along": along,
            "cost": [cost for _, cost, _ in fits],
            "mu": drawn.mean(axis=0, dtype=np.float64).tolist(),
            "sigma": drawn.std(axis=0, dtype=np.float64).tolist(),
            "beta_terms": [[w.beta.a, w.beta.b, w.beta.c, w.beta.d] for w in water],
            "negative_share": (drawn < 0).mean(axis=0).tolist(),
            "undetermined": undetermined(far, "no water is likelier than another", doubts),
        }
        constant = [float(far @ w.beta.optical_depth(far) / (far @ far)) for w in water]
        B, gamma = np.array([w.B for w in water]), np.array([w.gamma for w in water])
        restored = without_water(view.rgb, z, water)
        restoration = Restoration(
            restored, Water(B, np.array(constant), gamma, encoding=view.encoding), info=info
        )
        return self.filled(restoration, view, lambda z: without_water(view.rgb, z, water))


_Fit = tuple[ChannelWater, float, bool]


def _fitted(intensity: Array, z: Array, kind: Kind, most_evaluations: int) -> _Fit:
    """Return the likeliest water of a channel, its negative log-likelihood, and whether the simplex converged.

    It is the best result of Nelder and Mead's simplex over all starts.
    """
    from scipy.optimize import minimize

    if np.ptp(intensity) == 0:  # a channel without spread stays as it is
        return ChannelWater(_LEAST, _LEAST, TwoTerm(_LEAST)), np.inf, True

    def water(x: Array) -> ChannelWater:
        B, gamma, *beta = (float(value) for value in x)
        return ChannelWater(B, gamma, TwoTerm(*beta))

    found = []
    for B, gamma, beta in _STARTS:
        start = [B, gamma, beta] if kind == "constant" else [B, gamma, beta, 0.1, beta, 0.1]
        fit = minimize(
            lambda x: negative_log_likelihood(water(x), intensity, z),
            start,
            method="Nelder-Mead",
            bounds=[(_LEAST, _GREATEST_LIGHT), *[(_LEAST, _GREATEST_RATE)] * (len(start) - 1)],
            options={"maxfev": most_evaluations, "xatol": 1e-4, "fatol": 1e-7},
        )
        found.append((water(fit.x), float(fit.fun), bool(fit.success)))
    return min(found, key=lambda fit: fit[1])
