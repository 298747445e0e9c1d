"""How uncertain a fitted water is.

With H and the residual cost of the reduced problem, sigma^2 = cost / (N - P - 3) over the pixels seen more than once,
and sigma^2 H^-1 is the covariance of B, beta and gamma for independent noise. If distances are similar, the data hardly
separate the parameters. The condition of H, scaled to unit diagonal, measures this: on made scenes 60 at distances of 2
to 10 m, 1.5e3 at 3 to 4 m, 5.9e4 at 3 to 3.3 m.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters

CHANNELS = ("red", "green", "blue")
_PARAMETERS = ("veiling light", "attenuation", "backscatter")

_TOO_FEW = "too few repeated observations to estimate the noise; nothing is known about errors"

# A parameter whose standard error is more than this share of its value is called undetermined.
_LOOSE = 0.5

# The rounding of float32 sums of intensities, as a cost: 1e-6 rms of each observation.
ROUNDING = 1e-12


@dataclass(frozen=True, slots=True, eq=False)
class WaterUncertainty:
    """What is known about the errors of a water.

    noise: (3,) standard deviation of an observation in each channel, in intensity; covariance: (3, 3, 3) of B, beta,
    gamma in each channel; standard_error: of each parameter, NaN where it is held at a bound; condition: (3,) of the
    scaled H; limits: in words, the parameters that the observations do not determine; is_weak: channels that a weak
    prior decides.
    """

    noise: Array
    covariance: Array
    standard_error: WaterParameters
    condition: Array
    limits: tuple[str, ...]
    is_weak: tuple[bool, bool, bool] = (False, False, False)


def is_determined(uncertainty: WaterUncertainty) -> bool:
    """Return whether the observations determine all three parameters of most channels, without a weak prior."""
    return sum(uncertainty.is_weak) < 2


def rescaled_to_noise(uncertainty: WaterUncertainty, noise: Array) -> WaterUncertainty:
    """Rescale covariance and errors to a given noise (3,): with robust weights the cost underestimates it."""
    ratio = np.divide(noise, uncertainty.noise, out=np.ones(3), where=uncertainty.noise > 0)
    covariance = uncertainty.covariance * ratio[:, None, None] ** 2
    error = WaterParameters.of_channels(uncertainty.standard_error.by_channel() * ratio[:, None])
    return replace(uncertainty, noise=noise, covariance=covariance, standard_error=error)


def for_known_water(uncertainty: WaterUncertainty) -> WaterUncertainty:
    """Return the uncertainty when the water is known from elsewhere: colours have noise, the water has no error."""
    kept = (_TOO_FEW,) if np.isnan(uncertainty.noise).any() else ()
    error = WaterParameters.of_channels(np.full((3, 3), np.nan))
    return replace(uncertainty, covariance=np.zeros((3, 3, 3)), standard_error=error, limits=kept)


def uncertainty_of(
    water: WaterParameters, system: ReducedSystem, free: Mask, n_excess: int, dead: Mask | None = None
) -> WaterUncertainty:
    """Return the uncertainty of a water from the system around it.

    free: (3 channels, 3) bool, parameters that no bound holds; n_excess: how many more observations than pixels there
    are, over pixels seen repeatedly; dead: (3,) bool, channels without signal.
    """
    dead = np.zeros(3, dtype=bool) if dead is None else dead
    informed = (np.einsum("cii->ci", system.H) > 0) & ~dead[:, None]
    noise = np.sqrt(system.cost / (n_excess - 3)) if n_excess > 3 else np.full(3, np.nan)
    covariance, condition = np.zeros((3, 3, 3)), np.full(3, np.inf)
    error = np.full((3, 3), np.nan)
    for c, H in enumerate(system.H):
        k = np.flatnonzero(free[c] & informed[c])
        if not len(k):
            continue
        scale = 1 / np.sqrt(np.diag(H)[k])
        scaled = H[np.ix_(k, k)] * scale[:, None] * scale
        eigenvalues = np.linalg.eigvalsh(scaled)
        condition[c] = eigenvalues[-1] / max(eigenvalues[0], 1e-16)
        inverse = np.linalg.pinv(scaled, rcond=1e-14, hermitian=True) * scale[:, None] * scale
        covariance[c][np.ix_(k, k)] = noise[c] ** 2 * inverse
        error[c, k] = np.sqrt(np.diag(covariance[c])[k].clip(min=0))
    limits = _limits(water.by_channel(), error, free, informed, dead)
    if n_excess <= 3:
        limits.append(_TOO_FEW)
    return WaterUncertainty(noise, covariance, WaterParameters.of_channels(error), condition, tuple(limits))


def _limits(water: Array, error: Array, free: Mask, informed: Mask, dead: Mask) -> list[str]:
    limits = []
    for c, colour in enumerate(CHANNELS):
        if dead[c]:
            limits.append(f"{colour}: the same in all observations, black or saturated; left as it is")
            continue
        loose = [
            f"{name} {value:.3g} ± {spread:.2g}"
            for name, value, spread in zip(_PARAMETERS, water[c], error[c], strict=True)
            if spread > _LOOSE * abs(value)
        ]
        if loose:
            limits.append(f"{colour}: undetermined by these distances: {', '.join(loose)}")
        for which, why in (
            (~informed[c], "not determined by these observations"),
            (informed[c] & ~free[c], "at the end of the range"),
        ):
            if which.any():
                limits.append(f"{colour}: {' and '.join(np.array(_PARAMETERS)[which])} {why}")
    return limits
