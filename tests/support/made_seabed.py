"""A seabed of random colours that can be put into any water: distances rise over the image, some pixels are black."""

from __future__ import annotations

import numpy as np

from sucre_bench import Arrays, Scene, View, Water
from support.forward_model import in_water, photographed

CLEAR = Water(np.array([0.06, 0.22, 0.3]), np.array([0.42, 0.14, 0.1]), np.array([0.3, 0.17, 0.13]))


def random_seabed(seed: int = 0, water: Water = CLEAR, near: float = 2.0, far: float = 8.0) -> View:
    """Distances rise over the image; every fortieth pixel or so is black; 8 bits. Its reference is J."""
    rng = np.random.default_rng(seed)
    z = np.tile(np.linspace(near, far, 160, dtype=np.float32)[:, None], (1, 120))
    J = rng.uniform(0.1, 0.9, (160, 120, 3))
    J[rng.random(z.shape) < 0.025] = 0.002
    return view_in_water(J, z, water)


def view_in_water(J: np.ndarray, z: np.ndarray, water: Water) -> View:
    """A view, 8 bits, whose reference is J."""
    return View("a.png", Arrays(photographed(in_water(J, z, water)), z, J))


def alone(view: View) -> Scene:
    return Scene("alone", [view], frozenset({"depth"}))
