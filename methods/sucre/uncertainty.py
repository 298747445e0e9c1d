"""How uncertain a water is.

With H and the residual cost of the reduced problem, sigma^2 = cost / (N - P - 3) over the pixels seen more than once,
and sigma^2 H^-1 is the covariance of B, beta and gamma for independent noise. If distances are similar, the data hardly
separate the parameters. The condition of H, scaled to unit diagonal, measures this: on made scenes 60 at distances of 2
to 10 m, 1.5e3 at 3 to 4 m, 5.9e4 at 3 to 3.3 m.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, Indices, Mask
from sucre_bench.methods.sucre.model import TIED, ReducedSystem, WaterParameters
from sucre_bench.methods.sucre.passes import Eliminated, blocks, fill
from sucre_bench.multiview.observations import Observations

CHANNELS = ("red", "green", "blue")
_PARAMETERS = ("veiling light", "attenuation", "backscatter")

_TOO_FEW = "too few points lie in two views to tell the noise; nothing is known about errors"
_TYPICAL = (
    "at these distances, veil and attenuation cannot be told apart; typical water was assumed"
)
_NO_VEIL = "no veil can be seen, and none was removed"

# Tiles along each side of a target, whose errors count as independent.
_TILES = 6
# Places in a block.
_PLACES = 1 << 16

# A parameter whose standard error is more than this share of its value is called undetermined.
_LOOSE = 0.5

# From this error on, as a share, colours of far ground get a word.
_WRONG = 0.1

# Errors of a water that is not estimated.
UNKNOWN = WaterParameters.of_channels(np.full((3, 3), np.nan))


@dataclass(frozen=True, slots=True, eq=False)
class WaterUncertainty:
    """What is known about the errors of a water."""

    noise: Array
    """Standard deviation of an observation in each channel, (3,), in intensity."""

    covariance: Array
    """Of B, beta, gamma in each channel, (3 channels, 3, 3)."""

    standard_error: WaterParameters
    """Of each parameter; NaN where it is held at a bound."""

    condition: Array
    """Of the scaled H, (3,)."""

    limits: tuple[str, ...]
    """In words, the parameters that the observations do not determine, and what else a user should know."""

    is_weak: tuple[bool, bool, bool] = (False, False, False)
    """Channels that a weak prior decides."""

    alike: Array | None = None
    """Like `covariance`, but larger where residuals of neighbours and of a view that are alike make it so; None if this
    was not estimated."""

    def with_limits(self, limits: Iterable[str]) -> WaterUncertainty:
        """Return the uncertainty with more limits."""
        return replace(self, limits=(*self.limits, *limits))


def is_determined(uncertainty: WaterUncertainty) -> bool:
    """Return whether the observations determine all three parameters of most channels, without a weak prior."""
    return sum(uncertainty.is_weak) < 2


def rescaled_to_noise(uncertainty: WaterUncertainty, noise: Array) -> WaterUncertainty:
    """Rescale covariance and errors to a given noise (3,): with robust weights the cost underestimates it."""
    ratio = np.divide(noise, uncertainty.noise, out=np.ones(3), where=uncertainty.noise > 0)
    covariance = uncertainty.covariance * ratio[:, None, None] ** 2
    error = WaterParameters.of_channels(
        uncertainty.standard_error.by_channel() * ratio[:, None]
    )
    return replace(uncertainty, noise=noise, covariance=covariance, standard_error=error)


def clustered(
    uncertainty: WaterUncertainty,
    observations: Observations,
    water: WaterParameters,
) -> WaterUncertainty:
    """Return the uncertainty with errors that hold if the residuals of neighbours, or of a view, are alike.

    They are: texture, light and poses differ more between places and views than within. With s the sum of D'^T r over a
    cluster, H^-1 (sum s s^T) H^-1 needs independent clusters only (Liang & Zeger 1986). Clusters are tiles of the
    target, or views; each parameter has the largest error of these, and of independent observations. The covariance
    stays, since priors weigh colours with it; `alike` has the other. observations: that the water was fitted to, with
    `view`.
    """
    H, by_cluster = _cluster_sums(observations, water)
    before = uncertainty.standard_error.by_channel()
    error, alike = before.copy(), uncertainty.covariance.copy()
    for s in by_cluster:
        n = int((s != 0).any(axis=(0, 1)).sum())
        if n <= 3:
            continue
        for c in range(3):
            k = np.flatnonzero(np.isfinite(before[c]) & (np.diag(H[c]) > 0))
            effect = np.linalg.pinv(H[c][np.ix_(k, k)], rcond=1e-14, hermitian=True) @ s[c, k]
            covariance = effect @ effect.T * n / (n - 3)
            error[c, k] = np.fmax(error[c, k], np.sqrt(np.diag(covariance)))
            whole = np.zeros((3, 3))
            whole[np.ix_(k, k)] = covariance
            alike[c] = whole if whole.trace() > alike[c].trace() else alike[c]
    return replace(uncertainty, standard_error=WaterParameters.of_channels(error), alike=alike)


def with_disagreement(uncertainty: WaterUncertainty, among: Array) -> WaterUncertainty:
    """Return the uncertainty with the covariance (3 channels, 3, 3) among waters that are as good."""
    before = uncertainty.covariance if uncertainty.alike is None else uncertainty.alike
    spread = np.sqrt(np.einsum("cii->ci", among))
    error = np.hypot(uncertainty.standard_error.by_channel(), spread)
    return replace(
        uncertainty,
        standard_error=WaterParameters.of_channels(error),
        alike=before + among,
    )


def errors_said(water: WaterParameters, uncertainty: WaterUncertainty, far: float) -> list[str]:
    """Say what is known only roughly, and by how much colours at a distance far, m, may be wrong if that is much."""
    rows, errors = water.by_channel(), uncertainty.standard_error.by_channel()
    said = []
    for c, colour in enumerate(CHANNELS):
        loose = [
            f"{name} {value:.3g} ± {spread:.2g}"
            for name, value, spread in zip(_PARAMETERS, rows[c], errors[c], strict=True)
            if _is_loose(value, spread)
        ]
        if loose and not uncertainty.is_weak[c]:
            said.append(f"{colour}: is known only roughly: {', '.join(loose)}")
    many = [
        f"{colour} {share:.0%}"
        for colour, share in zip(CHANNELS, errors[:, 1] * far, strict=True)
        if share > _WRONG
    ]
    if many:
        said.append(f"colours of far ground may be wrong by {', '.join(many)}")
    return said


def _cluster_sums(
    observations: Observations, water: WaterParameters
) -> tuple[Array, list[Array]]:
    """Return H (3, 3, 3), and the sums of D'^T r over tiles (3, 3, T) and over views (3, 3, V)."""
    height, width = observations.shape
    view = observations.view
    down = _TILES * observations.stacked
    y, x = np.divmod(observations.pixels, width)
    tile = y * down // height * _TILES + x * _TILES // width
    H = np.zeros((3, 3, 3))
    sums = [np.zeros((9, down * _TILES)), np.zeros((9, len(observations.views)))]
    rows = tuple(column[..., None] for column in water.columns())
    for block in blocks(observations, _PLACES, stop=observations.n_repeated):
        columns = Eliminated.of(*fill(observations, block, np.float64), rows).columns
        D = columns[:, :3]
        scores = (columns[:, :3] * columns[:, 3:]).reshape(9, block.slots, -1)
        H += np.einsum("cikn,cjkn->cij", D, D)
        sums[0] += _summed(
            scores.sum(axis=1), tile[block.start : block.start + block.n], sums[0].shape[1]
        )
        for k, (n, part) in enumerate(observations.slots(block.start, block.start + block.n)):
            if view is not None:
                sums[1] += _summed(scores[:, k, :n], view[part], sums[1].shape[1])
    return H, [total.reshape(3, 3, -1) for total in sums]


def _summed(rows: Array, cluster: Indices, n: int) -> Array:
    """Return the sums (R, n) of rows (R, N) over the elements of each cluster (N,)."""
    return np.stack([np.bincount(cluster, row, n) for row in rows])


def for_known_water(uncertainty: WaterUncertainty) -> WaterUncertainty:
    """Return the uncertainty when the water is known from elsewhere: colours have noise, the water has no error."""
    kept = (_TOO_FEW,) if np.isnan(uncertainty.noise).any() else ()
    return replace(
        uncertainty, covariance=np.zeros((3, 3, 3)), standard_error=UNKNOWN, limits=kept
    )


def uncertainty_of(
    water: WaterParameters,
    system: ReducedSystem,
    free: Mask | None,
    n_excess: int,
    dead: Mask | None = None,
    weak: Mask | None = None,
    *,
    tied: bool = False,
) -> WaterUncertainty:
    """Return the uncertainty of a water from the system around it.

    free: (3 channels, 3) bool, parameters that no bound holds, None for all; n_excess: how many more observations than
    pixels there are, over pixels seen repeatedly; dead, weak: (3,) bool, channels without signal, and those that a weak
    prior decides; tied: gamma is beta.
    """
    dead, weak = (np.zeros(3, dtype=bool) if which is None else which for which in (dead, weak))
    free = np.ones((3, 3), dtype=bool) if free is None else free
    system = system.tied() if tied else system
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
    if tied:
        covariance = TIED.T @ covariance @ TIED
        error = error[:, [0, 1, 1]]
        informed = informed[:, [0, 1, 1]]
    limits = _limits(water.by_channel(), free, informed, dead, weak)
    if n_excess <= 3:
        limits.append(_TOO_FEW)
    is_weak = bool(weak[0]), bool(weak[1]), bool(weak[2])
    return WaterUncertainty(
        noise, covariance, WaterParameters.of_channels(error), condition, tuple(limits), is_weak
    )


def _limits(water: Array, free: Mask, informed: Mask, dead: Mask, weak: Mask) -> list[str]:
    limits = []
    for c, colour in enumerate(CHANNELS):
        if dead[c]:
            limits.append(f"{colour}: black or white in all views; it was left as it is")
            continue
        if weak[c]:
            limits.append(f"{colour}: {_TYPICAL if water[c, 0] else _NO_VEIL}")
            continue
        for which, why in (
            (~informed[c], "cannot be told from these views"),
            (informed[c] & ~free[c], "at the end of the range"),
        ):
            if which.any():
                limits.append(f"{colour}: {' and '.join(np.array(_PARAMETERS)[which])} {why}")
    return limits


def roughly_known(water: WaterParameters, uncertainty: WaterUncertainty) -> list[str]:
    """Return the channels with a parameter whose standard error is large."""
    is_loose = _is_loose(water.by_channel(), uncertainty.standard_error.by_channel())
    return [
        name for name, of_channel in zip(CHANNELS, is_loose, strict=True) if of_channel.any()
    ]


def _is_loose(value: Array, error: Array) -> Mask:
    return np.asarray(error > _LOOSE * np.abs(value))
