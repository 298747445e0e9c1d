"""The exact minimum of SUCRe's eq. 7, to the digits that the data hold.

Every pixel's colour is eliminated (model.py), which leaves three parameters a channel. `fit` finds them on a
sample of pixels from several starts, and refines them by a few passes over all observations. Only the sample is random,
and it has a seed. The number of threads changes nothing.

physical: many real images are fitted best by a veil that is brighter than their darkest pixels, which makes colours
negative. With this option every pixel whose colour would lie below zero by more than its noise adds that shortfall as
a residual (passes.py). The noise comes from the residuals of the free fit (`_margin`). Pixels seen once take
part: no veil is brighter than what is seen through it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.machine.compute import Device
from sucre_bench.methods.sucre.diagnostics import CHANNELS, ROUNDING, WaterUncertainty, uncertainty_of
from sucre_bench.methods.sucre.levenberg import Bounds, Minimum, minimise
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters
from sucre_bench.methods.sucre.passes import Backend, Kernel, opened
from sucre_bench.methods.sucre.robust import LEAST_NOISE, robust_noise
from sucre_bench.methods.sucre.samples import SAMPLE, first_slot, sampled
from sucre_bench.methods.sucre.starting_points import bounds_for, promising
from sucre_bench.methods.sucre.weak_priors import has_veil, is_clear, undetermined, with_priors
from sucre_bench.multiview.observations import Observations

# Pixels that the starts are tried on, how many starts, and how many different minima the sample chooses from.
_SCREEN, _STARTS, _MINIMA = 2_000, 8, 3

# Minima whose parameters differ by less (relative) are one. A sample cannot rank costs that differ by less (relative).
_ALIKE, _UNDECIDED = 0.05, 0.01

# The cost has twin minima: one with a backscatter like the attenuation, and one with a far larger backscatter, whose
# veil is full at all distances: an offset of all colours, most of which it makes negative. Light that differs between
# views, and pixels that are paired wrongly, change which of them is lower. No water scatters so much more than it
# attenuates (Jerlov's types: a factor of 2). So a minimum whose gamma is more than this many times its beta counts only
# if its cost is lower by this share.
_IMPLAUSIBLE, _HANDICAP = 5.0, 0.05

# Tolerances on the promised gain, relative to the cost: to tell minima apart, on the sample, and at the end.
_SCREENED, _ROUGHLY, _TOLERANCE = 1e-4, 1e-6, 1e-7


@dataclass(frozen=True, slots=True, eq=False)
class WaterFit:
    """A fitted water.

    cost: (3,) sum of squared residuals of each channel over pixels seen more than once; uncertainty: of the water;
    passes: over all observations; converged: whether no further step promises a gain.
    """

    water: WaterParameters
    cost: Array
    uncertainty: WaterUncertainty
    passes: int
    converged: bool


def fit(
    observations: Observations | Sequence[Observations],
    *,
    physical: bool = False,
    sharp: Sequence[Observations | None] = (),
    backend: Backend = "auto",
    device: Device = "auto",
    seed: int = 0,
    sample: int = SAMPLE,
) -> WaterFit:
    """Find the one water that explains the observations of one image, or of several, best.

    physical: hold colours above zero, up to the noise of the free fit. sharp: for each image whose observations are
    blurred, those whose colours are held, each pixel by its first observation; None for other images. sample: pixels
    that minima are chosen on.
    Raises NotApplicableError when no pixel is seen twice, or all from one distance each.
    """
    images = [observations] if isinstance(observations, Observations) else observations
    sharp = [sharp_one for sharp_one, one in zip(sharp or [None] * len(images), images, strict=True) if one.n_repeated]
    images = [one for one in images if one.n_repeated]
    if not images:
        raise NotApplicableError(_HOPELESS.format("no pixel is seen in two views"))
    few = _samples(images, sample, singles=physical, seed=seed)
    _check_spread(few)
    distance = float(np.median(np.concatenate([one.distance for one in few])))
    search, margin = _Search(distance, bounds_for(distance), backend, device), None
    starts, ends = search.screened(_samples(few, _SCREEN, singles=False, seed=seed))
    ends = search.ends(few, None, _distinct(ends))
    dark = [first_slot(one) for one in sharp if one is not None] if physical else []
    if physical:
        margin = _margin(few, sharp, WaterParameters.of_channels(_distinct(ends)[0]))
        ends = search.ends([*few, *dark], margin, [*_distinct(ends), *starts])
    return search.refined(images, dark, margin, _distinct(ends, _UNDECIDED), starts[:2], _is_constant(few))


@dataclass(frozen=True, slots=True, eq=False)
class _Search:
    """The descents of a fit; distance: median of the observations, metres."""

    distance: float
    bounds: Bounds
    backend: Backend
    device: Device

    @contextmanager
    def _opened(self, images: Sequence[Observations]) -> Iterator[list[Kernel]]:
        with ExitStack() as stack:
            yield [stack.enter_context(opened(one, self.backend, self.device)) for one in images]

    def screened(self, fewest: Sequence[Observations]) -> tuple[list[Array], list[Minimum]]:
        """Return the most promising starts on very few pixels, best first, and where each leads."""
        with self._opened(fewest) as kernels:
            evaluate = _summed(kernels, None)
            starts = promising(evaluate, self.distance, self.bounds, keep=_STARTS)
            return starts, [minimise(evaluate, at, self.bounds, tolerance=_SCREENED, max_steps=15) for at in starts]

    def ends(self, few: Sequence[Observations], margin: Array | None, starts: Sequence[Array]) -> list[Minimum]:
        """Return where the starts lead on a sample."""
        with self._opened(few) as kernels:
            evaluate = _summed(kernels, margin)
            return [minimise(evaluate, start, self.bounds, tolerance=_ROUGHLY) for start in starts]

    def refined(
        self,
        images: Sequence[Observations],
        dark: Sequence[Observations],
        margin: Array | None,
        starts: Sequence[Array],
        grid: Sequence[Array],
        dead: Mask,
    ) -> WaterFit:
        """Return the lowest minimum over all observations, with weak priors where these do not determine a channel.

        dark: what only holds colours up; grid: more starts with priors; dead: (3,), channels without signal.
        """
        floor = ROUNDING * sum(map(len, images))

        def lowest(evaluate: Callable[[Array], ReducedSystem], starts: Iterable[Array]) -> Minimum:
            return _best([minimise(evaluate, at, self.bounds, tolerance=_TOLERANCE, floor=floor) for at in starts])

        with self._opened([*images, *dark]) as kernels:
            evaluate = _summed(kernels, margin)
            end = lowest(evaluate, starts)
            known = _uncertainty(end, images, dead)
            weak = undetermined(end.at, known, end.free, dead, self.distance)
            if weak.any():
                prior = with_priors(evaluate, known.noise, self.distance, weak)
                clear = is_clear(end.at, known, self.distance)
                end = _with_weak_channels(end, lowest(prior, (end.at, *grid)), weak, clear, evaluate, self.distance)
            if margin is not None:  # without the shortfall of negative colours
                end = replace(end, system=replace(end.system, cost=_summed(kernels, None)(end.at).cost))
        uncertainty = _uncertainty(end, images, dead)
        if weak.any():
            limits = (*uncertainty.limits, *_decided_by_priors(weak, end.at))
            uncertainty = replace(uncertainty, limits=limits, is_weak=(bool(weak[0]), bool(weak[1]), bool(weak[2])))
        return WaterFit(_water(end, dead), end.system.cost, uncertainty, end.steps + 1, bool(end.converged.all()))


# With matched footprints, colours may be below zero by this many standard deviations of a pixel's noise. Where no light
# is left, noise alone puts half of all colours below zero: of 20,000 pixels, 27 below three deviations, and one below
# four. With one, gamma of red was 10 % too low.
_MARGIN = 4.0

# Distances that differ by less are the same: float32 and depth maps in millimetres resolve no more.
_SAME = 1e-4

# A channel is dead if it varies by less than this over the whole sample: one level of 8 bits.
_FLAT = 1 / 256

_HOPELESS = "{}; give views that see the same places from other distances, or a known water (method.water=FILE)"


def _water(end: Minimum, dead: Mask) -> WaterParameters:
    return WaterParameters.of_channels(np.where(dead[:, None], 0, end.at))  # a dead channel: J = I


def _uncertainty(end: Minimum, images: Sequence[Observations], dead: Mask) -> WaterUncertainty:
    excess = sum(one.n_excess for one in images)
    return uncertainty_of(_water(end, dead), end.system, end.free, excess, dead)


def _decided_by_priors(weak: Mask, rows: Array) -> list[str]:
    """Say which model the channels have that the observations did not determine."""
    limits = []
    for c, colour in enumerate(CHANNELS):
        if weak[c] and rows[c, 0] == 0:
            limits.append(f"{colour}: no backscatter can be seen; fitted without")
        elif weak[c]:
            limits.append(f"{colour}: only a combination of B, beta and gamma is known; a weak prior decides")
    return limits


def _with_weak_channels(
    end: Minimum,
    prior: Minimum,
    weak: Mask,
    clear: Mask,
    evaluate: Callable[[Array], ReducedSystem],
    distance: float,
) -> Minimum:
    """Take the weak channels (3,) from the fit with priors, without backscatter where no veil can be seen.

    clear: (3,), channels without attenuation, which have no veil either.
    """
    is_veiled = has_veil(prior.at, distance) & ~clear & (prior.at[:, 1] > 0)
    veiled = np.where(is_veiled[:, None], prior.at, prior.at * [0, 1, 0])
    at = np.where(weak[:, None], veiled, end.at)
    free = np.where(weak[:, None], prior.free, end.free)
    converged = np.where(weak, prior.converged, end.converged)
    return Minimum(at, evaluate(at), free, end.steps + prior.steps + 2, converged)


def _margin(few: Sequence[Observations], sharp: Sequence[Observations | None], free: WaterParameters) -> Array:
    """Return how far (3,) below zero colours may fall, from the residuals in the water of the free fit.

    Residuals hold more than noise: light that changes between views, and what the model leaves out. Both scale colours,
    so they vanish at zero; and both stay when the images are blurred. So the noise of a pixel is the variance that
    blurring takes away: that of the sharp observations, less that of the same image's blurred ones in `few`. Where
    nothing is blurred it is one standard deviation of the residuals: the free fit is biased the other way.
    """
    pairs = [(sharp_one, blurred) for sharp_one, blurred in zip(sharp, few, strict=True) if sharp_one is not None]
    if not pairs:
        return np.asarray(np.mean([robust_noise(one, free) for one in few], axis=0))
    lost = [robust_noise(sharp_one, free) ** 2 - robust_noise(blurred, free) ** 2 for sharp_one, blurred in pairs]
    return np.asarray(_MARGIN * np.sqrt(np.maximum(lost, LEAST_NOISE**2)).mean(axis=0))


def _samples(images: Sequence[Observations], n: int, *, singles: bool, seed: int) -> list[Observations]:
    """Return about n pixels of all images together, the same number of each."""
    return [sampled(one, n // len(images) + 1, singles=singles, seed=seed + k) for k, one in enumerate(images)]


def _distinct(ends: Sequence[Minimum], within: float = 1e9) -> list[Array]:
    """Return the few lowest minima (3 channels, 3), best first, for each channel by itself.

    within: how much higher than the best a cost may be, relative.
    """
    per_channel = []
    for c in range(3):
        found = [(float(cost), end.at[c]) for end in ends if np.isfinite(cost := _plausible_cost(end)[c])]
        if not found:
            raise SolveError(_HOPELESS.format("no water gives finite residuals"))
        found.sort(key=lambda pair: pair[0])
        lowest: list[Array] = []
        for cost, at in found:
            if cost <= found[0][0] * (1 + within) and not any(np.allclose(at, other, rtol=_ALIKE) for other in lowest):
                lowest.append(at)
        per_channel.append(lowest)
    return [
        np.stack([minima[min(k, len(minima) - 1)] for minima in per_channel])
        for k in range(min(_MINIMA, max(map(len, per_channel))))
    ]


def _plausible_cost(end: Minimum) -> Array:
    """Return the costs (3,), higher for waters that scatter far more than they attenuate."""
    implausible = end.at[:, 2] > _IMPLAUSIBLE * end.at[:, 1]
    return np.where(implausible, 1 + _HANDICAP, 1.0) * end.system.cost


def _best(ends: Sequence[Minimum]) -> Minimum:
    """Combine the best end of each channel."""
    which = np.argmin([_plausible_cost(end) for end in ends], axis=0)

    def pick(values: Sequence[Any]) -> Any:
        return np.stack([values[which[c]][c] for c in range(3)])

    system = ReducedSystem(*(pick([getattr(end.system, name) for end in ends]) for name in ("H", "g", "cost")))
    at, free, converged = (pick([getattr(end, name) for end in ends]) for name in ("at", "free", "converged"))
    return Minimum(at, system, free, sum(end.steps + 1 for end in ends) - 1, converged)


def _summed(kernels: Sequence[Kernel], margin: Array | None) -> Callable[[Array], ReducedSystem]:
    def evaluate(rows: Array) -> ReducedSystem:
        water = WaterParameters.of_channels(rows)
        first, *others = (kernel.system(water, margin) for kernel in kernels)
        return sum(others, first)

    return evaluate


def _check_spread(few: Sequence[Observations]) -> None:
    """Raise NotApplicableError when every pixel is seen from one distance: then any water fits."""
    for one in few:
        nearest, farthest = one.distance_range()
        if (farthest > nearest * (1 + _SAME)).any():
            return
    raise NotApplicableError(_HOPELESS.format("every pixel is seen from one distance only"))


def _is_constant(few: Sequence[Observations]) -> Mask:
    """(3,) bool: channels with the same value everywhere, black or saturated, which hold no information."""
    lowest = np.min([one.colour.min(axis=1) * one.scale for one in few], axis=0)
    highest = np.max([one.colour.max(axis=1) * one.scale for one in few], axis=0)
    return np.asarray(highest - lowest < _FLAT)
