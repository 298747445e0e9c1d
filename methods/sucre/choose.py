"""Chooses the parts of light (light.py) that the observations pay for, and stored intensities or linear light.

One rule decides: pixels that no fit has seen. The image is cut into tiles. Each model is fitted to every second tile
and judged on the others, then the reverse. Its cost is the bounded misfit of robust.py, in units of the noise without
the new part. Errors within a tile are alike, so tiles count as the independent ones: a part is taken if the mean gain
over the tiles is more than three of its standard errors, and more than a small share of the cost. Parts are added one
by one until none is taken: of those that gain about as much as the best, the one with the fewest unknowns.

Gains of views can stand for what a simple model of water leaves out, if each view sees the ground from another
distance. Then they explain a little, and beta is known worse with them. So gains are taken only if beta is known
better: where light does differ, the residuals fall so much that the standard errors of beta fall, though there are more
unknowns.

encoding=auto takes the encoding in which the model explains more. Water acts on light. A camera's files store a curve
of it, and the curve is often near sRGB. Where it is, the model explains linear light better; where the file holds
something else, as the demo does, stored intensities. The water is fitted to equal footprints in both, and the residuals
of linear light are divided by the slope of the curve. So both are in stored units, in which noise is alike.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError, SolveError
from sucre_bench.methods.sucre.exact import fit
from sucre_bench.methods.sucre.light import Light, LightFit, Parts, Problem, Sample, fit_light
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.refine_noise import decoding_slope, residuals_of
from sucre_bench.methods.sucre.robust import C2, robust_noise
from sucre_bench.methods.sucre.solution import colours_for_water, matched_at, sampled
from sucre_bench.multiview.observations import Observations
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from sucre_bench.methods.sucre.sucre import Sucre

# Pixels that parts are chosen on, the fewest worth it, and pixels that the chosen light is fitted to.
_TRIED_ON, _FEWEST, _FITTED = 1_500, 200, 4_000

# Tiles along each side of the image.
_TILES = 6

# Standard errors, and the share of the cost, that a part must gain.
_SURE, _SHARE = 3.0, 0.1

# With gains, the standard errors of beta must be below this share of those without, in the mean of the channels.
_SHARPER = 0.8

# The share of the squared residuals that one linear step must promise before a part is fitted.
_PROMISED = 0.1

# From here on, a channel may have been cut off.
_FULL = 0.99

# beta is not told from the light where its standard error over the median distance is above this optical depth.
_LOOSE = 0.1


@dataclass(frozen=True, slots=True)
class Tried:
    """A model that was judged: its gain as a share of the cost, and in standard errors."""

    parts: Parts
    gain: float
    sigmas: float

    @property
    def counts(self) -> bool:
        return self.gain > _SHARE and self.sigmas > _SURE


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """The light of the chosen parts, None for even light; is_separable: whether distances tell it from attenuation."""

    fit: LightFit | None
    is_separable: bool
    tried: tuple[Tried, ...]


def choose(
    matched: Observations, target: str, water: WaterParameters, parts: Parts | None, *, may_be_strobe: bool
) -> Chosen:
    """Return the light of observations with `view` and `ray`; target: a name; water: fitted in even light.

    parts: None to choose them. Gains that distances do not tell from attenuation are not taken by themselves.
    """
    whole = uncut(matched)
    if whole.n_repeated < _FEWEST or parts == Parts():
        return Chosen(None, True, ())
    tried: list[Tried] = []
    if parts is None:
        few = Sample.of(sampled(whole, _TRIED_ON, singles=False, seed=0), target)
        parts, tried = _chosen(few, water, robust_noise(whole, water), may_be_strobe=may_be_strobe)
        if parts == Parts():
            return Chosen(None, True, tuple(tried))
    sample = Sample.of(sampled(whole, _FITTED, singles=False, seed=0), target)
    found = fit_light(sample, parts, Light.even(water, sample.views))
    is_separable = bool((found.error[:, 1] * float(np.median(whole.distance)) < _LOOSE).all())
    if tried and not is_separable and not (parts.lens or parts.strobe):
        return Chosen(None, False, tuple(tried))
    return Chosen(found, is_separable, tuple(tried))


def uncut(observations: Observations) -> Observations:
    """Return the pixels that no view shows with a channel at the end of the scale, where light is cut off."""
    kept = np.ones(len(observations.pixels), dtype=bool)
    for n, part in observations.slots():
        kept[:n] &= (observations.intensity(part) < _FULL).all(axis=0)
    return observations if kept.all() else observations.take(np.flatnonzero(kept))


def _richer(parts: Parts, *, may_be_strobe: bool) -> Iterator[Parts]:
    """Yield the models with one part more."""
    if parts.gains < 1:
        yield replace(parts, gains=1)
    if parts.gains < 3:
        yield replace(parts, gains=3)
    if not parts.lens and not parts.strobe:
        yield replace(parts, lens=True)
    if may_be_strobe and parts.lens:
        yield replace(parts, strobe=True, lens=False)


def _chosen(sample: Sample, water: WaterParameters, noise: Array, *, may_be_strobe: bool) -> tuple[Parts, list[Tried]]:
    """Return the parts of light that count, and every model that was judged."""
    at = np.floor(sample.place * _TILES).astype(np.int64)
    tile, fold = at[1] * _TILES + at[0], at.sum(axis=0) % 2
    halves = [(sample.take(fold == k), tile[fold == k]) for k in range(2)]
    light, tried, cost, before = Light.even(water, sample.views), [], None, None
    while True:
        found = []
        for one in _richer(light.parts, may_be_strobe=may_be_strobe):
            if not one.strobe and _promised(sample, one, light) < _PROMISED:
                continue
            cost = _held_out(halves, light.parts, light, noise) if cost is None else cost
            new = _held_out(halves, one, light, noise)
            gain = (cost - new)[cost + new > 0]
            sigmas = float(gain.mean() / max(gain.std(ddof=1) / np.sqrt(len(gain)), 1e-12))
            found.append((Tried(one, float(gain.sum() / cost.sum()), sigmas), new))
        tried += [one for one, _ in found]
        found = [pair for pair in found if pair[0].counts]
        if not found:
            return light.parts, tried
        before = fit_light(sample, light.parts, light) if before is None else before
        taken = None
        while found and taken is None:
            most = max(one.gain for one, _ in found)  # what gains as much with fewer unknowns is the better part
            near = [pair for pair in found if pair[0].gain > most - _SHARE]
            best = min(near, key=lambda pair: Problem(sample, pair[0].parts).size)
            fit = fit_light(sample, best[0].parts, light)
            if best[0].parts.gains == light.parts.gains or _is_sharper(fit, before):
                taken = fit
            found.remove(best)
        if taken is None:
            return light.parts, tried
        light, before, cost = taken.light, taken, best[1]


def _is_sharper(fit: LightFit, before: LightFit) -> bool:
    """Return whether beta is known better than in a fit before."""
    old, new = before.error[:, 1], fit.error[:, 1]
    return bool(np.divide(new, old, out=np.ones(3), where=old > 0).mean() < _SHARPER)


def _promised(sample: Sample, parts: Parts, light: Light) -> float:
    """Return the share of the squared residuals that one linear step from a light to more parts promises."""
    problem = Problem(sample, parts)
    system = problem.system(problem.unknowns(light))
    H, g = system.H[0], system.g[0]
    used = np.flatnonzero(np.diag(H) > 0)
    scale = 1 / np.sqrt(np.diag(H)[used])
    scaled = H[np.ix_(used, used)] * scale[:, None] * scale + 1e-9 * np.eye(len(used))
    step = np.linalg.solve(scaled, g[used] * scale)
    return float(step @ (g[used] * scale) / max(system.cost[0], 1e-30))


def _held_out(halves: list[tuple[Sample, Array]], parts: Parts, light: Light, noise: Array) -> Array:
    """Return the bounded misfit of each tile, from the fit to the other half."""
    cost = np.zeros(_TILES**2)
    for (fitted, _), (judged, tile) in (halves, halves[::-1]):
        found = fit_light(fitted, parts, light).light
        cost += np.bincount(tile, _misfit(judged, found, noise), _TILES**2)
    return cost


def _misfit(sample: Sample, light: Light, noise: Array) -> Array:
    """Return the bounded misfit of each pixel (P,) in a fitted water and light."""
    falling = np.nan_to_num(light.falling(sample.ray, np.arange(len(sample.views))), nan=1)
    a, b = light.eq_6(sample.ray, sample.z)
    s = np.sqrt(sample.weight) / noise[:, None, None]
    x, y = s * falling * a, s * (sample.I - falling * b)
    A = np.maximum((x * x).sum(axis=2, keepdims=True), 1e-30)
    r = y - (x * y).sum(axis=2, keepdims=True) / A * x
    squares = (r * r / np.maximum(1 - x * x / A, 1e-3)).sum(axis=0)
    return np.asarray((squares / (1 + squares / C2)).sum(axis=1))


# -- encoding ----------------------------------------------------------------------

# Linear light is chosen where it leaves less than this share of the residuals of stored intensities. Made scenes in
# linear light had .79 to .89, others 1.3 to 1.6; with uneven light, and on real photographs, both were near 1.
_BETTER = 0.95

# Pixels that both are fitted to.
_PIXELS = 2_000

# Observations that decide their pixel's colour alone have no residual.
_ALONE = 0.9


@dataclass(frozen=True, slots=True)
class NearerEncoding:
    """The encoding that the model explains better; ratio: residuals of linear light over those of stored intensities.

    They are those of the fits that decided: without gains if these refuse linear light, else with a gain for each view.
    None if nothing tells.
    """

    encoding: Literal["view", "linear"]
    ratio: float | None = None


def nearer_encoding(
    options: Sucre, scene: Scene, view: View, observations: Observations, matched: Observations | None
) -> NearerEncoding:
    """Return the encoding in which the water of a view explains more: stored intensities where too few pixels tell.

    observations: stored intensities; matched: their sample with equal footprints. The footprints of linear light are
    means of decoded images: over rough texture, decoded means of stored intensities explain neither encoding. Linear
    light must also explain more where each view has a gain: a camera's exposure that follows the distance is a curve.
    """
    if matched is None or view.encoding == "linear":
        return NearerEncoding("view")
    few = sampled(matched, _PIXELS, singles=False, seed=0)
    in_linear = replace(options, encoding="linear")
    try:
        decoded = matched_at(in_linear, scene, view, observations, few.pixels)
        for parts in (Parts(), Parts(gains=1)):
            stored = _residual(options, few, view, parts)
            linear = _residual(options, decoded, view, parts, decoding_slope)
            if not linear < _BETTER * stored:
                return NearerEncoding("view", linear / stored if stored > 0 else None)
    except (NotApplicableError, SolveError):
        return NearerEncoding("view")
    return NearerEncoding("linear", linear / stored)


def _residual(
    options: Sucre, sample: Observations, view: View, parts: Parts, slope: Callable[[Array], Array] = np.ones_like
) -> float:
    """Return the median size of studentised residuals in stored units; slope: of intensities by stored ones."""
    water = fit(sample, **options.compute).water
    if parts != Parts():
        few = Sample.of(sample, view.name)
        light = fit_light(few, parts, Light.even(water, few.views)).light
        sample, water = light.removed(sample), light.water
    solution = colours_for_water(sample, water, None, options.backend, options.device)
    r, h, _, explained = residuals_of(sample, solution.J, water)
    recorded = explained if sample.weight is None else explained * np.sqrt(sample.weight)
    r = r / slope(recorded.clip(0, 1))
    return float(np.median(np.abs(r / np.sqrt(1 - h.clip(0, _ALONE)))[h < _ALONE]))
