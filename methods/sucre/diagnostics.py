"""How far a fitted water can be trusted.

With H and the residual cost of the reduced problem, sigma^2 = cost / (N - P - 3) over the pixels seen more than once,
and sigma^2 H^-1 is the covariance of B, beta and gamma for independent noise. Where distances are alike the parameters
trade against each other: the condition of H scaled to unit diagonal says how badly (on made scenes 60 at distances of
2 to 10 m, 1.5e3 at 3 to 4 m, 5.9e4 at 3 to 3.3 m).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.reduced import ReducedSystem

__all__ = ["CHANNELS", "ROUNDING", "Trust", "judge", "of_given", "with_noise"]

CHANNELS = ("red", "green", "blue")
_PARAMETERS = ("veiling light", "attenuation", "backscatter")

_TOO_FEW = "too few repeated observations to tell the noise, and with it how sure anything is"

# A parameter whose standard error is more than this share of its value is called undetermined.
_LOOSE = 0.5

# A cost at which float32 sums of intensities have nothing more to say: rms 1e-6 of each observation.
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class Trust:
    """noise: (3,) sigma of each channel, in intensity; covariance: (3, 3, 3) of B, beta, gamma in each channel;
    standard_error: (3, 3) rows channels, NaN where held at a bound; condition: (3,) of the scaled H;
    limits: in words, what is not determined.
    """

    noise: Array
    covariance: Array
    standard_error: Array
    condition: Array
    limits: tuple[str, ...]


def with_noise(trust: Trust, noise: Array) -> Trust:
    """Return what another noise (3,) makes of it: the cost of robustly weighted residuals does not tell theirs."""
    ratio = np.divide(noise, trust.noise, out=np.ones(3), where=trust.noise > 0)
    covariance, error = trust.covariance * ratio[:, None, None] ** 2, trust.standard_error * ratio[:, None]
    return replace(trust, noise=noise, covariance=covariance, standard_error=error)


def of_given(trust: Trust) -> Trust:
    """Return what is known when the water is known from elsewhere: nothing about it is uncertain, colours still are."""
    said = tuple(limit for limit in trust.limits if limit == _TOO_FEW)
    return replace(trust, covariance=np.zeros((3, 3, 3)), standard_error=np.full((3, 3), np.nan), limits=said)


def judge(system: ReducedSystem, water: Array, free: Mask, n_excess: int, dead: Mask | None = None) -> Trust:
    """Judge a water (3, 3), rows channels.

    n_excess: observations more than pixels, over pixels seen repeatedly; dead: (3,) bool, channels without signal.
    """
    dead = np.zeros(3, dtype=bool) if dead is None else dead
    told = (np.einsum("cii->ci", system.H) > 0) & ~dead[:, None]
    noise = np.sqrt(system.cost / (n_excess - 3)) if n_excess > 3 else np.full(3, np.nan)
    covariance, condition = np.zeros((3, 3, 3)), np.full(3, np.inf)
    error = np.full((3, 3), np.nan)
    for c, H in enumerate(system.H):
        k = np.flatnonzero(free[c] & told[c])
        if not len(k):
            continue
        scale = 1 / np.sqrt(np.diag(H)[k])
        scaled = H[np.ix_(k, k)] * scale[:, None] * scale
        eigenvalues = np.linalg.eigvalsh(scaled)
        condition[c] = eigenvalues[-1] / max(eigenvalues[0], 1e-16)
        inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) * scale[:, None] * scale
        covariance[c][np.ix_(k, k)] = noise[c] ** 2 * inverse
        error[c, k] = np.sqrt(np.diag(covariance[c])[k].clip(min=0))
    said = _limits(water, error, free, told, dead)
    if n_excess <= 3:
        said.append(_TOO_FEW)
    return Trust(noise, covariance, error, condition, tuple(said))


def _limits(water: Array, error: Array, free: Mask, told: Mask, dead: Mask) -> list[str]:
    said = []
    for c, colour in enumerate(CHANNELS):
        if dead[c]:
            said.append(f"{colour}: the same in all observations, black or saturated; left as it is")
            continue
        loose = [
            f"{name} {value:.3g} ± {spread:.2g}"
            for name, value, spread in zip(_PARAMETERS, water[c], error[c], strict=True)
            if spread > _LOOSE * abs(value)
        ]
        if loose:
            said.append(f"{colour}: undetermined by these distances: {', '.join(loose)}")
        for which, why in (
            (~told[c], "not told by these observations"),
            (told[c] & ~free[c], "at the end of the range"),
        ):
            if which.any():
                said.append(f"{colour}: {' and '.join(np.array(_PARAMETERS)[which])} {why}")
    return said
