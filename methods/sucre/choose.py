"""Chooses the parts of light (light.py) that the observations pay for.

One rule decides: pixels that no fit has seen. The image is cut into tiles. Each model is fitted to every second tile
and judged on the others, then the reverse. Its cost is the bounded misfit of robust.py, in units of the noise without
the new part. Errors within a tile are alike, so tiles count as the independent ones: a model is taken if the mean gain
over the tiles is more than three of its standard errors, and more than a small share of the cost. Even light is judged
against gains of views and channels with a lens. How much of each there is, their spreads tell (light.py); a part
without any is left out. Then a strobe is judged in place of the lens.

Gains can stand for attenuation, where each view sees the ground from another distance. Then they explain a little, and
beta is known worse with them. Where light does differ, residuals fall so much that beta is known better, though there
are more unknowns. So gains are taken only if the errors of beta fall; else a lens is judged alone.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.methods.sucre.light import TILES, Light, LightFit, Parts, Problem, Sample, fit_light, residuals_in
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.robust import C2, robust_noise
from sucre_bench.methods.sucre.solution import sampled
from sucre_bench.multiview.observations import Observations

# Pixels that parts are chosen on, the fewest worth it, and pixels that the chosen light is fitted to.
_TRIED_ON, _FEWEST, _FITTED = 1_500, 200, 4_000

# Standard errors, and the share of the cost, that a part must gain.
_SURE, _SHARE = 3.0, 0.1

# With gains, the standard errors of beta must be below this share of those without, in the mean of the channels. They
# are at .05 to .55 where light differs, at .9 to 2.6 on photographs of a camera with manual exposure.
_SHARPER = 0.8

# The share of the squared residuals that a rough descent must save before more is fitted, which saves time.
_PROMISED = 0.1

# All but a strobe. A strobe is tried where the lens leaves less light than this in the corners, which saves time.
_ALL, _LENS, _DIM = Parts(gains=3, lens=True), Parts(lens=True), 0.8

# From here on, a channel may have been cut off.
_FULL = 0.99


@dataclass(frozen=True, slots=True)
class Tried:
    """A model that was judged: its gain as a share of the cost, and in standard errors."""

    parts: Parts
    gain: float
    sigmas: float


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """The light of the chosen parts, None for even light, and the models that were judged."""

    fit: LightFit | None
    tried: tuple[Tried, ...] = ()


def choose(
    matched: Observations, target: str, water: WaterParameters, parts: Parts | None, *, may_be_strobe: bool
) -> Chosen:
    """Return the light of observations with `view` and `ray`; target: a name; water: fitted in even light.

    parts: None to choose them.
    """
    whole = uncut(matched)
    if whole.n_repeated < _FEWEST or parts == Parts():
        return Chosen(None)
    tried: list[Tried] = []
    if parts is None:
        few = Sample.of(sampled(whole, _TRIED_ON, singles=False, seed=0), target)
        parts, tried = _chosen(few, water, robust_noise(whole, water), may_be_strobe=may_be_strobe)
        if parts == Parts():
            return Chosen(None, tuple(tried))
    sample = Sample.of(sampled(whole, _FITTED, singles=False, seed=0), target)
    return Chosen(fit_light(sample, parts, Light.even(water, sample.views)), tuple(tried))


def uncut(observations: Observations) -> Observations:
    """Return the pixels that no view shows with a channel at the end of the scale, where light is cut off."""
    kept = np.ones(len(observations.pixels), dtype=bool)
    for n, part in observations.slots():
        kept[:n] &= (observations.intensity(part) < _FULL).all(axis=0)
    return observations if kept.all() else observations.take(np.flatnonzero(kept))


def _chosen(sample: Sample, water: WaterParameters, noise: Array, *, may_be_strobe: bool) -> tuple[Parts, list[Tried]]:
    """Return the parts of light that count, and every model that was judged."""
    tile, fold = sample.tile[0] * TILES + sample.tile[1], sample.tile.sum(axis=0) % 2
    halves = [(sample.take(fold == k), tile[fold == k]) for k in range(2)]
    light, tried = Light.even(water, sample.views), list[Tried]()
    if min(len(tile) for _, tile in halves) < _FEWEST // 2:  # what views share lies in few tiles
        return light.parts, tried
    problem = Problem(sample, _ALL)
    start = problem.unknowns(light)
    if not problem.descend(start, _PROMISED)[1].cost < (1 - _PROMISED) * problem.system(start).cost:
        return light.parts, tried
    parts, better, cost = light.parts, _ALL, _held_out(halves, light.parts, light, noise)
    lens: LightFit | None = None
    while True:
        new = _held_out(halves, better, light, noise)
        gain = (cost - new)[cost + new > 0]
        if len(gain) < 2:  # noise-free: nothing is left to explain
            return parts, tried
        sigmas = float(gain.mean() / max(gain.std(ddof=1) / np.sqrt(len(gain)), 1e-12))
        tried.append(Tried(better, float(gain.sum() / cost.sum()), sigmas))
        if not (tried[-1].gain > _SHARE and sigmas > _SURE):
            return parts, tried
        found = lens if lens and better == _LENS else fit_light(sample, better, light)
        if better == _ALL and found.needed.gains:
            lens = fit_light(sample, _LENS, light)
            old = lens.error[:, 1]
            if np.divide(found.error[:, 1], old, out=np.ones(3), where=old > 0).mean() >= _SHARPER:
                better = _LENS
                continue
        parts, light, cost = found.needed, found.light, new
        if parts.strobe or not may_be_strobe or light.least > _DIM:
            return parts, tried
        better = replace(parts, lens=False, strobe=True)


def _held_out(halves: list[tuple[Sample, Array]], parts: Parts, light: Light, noise: Array) -> Array:
    """Return the bounded misfit of each tile, from the fit to the other half."""
    cost = np.zeros(TILES**2)
    for (fitted, _), (judged, tile) in (halves, halves[::-1]):
        found = fit_light(fitted, parts, light).light
        r, _, leverage = residuals_in(judged, replace(found, gains=np.nan_to_num(found.gains)))
        squares = (r**2 / noise[:, None, None] ** 2 / np.maximum(1 - leverage, 1e-3)).sum(axis=0)
        cost += np.bincount(tile, (squares / (1 + squares / C2)).sum(axis=1), TILES**2)
    return cost
