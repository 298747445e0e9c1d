"""The exact minimum of SUCRe's eq. 7, to the digits that the data hold.

Every pixel's colour is eliminated (model.py), which leaves three parameters a channel. `fit` finds them on a sample of
pixels from several starts, and refines them by a few passes over all observations. Only the sample is random, and it
has a seed. The number of threads changes nothing.

physical: many real images are fitted best by a veil that is brighter than their darkest pixels, which makes colours
negative. With this option every pixel whose colour would lie below zero by more than its noise adds that shortfall as
a residual (passes.py). The noise comes from the residuals of the free fit (`_margin`). Pixels seen once take part: no
veil is brighter than what is seen through it.

Starting points. The best of a grid of attenuations and backscatters, each with its best veiling light.

B enters linearly, and neither its column D'_B nor the elimination of colours depends on it. So for given rates the
system at B = 0 holds the whole parabola cost(B) = cost - 2 g_B B + H_BB B^2, and one pass gives its minimum. The grid
is in units of the observed distances, since scenes may have any scale.

Weak priors. A fit without priors answers channels that the observations do not determine all the same: with a
parameter at its bound, or with a value that another sample of pixels would change by half. Where distances are short or
alike, only the product of B and gamma is known. Then, and only then, a channel is fitted again with two normal priors.
They are optical depths over the median distance d of the observations, so that the scale of the scene does not matter:

    gamma d = beta d  +- 0.5    most waters attenuate and scatter at similar rates (Jerlov's types: a factor of 2)
    beta d  = 0       +- 3      images that show anything have not lost more than exp(-3) of their light

A prior with deviation s adds (noise / s)^2 to the normal equations, noise being that of an observation. Channels that
the data determine stay exactly as they are. A veil that no 8-bit image could show counts as no backscatter: B = 0.
So does the veil of a channel that nothing dims, as in air: no water scatters far more than it attenuates. So does one
whose veiling light would be white, as under a strobe, even if gamma is beta (eq. 1), which is tried first.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.minimise import Bounds, Minimum, minimise
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters, veil
from sucre_bench.methods.sucre.observed import SAMPLE, first_slot, sampled
from sucre_bench.methods.sucre.passes import Backend, opened
from sucre_bench.methods.sucre.robust import LEAST_NOISE, robust_noise
from sucre_bench.methods.sucre.uncertainty import (
    WaterUncertainty,
    rescaled_to_noise,
    uncertainty_of,
)
from sucre_bench.multiview.observations import Observations

# The rounding of float32 sums of intensities, as a cost: 1e-6 rms of each observation.
_ROUNDING = 1e-12

_Evaluate = Callable[[Array], ReducedSystem]

# Pixels that the starts are tried on, how many starts, and how many different minima the sample chooses from.
_SCREEN = 2_000
_STARTS = 8
_MINIMA = 3

# Minima whose parameters differ by less (relative) are one. A sample cannot rank costs that differ by less (relative).
_ALIKE = 0.05
_UNDECIDED = 0.01

# The cost has twin minima: one with a backscatter like the attenuation, and one with a far larger backscatter, whose
# veil is full at all distances: an offset of all colours, most of which it makes negative. Light that differs between
# views, and pixels that are paired wrongly, change which of them is lower. So a minimum that scatters implausibly much
# (model.py) counts only if its cost is lower by this share.
_HANDICAP = 0.05

# Tolerances on the promised gain, relative to the cost: to tell minima apart, on the sample, and at the end.
_SCREENED = 1e-4
_ROUGHLY = 1e-6
_TOLERANCE = 1e-7

# With matched footprints, colours may be below zero by this many standard deviations of a pixel's noise. Where no light
# is left, noise alone puts half of all colours below zero: of 20,000 pixels, 27 below three deviations, and one below
# four. With one, gamma of red was 10 % too low.
_MARGIN = 4.0

# Distances that differ by less are the same: float32 and depth maps in millimetres resolve no more.
_SAME = 1e-4

# A channel is dead if it varies by less than this over the whole sample: one level of 8 bits.
_FLAT = 1 / 256

# Attenuation and backscatter over the typical distance: a twentieth of the light lost, to nearly all.
_GRID = (0.05, 0.2, 0.7, 2.0, 6.0)

# Largest optical depth over the typical distance: exp(-30) of the light is none.
_MOST_DEPTH = 30.0

# Deviations of the priors, as optical depths.
_SPREAD_ALIKE = 0.5
_SPREAD_DEPTH = 3.0

# A parameter whose standard error is more than this share of its value is not determined.
_LOOSE = 0.5

# Less optical depth than this is none. Pure water has as much in red over .2 m.
_CLEAR = 0.05

# The least veil at the median distance that 8 bits show.
_LEAST_VEIL = 0.5 / 255


@dataclass(frozen=True, slots=True, eq=False)
class WaterFit:
    """A fitted water."""

    water: WaterParameters

    cost: Array
    """Sum of squared residuals of each channel, (3,), over pixels seen more than once."""

    uncertainty: WaterUncertainty

    passes: int
    """Over all observations."""

    converged: bool
    """Whether no further step promises a gain."""


def fit(
    observations: Observations,
    *,
    physical: bool = False,
    sharp: Observations | None = None,
    backend: Backend = "auto",
    device: Device = "auto",
    seed: int = 0,
    growth: Array | float = 1.0,
    near: WaterParameters | None = None,
    free: WaterParameters | None = None,
) -> WaterFit:
    """Find the one water that explains observations best.

    physical: hold colours above zero, up to the noise of the free fit. sharp: where the observations are blurred, those
    whose colours are held, each pixel by its first observation.
    growth: (3,) how many times larger errors are than those of independent observations, which weak priors count by.
    near: a minimum of almost the same observations, the only start then. free: the minimum without `physical`.
    Raises NotApplicableError when no pixel is seen twice, or all from one distance each.
    """
    check_pairs(observations)
    few = sampled(observations, SAMPLE, singles=physical, seed=seed)
    distance = float(np.median(few.distance))
    search = _Search(distance, backend, device, growth)
    margin = None
    dark = [] if sharp is None or not physical else [first_slot(sharp)]
    with search.over([sampled(few, _SCREEN, singles=False, seed=seed)]) as evaluate:
        starts = _promising(evaluate, distance)
        is_searched = near is None and free is None
        tried = [
            search.descended(evaluate, at, tolerance=_SCREENED, most=15)
            for at in (starts if is_searched else [])
        ]
    if near is not None:
        # nothing leads away from 0
        found = [
            near.by_channel(),
            *(() if near.by_channel().all() else starts[:2]),
        ]
        margin = _margin(few, sharp, near) if physical else None
    else:
        found = (
            [free.by_channel()]
            if free
            else _distinct(search.ends([few], None, _distinct(tried)), _UNDECIDED)
        )
        if physical:
            margin = _margin(few, sharp, WaterParameters.of_channels(found[0]))
            found = _distinct(search.ends([few, *dark], margin, [*found, *starts]), _UNDECIDED)
    lowest, highest = few.colour.min(axis=1) * few.scale, few.colour.max(axis=1) * few.scale
    # black or saturated everywhere, without information
    dead = np.asarray(highest - lowest < _FLAT)
    return search.refined(observations, dark, margin, found, starts[:2], dead)


def check_pairs(observations: Observations) -> None:
    """Raise NotApplicableError if observations tell nothing of a water: it needs pixels at unlike distances."""
    if not observations.n_repeated:
        raise NotApplicableError(*_hopeless("no pixel is seen in two views"))
    nearest, farthest = observations.distance_range()
    if not (farthest > nearest * (1 + _SAME)).any():  # then any water fits
        raise NotApplicableError(*_hopeless("every pixel is seen from one distance only"))


def _hopeless(fault: str) -> tuple[str, str, str]:
    """Why no water can be fitted, as an error has it."""
    known = "a known water (method.water=FILE)"
    return fault, "", f"give views that see the same places from other distances, or {known}"


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The descents of a fit."""

    distance: float
    """Median of the observations, metres."""

    backend: Backend
    device: Device

    growth: Array | float
    """See `fit`."""

    def descended(
        self, evaluate: _Evaluate, start: Array, *, tied: bool = False, **limits: Any
    ) -> Minimum:
        """Return where a start leads; tied: with gamma = beta, from rows that have one coefficient."""
        most = _MOST_DEPTH / self.distance  # rates for scenes seen from about this distance
        bounds = Bounds(
            np.zeros(3), np.array([1.0, most, most]), np.array([True, False, False])
        )
        if not tied:
            return minimise(evaluate, start, bounds, **limits)
        end = minimise(
            lambda rows: evaluate(rows[:, [0, 1, 1]]).tied(), start, bounds, **limits
        )
        return replace(end, at=end.at[:, [0, 1, 1]], free=end.free[:, [0, 1, 1]])

    @contextmanager
    def over(
        self, images: Sequence[Observations], margin: Array | None = None
    ) -> Iterator[_Evaluate]:
        """Open observations, whose systems are summed at given rows (3 channels, 3)."""
        with ExitStack() as stack:
            kernels = [
                stack.enter_context(opened(one, self.backend, self.device)) for one in images
            ]

            def evaluate(rows: Array) -> ReducedSystem:
                water = WaterParameters.of_channels(rows)
                first, *others = (kernel.system(water, margin) for kernel in kernels)
                return sum(others, first)

            yield evaluate

    def ends(
        self, few: Sequence[Observations], margin: Array | None, starts: Sequence[Array]
    ) -> list[Minimum]:
        """Return where the starts lead on a sample."""
        with self.over(few, margin) as evaluate:
            return [self.descended(evaluate, start, tolerance=_ROUGHLY) for start in starts]

    def refined(
        self,
        observations: Observations,
        dark: Sequence[Observations],
        margin: Array | None,
        starts: Sequence[Array],
        grid: Sequence[Array],
        dead: Mask,
    ) -> WaterFit:
        """Return the lowest minimum over all observations, with weak priors where these do not determine a channel.

        dark: what only holds colours up; grid: more starts with priors; dead: (3,), channels without signal.
        """
        floor = _ROUNDING * len(observations)

        def lowest(evaluate: _Evaluate, starts: Iterable[Array]) -> Minimum:
            return _best(
                [
                    self.descended(evaluate, at, tolerance=_TOLERANCE, floor=floor)
                    for at in starts
                ]
            )

        with self.over([observations, *dark], margin) as evaluate:
            end = lowest(evaluate, starts)
            known = _uncertainty(end, observations, dead)
            known = rescaled_to_noise(known, known.noise * self.growth)
            weak = _undetermined(end.at, known, end.free, dead, self.distance)
            if weak.any():
                prior = _with_priors(evaluate, known.noise, self.distance, weak)
                # Attenuation is 0: at that bound, or within its error, if that is small enough. An error that could
                # hide a visible optical depth shows no clear medium, but an unknown one.
                beta = end.at[:, 1]
                most = 2 * known.standard_error.beta
                clear = (beta == 0) | (
                    (beta <= most) & ((beta + most) * self.distance < _CLEAR)
                )
                likely = lowest(prior, (end.at, *grid))
                if (bright := weak & ~clear & (likely.at[:, 0] >= 1)).any():
                    one = self.descended(
                        prior, likely.at, tied=True, tolerance=_TOLERANCE, floor=floor
                    )
                    at = np.where(bright[:, None], one.at, likely.at)
                    at[at[:, 0] >= 1] *= [0, 1, 0]
                    likely = replace(
                        likely, at=at, free=np.where(bright[:, None], one.free, likely.free)
                    )
                # No veil where none can be seen, nor where nothing is attenuated.
                is_veiled = _has_veil(likely.at, self.distance) & ~clear & (likely.at[:, 1] > 0)
                veiled = np.where(is_veiled[:, None], likely.at, likely.at * [0, 1, 0])
                at = np.where(weak[:, None], veiled, end.at)
                free = np.where(weak[:, None], likely.free, end.free)
                converged = np.where(weak, likely.converged, end.converged)
                end = Minimum(at, evaluate(at), free, end.steps + likely.steps + 2, converged)
        if margin is not None:  # without the shortfall of negative colours
            with self.over([observations]) as evaluate:
                end = replace(end, system=replace(end.system, cost=evaluate(end.at).cost))
        uncertainty = _uncertainty(end, observations, dead, weak)
        return WaterFit(
            _water(end, dead),
            end.system.cost,
            uncertainty,
            end.steps + 1,
            bool(end.converged.all()),
        )


def _water(end: Minimum, dead: Mask) -> WaterParameters:
    # a dead channel: J = I
    return WaterParameters.of_channels(np.where(dead[:, None], 0, end.at))


def _uncertainty(
    end: Minimum, observations: Observations, dead: Mask, weak: Mask | None = None
) -> WaterUncertainty:
    return uncertainty_of(
        _water(end, dead), end.system, end.free, observations.n_excess, dead, weak
    )


def _margin(few: Observations, sharp: Observations | None, free: WaterParameters) -> Array:
    """Return how far (3,) below zero colours may fall, from the residuals in the water of the free fit.

    Residuals hold more than noise: light that changes between views, and what the model leaves out. Both scale colours,
    so they vanish at zero; and both stay when the images are blurred. So the noise of a pixel is the variance that
    blurring takes away: that of the sharp observations, less that of the same image's blurred ones in `few`. Where
    nothing is blurred it is one standard deviation of the residuals: the free fit is biased the other way.
    """
    if sharp is None:
        return robust_noise(few, free)
    lost = robust_noise(sharp, free) ** 2 - robust_noise(few, free) ** 2
    return np.asarray(_MARGIN * np.sqrt(np.maximum(lost, LEAST_NOISE**2)))


def _distinct(ends: Sequence[Minimum], within: float = 1e9) -> list[Array]:
    """Return the few lowest minima (3 channels, 3), best first, for each channel by itself.

    within: how much higher than the best a cost may be, relative.
    """
    per_channel = []
    for c in range(3):
        costs = [(float(_plausible_cost(end)[c]), end.at[c]) for end in ends]
        found = [pair for pair in costs if np.isfinite(pair[0])]
        if not found:
            raise SolveError(*_hopeless("no water gives finite residuals"))
        found.sort(key=lambda pair: pair[0])
        lowest: list[Array] = []
        for cost, at in found:
            if cost <= found[0][0] * (1 + within) and not any(
                np.allclose(at, other, rtol=_ALIKE) for other in lowest
            ):
                lowest.append(at)
        per_channel.append(lowest)
    return [
        np.stack([minima[min(k, len(minima) - 1)] for minima in per_channel])
        for k in range(min(_MINIMA, max(map(len, per_channel))))
    ]


def _plausible_cost(end: Minimum) -> Array:
    """Return the costs (3,), higher for waters that scatter far more than they attenuate."""
    is_implausible = WaterParameters.of_channels(end.at).is_implausible
    return np.where(is_implausible, 1 + _HANDICAP, 1.0) * end.system.cost


def _best(ends: Sequence[Minimum]) -> Minimum:
    """Combine the best end of each channel."""
    which = np.argmin([_plausible_cost(end) for end in ends], axis=0)

    def pick(values: Sequence[Any]) -> Any:
        return np.stack([values[which[c]][c] for c in range(3)])

    system = ReducedSystem(
        *(pick([getattr(end.system, name) for end in ends]) for name in ("H", "g", "cost", "K"))
    )
    at, free, converged = (
        pick([getattr(end, name) for end in ends]) for name in ("at", "free", "converged")
    )
    return Minimum(at, system, free, sum(end.steps + 1 for end in ends) - 1, converged)


# -- starting points ------------------------------------------------------------


def _promising(evaluate: _Evaluate, distance_m: float) -> list[Array]:
    """Return the best waters (3 channels, 3) of the grid, best first, for each channel by itself."""
    waters, costs = [], []
    for beta, gamma in itertools.product(_GRID, _GRID):
        water = np.tile([0.0, beta / distance_m, gamma / distance_m], (3, 1))
        at_zero = evaluate(water)
        slope, curve = at_zero.g[:, 0], at_zero.H[:, 0, 0]
        B = np.divide(slope, curve, out=np.zeros(3), where=curve > 0).clip(0, 1)
        water[:, 0] = B
        waters.append(water)
        costs.append(at_zero.cost - 2 * slope * B + curve * B**2)
    order = np.argsort(costs, axis=0, kind="stable")  # (grid, 3)
    return [np.stack([waters[order[k, c]][c] for c in range(3)]) for k in range(_STARTS)]


# -- weak priors ------------------------------------------------------------


def _undetermined(
    rows: Array, uncertainty: WaterUncertainty, free: Mask, dead: Mask, distance: float
) -> Mask:
    """Return the channels (3,) with a parameter at a bound or with a large standard error, or without a veil.

    rows: (3 channels, 3) B, beta, gamma; free: (3, 3), parameters that no bound holds; dead: (3,), channels without
    signal, which no prior helps; distance: median, m.
    """
    error = uncertainty.standard_error.by_channel()
    loose = (~free | (error > _LOOSE * np.abs(rows))).any(axis=1) | ~_has_veil(rows, distance)
    return np.asarray(loose & ~dead & np.isfinite(uncertainty.noise))


def _with_priors(
    evaluate: _Evaluate, noise: Array, distance: float, channels: Mask
) -> _Evaluate:
    """Return the evaluation with priors on some channels (3,); noise: (3,) of an observation; distance: median, m."""
    scale = np.where(channels, noise * distance, 0)
    J = np.zeros((3, 2, 3))  # of the two prior residuals in B, beta, gamma
    J[:, 0, 1], J[:, 0, 2] = -scale / _SPREAD_ALIKE, scale / _SPREAD_ALIKE
    J[:, 1, 1] = scale / _SPREAD_DEPTH

    def evaluated(rows: Array) -> ReducedSystem:
        residual = np.einsum("ckp,cp->ck", J, rows)
        H = np.einsum("cki,ckj->cij", J, J)
        slope = -np.einsum("cki,ck->ci", J, residual)
        prior = ReducedSystem(H, slope, (residual**2).sum(axis=1), H)
        return evaluate(rows) + prior

    return evaluated


def _has_veil(rows: Array, distance: float) -> Mask:
    """Return the channels (3,) whose veil at a distance is more than 8 bits can miss."""
    return np.asarray(veil(np.full(3, distance), rows[:, 0], rows[:, 2]) > _LEAST_VEIL)
