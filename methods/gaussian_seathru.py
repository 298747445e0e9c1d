"""Gaussian Sea-thru: the water of a single view by maximum likelihood, colours taken as normally distributed.

A variant of Sea-thru by the authors of SUCRe. Of each channel, J ~ N(mu, sigma^2) at every distance alike, so that
I ~ N(m(z), s(z)^2) with m(z) = mu exp(-beta z) + B (1 - exp(-gamma z)) and s(z) = sigma exp(-beta z). Intensities are
gamma-encoded, in [0, 1]; distances Euclidean, in metres; beta and gamma 1/m.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, Water, method
from sucre_bench.errors import InputError
from sucre_bench.scene import Array
from sucre_bench.steps.through_water import distances, without_water

__all__ = ["GaussianSeathru", "Parameters", "negative_log_likelihood"]

Kind = Literal["constant", "two_term"]

# Starts of B, gamma and beta (1/m); the first is the authors' own. Each of them ends in a worse minimum than another
# does in some channel of the made waters, by up to 1.5 in the likelihood.
_STARTS = ((0.25, 0.1, 0.1), (0.25, 0.5, 0.5), (0.1, 0.2, 0.3))
_LEAST, _GREATEST_LIGHT, _GREATEST_RATE = 1e-6, 1.0, 5.0
_FLAT = 0.02


@dataclass(frozen=True, slots=True)
class Parameters:
    """One channel's water: light B; gamma, 1/m; beta(z) = t exp(-p z) + c exp(-w z), 1/m, constant if p = c = 0."""

    B: float
    gamma: float
    t: float
    p: float = 0.0
    c: float = 0.0
    w: float = 0.0

    def veil(self, z: Array) -> Array:
        """Return B (1 - exp(-gamma z)) at distances z (P,) in metres."""
        return np.asarray(self.B * -np.expm1(-self.gamma * z))

    def optical_depth(self, z: Array) -> Array:
        """Return beta(z) z at distances z (P,) in metres."""
        if not (self.p or self.c):
            return np.asarray(self.t * z)
        return np.asarray((self.t * np.exp(-self.p * z) + self.c * np.exp(-self.w * z)) * z)


def negative_log_likelihood(water: Parameters, intensity: Array, z: Array) -> float:
    """Return mean ln(s sqrt(2 pi)) + mean(((I - m) / s)^2) / 2 for I (P,), z (P,), mu and sigma those of J.

    (I - m) / s is (J - mu) / sigma, so that the second term is a half, and the first ln(sigma sqrt(2 pi)) less the mean
    of beta(z) z. -inf where all J are equal.
    """
    tau = water.optical_depth(z)
    sigma = float(((intensity - water.veil(z)) * np.exp(tau)).std())
    if sigma == 0:
        return -np.inf
    return float(np.log(sigma * np.sqrt(2 * np.pi)) - tau.mean() + 0.5)


@method(
    needs={"depth"},
    requires=("scipy",),
    cites="Boittiaux et al., Gaussian Sea-thru (a single-view variant of Akkaynak & Treibitz 2019)",
    display="stretch-1-99",
    encoding="gamma",
)
@dataclass(frozen=True)
class GaussianSeathru:
    """Fit the water under which colours are normally distributed, and equally so at all distances.

    From a single view with its distances; no dark pixel and no illuminant is looked for. Pixels without depth have no
    colour. Shown stretched, as SUCRe is: the likelihood leaves the brightness of the whole open.
    """

    attenuation: Kind = "constant"
    """Of light with distance: "constant", as in SUCRe, or "two_term", beta(z) = t exp(-p z) + c exp(-w z)."""

    sample: int = 20000
    """How many pixels the likelihood is taken over, drawn at random; all of them where there are fewer."""

    seed: int = 0
    """Seed of the drawing; equal seeds give equal results."""

    def __post_init__(self) -> None:
        if self.sample < 2:
            raise InputError(f"gaussian_seathru.sample: {self.sample} pixels have no spread; give 2 or more")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return J, NaN where the view has no depth; it may leave [0, 1]. NotApplicableError without any depth."""
        z, along = distances(view)
        intensity, far = self._drawn(view.rgb, z)
        water = [_fitted(intensity[:, c], far, self.attenuation) for c in range(3)]
        J = without_water(
            view.rgb, z, lambda through, c: water[c].veil(through), lambda through, c: water[c].optical_depth(through)
        )
        seen = np.isfinite(J).all(axis=-1)
        info: dict[str, Any] = {
            "along": along,
            "cost": [negative_log_likelihood(water[c], intensity[:, c], far) for c in range(3)],
            "mu": J[seen].mean(axis=0, dtype=np.float64).tolist(),
            "sigma": J[seen].std(axis=0, dtype=np.float64).tolist(),
            "beta": [[w.t, w.p, w.c, w.w] for w in water],
            "negative_share": (J[seen] < 0).mean(axis=0).tolist(),
            "undetermined": _undetermined(far, water),
        }
        constant = [float(far @ w.optical_depth(far) / (far @ far)) for w in water]
        reported = Water(np.array([w.B for w in water]), np.array(constant), np.array([w.gamma for w in water]))
        return Restoration(J, reported, info=info)

    def _drawn(self, rgb: Array, z: Array) -> tuple[Array, Array]:
        """Intensities (P, 3) and distances (P,), float64, of pixels with depth."""
        seen = np.flatnonzero(z > 0)
        if seen.size > self.sample:
            seen = seen[np.random.default_rng(self.seed).integers(seen.size, size=self.sample)]
        return rgb.reshape(-1, 3)[seen].astype(np.float64), z.ravel()[seen].astype(np.float64)


def _fitted(intensity: Array, z: Array, kind: Kind) -> Parameters:
    """Return the likeliest water of a channel: the best of what Nelder and Mead's simplex reaches from all starts."""
    from scipy.optimize import minimize

    if np.ptp(intensity) == 0:  # no spread to be likely: the image as it is
        return Parameters(_LEAST, _LEAST, _LEAST)

    def cost(x: Array) -> float:
        return negative_log_likelihood(Parameters(*x), intensity, z)

    found = []
    for B, gamma, beta in _STARTS:
        start = [B, gamma, beta] if kind == "constant" else [B, gamma, beta, 0.1, beta, 0.1]
        bounds = [(_LEAST, _GREATEST_LIGHT), *[(_LEAST, _GREATEST_RATE)] * (len(start) - 1)]
        options = {"maxfev": 2000, "xatol": 1e-4, "fatol": 1e-7}
        found.append(minimize(cost, start, method="Nelder-Mead", bounds=bounds, options=options))
    return Parameters(*(float(x) for x in min(found, key=lambda fit: fit.fun).x))


def _undetermined(z: Array, water: list[Parameters]) -> str:
    """Say what the view cannot tell; "" where it can."""
    if z.max() - z.min() < _FLAT * z.max():
        return "all pixels are about equally far: no water is likelier than another"
    names = zip(("red", "green", "blue"), water, strict=True)
    doubtful = [name for name, w in names if not (0.01 < w.B < 0.99 and 0.01 < w.gamma < 0.99 * _GREATEST_RATE)]
    return f"veil of {', '.join(doubtful)}" if doubtful else ""
