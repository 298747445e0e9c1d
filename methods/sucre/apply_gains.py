"""Brings the observations of all views to one exposure, given the gains of some views.

The gains are fitted to a sample of pixels in some of the views. A view that the sample lacks has the gain that brings
the mean of its observations to what the other views explain,

    g = sum I / sum (J a + b),    J from the views whose gains are known.

Means are alike over any footprint, so sharp pixels serve.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.machine.text_formats import counted
from sucre_bench.methods.sucre.model import WaterParameters, transmission, veil
from sucre_bench.multiview.observations import Observations

# Fewest observations that tell the gain of a view.
_OFTEN = 100


@dataclass(frozen=True, eq=False)
class AtOneExposure:
    """Observations in the exposure of their target.

    gains: of the views, 1 for the target; unknown: views whose exposure is not known, which take no part.
    """

    observations: Observations
    gains: Mapping[str, float]
    unknown: tuple[str, ...]

    @staticmethod
    def of(
        observations: Observations, gains: Mapping[str, float], water: WaterParameters, target: str
    ) -> AtOneExposure:
        """Bring observations to the target's exposure; water: in the exposure with gain 1. SolveError without one."""
        assert observations.view is not None, "observe with views"
        gains = all_gains(observations, gains, water)
        if target not in gains:
            raise SolveError("the target shares too few pixels with other views; use method.exposure=constant")
        gains = relative_to(gains, target)
        shown = [observations.views[k] for k in np.unique(observations.view)]
        unknown = tuple(name for name in shown if name not in gains)
        return AtOneExposure(corrected(observations, gains), gains, unknown)

    @property
    def limits(self) -> tuple[str, ...]:
        """What to say of the views that take no part."""
        if not self.unknown:
            return ()
        n, names = counted(len(self.unknown), "view"), ", ".join(self.unknown)
        return (f"{n} shared too few pixels to find the exposure, and took no part: {names}",)


def all_gains(observations: Observations, gains: Mapping[str, float], water: WaterParameters) -> dict[str, float]:
    """Return the gains with those of the views that lack one, as far as they share pixels with views that have one.

    observations: with `view`; water: fitted with the gains.
    """
    assert observations.view is not None, "observe with views"
    gain = _by_index(observations, gains)
    if (gain > 0).all():
        return dict(gains)
    B, beta, gamma = (column.astype(np.float32) for column in water.columns())
    top, bottom = np.zeros((2, 3, len(observations.pixels)), dtype=np.float32)
    for n, part in observations.slots():
        z, g = observations.distance[part], gain[observations.view[part]]
        a = transmission(z, beta)
        top[:, :n] += g * a * (observations.intensity(part) - g * veil(z, B, gamma))
        bottom[:, :n] += (g * a) ** 2
    J = top / np.maximum(bottom, np.finfo(np.float32).tiny)
    sums = np.zeros((3, len(gain)))  # of I, of J a + b, and of observations
    for n, part in observations.slots():
        z, view = observations.distance[part], observations.view[part]
        new = (gain[view] == 0) & (bottom[:, :n] > 0).all(axis=0)
        explained = (J[:, :n] * transmission(z, beta) + veil(z, B, gamma)).sum(axis=0)
        for total, values in zip(sums, (observations.intensity(part).sum(axis=0), explained, np.ones(n)), strict=True):
            total += np.bincount(view[new], values[new], len(gain))
    known = (sums[2] >= _OFTEN) & (sums[:2] > 0).all(axis=0)
    found = {observations.views[k]: float(sums[0, k] / sums[1, k]) for k in np.flatnonzero(known)}
    return dict(gains) | found


def corrected(observations: Observations, gains: Mapping[str, float]) -> Observations:
    """Return the observations as the exposure with gain 1 would have recorded them: I / g with g^2 times the weight.

    observations: with `view`. Those of views without a gain have weight 0; pixels with nothing else are left out.
    """
    assert observations.view is not None, "observe with views"
    gain = _by_index(observations, gains)[observations.view]
    weight = gain**2 if observations.weight is None else observations.weight * gain**2
    colour = observations.intensity(slice(None)) / np.where(gain > 0, gain, 1)
    even = replace(observations, colour=colour, weight=weight)
    kept = np.zeros(len(even.pixels), dtype=bool)
    for m, part in even.slots():
        kept[:m] |= weight[part] > 0
    return even if kept.all() else even.take(np.flatnonzero(kept))


def relative_to(gains: Mapping[str, float], target: str) -> dict[str, float]:
    """Return the gains divided by that of the target."""
    return {name: gain / gains[target] for name, gain in gains.items()}


def _by_index(observations: Observations, gains: Mapping[str, float]) -> Array:
    """Return the gains (V,) float32 in the order of `views`; 0 for a view without one, or without observations 1."""
    assert observations.view is not None
    gain = np.array([gains.get(name, 0.0) for name in observations.views], dtype=np.float32)
    shown = np.bincount(observations.view, minlength=len(gain)) > 0
    return np.where(shown, gain, 1)
