"""Estimates one gain for each view together with the water, for cameras that expose automatically.

    I = g_v (J a + b)

g_v: the exposure of view v, the same for all channels. All gains times s, with J and B divided by s, explain the same
observations, so the target has g = 1: J is in its exposure. A gain and exp(-beta z) act alike on a view whose points
all have one distance. So only views that show a range of distances separate gains from attenuation. Without such views,
the standard error of beta is large. The fit is that of light_and_water.py, with a column for each view.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import SolveError
from sucre_bench.methods.sucre.light_and_water import ObservationsByPixel, fit_light
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.solution import sampled
from sucre_bench.multiview.observations import Observations

# Pixels that the gains are fitted to.
_SAMPLE = 5_000

# Gains that differ by this much are reported; from so many observations a view on.
_DIFFERENT, _OFTEN = 0.05, 100

# beta is not told from the gains where its standard error over the median distance is above this optical depth.
_LOOSE = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """gains: of the views in the sample by name, 1 for the target, or for another view if the sample lacks it; water:
    fitted with them; error: (3,) standard error of beta; is_separable: whether distances tell the gains from
    attenuation; noise: rms of the residuals."""

    gains: dict[str, float]
    water: WaterParameters
    error: Array
    is_separable: bool
    noise: float

    @property
    def limit(self) -> str:
        """What is said of gains that are not separable."""
        return "distances do not separate exposure from attenuation; use method.exposure=constant, or more views"


def estimate(
    observations: Observations, target: str, water_start: WaterParameters, *, seed: int = 0, most: int = _SAMPLE
) -> Exposure:
    """Fit gains and water to random pixels seen more than once, at most so many.

    observations: with `view`; target: the name of the view whose gain is 1; water_start: fitted without gains.
    Raises SolveError when no pixel is seen twice.
    """
    if observations.view is None or not observations.n_repeated:
        raise SolveError("method.exposure=per_view needs pixels that several views show; use method.exposure=constant")
    few = sampled(observations, most, singles=False, seed=seed)
    assert few.view is not None
    sample = ObservationsByPixel.of(few)
    view = few.view[sample.pixels.order]
    seen = np.unique(view)
    held = next((k for k in seen if few.views[k] == target), seen[0])
    free = seen[seen != held]
    found = fit_light(sample, (view == free[:, None]).astype(np.float64), water_start)
    gains = {few.views[k]: 1.0 for k in seen}
    gains |= {few.views[k]: float(gain) for k, gain in zip(free, np.exp(found.coefficients), strict=True)}
    is_separable = bool((found.error * float(np.median(few.distance)) < _LOOSE).all())
    return Exposure(gains, found.water, found.error, is_separable, found.noise)


def differing_exposure(observations: Observations, water: WaterParameters) -> str:
    """Return that the exposures of views differ, if so, in the water that was fitted without gains; else nothing.

    The gains here are those that fit each view best with that water and its colours. They are too near 1, since water
    and colours have taken part of them.
    """
    few = observations.take(np.arange(min(observations.n_repeated, _SAMPLE)))
    assert few.view is not None
    sample = ObservationsByPixel.of(few)
    view = few.view[sample.pixels.order].astype(np.int64)
    a, b, J = sample.colours(np.ones(len(sample.z)), water)
    model = J * a + b
    n = len(few.views)
    counts = np.bincount(view, minlength=n)
    often = counts > _OFTEN
    if not often.any():
        return ""
    total = [np.bincount(view, values.sum(axis=0), n)[often] for values in (sample.I * model, model**2)]
    gains = total[0] / np.maximum(total[1], 1e-30)
    if gains.max() < (1 + _DIFFERENT) * gains.min():
        return ""
    spread = f"{gains.min():.2f} to {gains.max():.2f}"
    return f"exposure seems to differ between views (gains {spread})"
