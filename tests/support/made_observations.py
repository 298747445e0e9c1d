"""Observations made without images: pixels of random colour seen through known water, and everything one by one."""

from typing import Any

import numpy as np

from sucre_bench import Water
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.models import fit_water
from sucre_bench.methods.sucre.solution import Solution
from sucre_bench.multiview.observations import Observations, Seen, arrange
from support.forward_model import in_water
from support.made_scene import WATER

# Options of `sucre` with one model to fit: the judge, which chooses among several, has tests of its own.
ONE_MODEL: dict[str, Any] = {
    "light": "even",
    "footprint": True,
    "physical": False,
    "robust": False,
}


def solve_exact(
    observations: Observations, matched: Observations | None = None, **options: Any
) -> Solution:
    """Return the colours of observations in the water that is fitted to them; options: see `fit_water`."""
    place = {key: options[key] for key in ("backend", "device") if key in options}
    return fit_water(observations, matched, **options).colours_of(observations, **place)


def made(
    n_pixels: int,
    n_views: int = 8,
    *,
    distances_m: tuple[float, float] = (1, 10),
    water: Water = WATER,
    noise: float = 0.0,
    eight_bit: bool = False,
    n_single: int = 0,
    seed: int = 0,
    colours: tuple[float, float] = (0.1, 0.9),
    shape: tuple[int, int] | None = None,
) -> tuple[Observations, np.ndarray]:
    """Return observations and the true J (3, P): pixels in 70 % of the views each, the last n_single in one only.

    shape: (H, W) of the target, H W pixels; with it, observations have their views.
    """
    rng = np.random.default_rng(seed)
    J = rng.uniform(*colours, (n_pixels, 3))
    seen = []
    for k in range(n_views):
        several = np.flatnonzero(rng.random(n_pixels - n_single) < (1.0 if k < 2 else 0.7))
        chosen = np.arange(n_pixels) if k == 0 else several
        z = rng.uniform(*distances_m, len(chosen)).astype(np.float32)
        I = in_water(J[chosen], z, water)
        I = I + noise * rng.standard_normal(I.shape)
        stored = (
            np.rint(I.clip(0, 1) * 255).astype(np.uint8) if eight_bit else I.astype(np.float32)
        )
        seen.append(Seen(f"{k}.png", chosen, z, stored))
    observations = arrange(shape or (1, n_pixels), seen, with_view=shape is not None)
    return observations, J[observations.pixels].T


def parameters(water: Water) -> WaterParameters:
    return WaterParameters(water.veiling_light, water.attenuation, water.backscatter)


def table(water: WaterParameters) -> np.ndarray:
    """(3, 3): rows B, beta, gamma; columns RGB."""
    return np.stack([water.B, water.beta, water.gamma])


def record_of(water: Water) -> dict[str, Any]:
    """What a file or a run records of a water."""
    return dict(zip(("B", "beta", "gamma"), table(parameters(water)).tolist(), strict=True))


def flat(observations: Observations) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Every observation by itself: its place among the pixels (N,), z (N,) and I (3, N), float64."""
    place = np.concatenate([np.arange(n) for n, _ in observations.slots()])
    return (
        place,
        observations.distance.astype(np.float64),
        observations.intensity(slice(None)).astype(np.float64),
    )


def reduced_residuals(
    observations: Observations, channel: int, water: np.ndarray
) -> np.ndarray:
    """The residuals (N,) of one channel with every pixel's best colour, float64, one pixel after the other."""
    place, z, I = flat(observations)
    B, beta, gamma = water
    a, y = np.exp(-beta * z), I[channel] - B * (1 - np.exp(-gamma * z))
    n = len(observations.pixels)
    J = np.bincount(place, a * y, n) / np.bincount(place, a * a, n)
    return y - J[place] * a
