"""A flat ground surveyed by a vehicle that carries its only light, seen from nearly one height.

Written independently of the package. The vehicle flies at about one height with its camera down, and a strobe beside
the camera lights the ground: a Gaussian lobe, falling with the square of the distance. Light is lost in the water on
both ways. So brightness falls towards the rim of every picture, and distance rises there, both together.
"""

from __future__ import annotations

import numpy as np

from sucre_bench import Arrays, Camera, Scene, View, Water
from support.made_ground import SIZE, looking_down, photograph


def make_survey(
    water: Water,
    *,
    views: int = 8,
    height_m: float = 3.0,
    relief: float = 0.03,
    step_m: float = 0.5,
    strobe_m: tuple[float, float, float] = (0.7, 0.0, 0.0),
    lobe_deg: float = 35.0,
    strobe: bool = True,
    daylight: float = 0.0,
    width: int = 80,
    height: int = 60,
    noise: float = 0.004,
    seed: int = 0,
) -> Scene:
    """Views along a line; relief: the heights' range as a share; lobe_deg: its standard deviation; strobe: false for
    even light from above instead; daylight: how much of that light is there besides the strobe's."""
    rng = np.random.default_rng(seed)
    texture = (0.25 + 0.5 * _smooth(rng)).astype(np.float32)
    camera = Camera(np.array([[1.1 * width, 0, width / 2], [0, 1.1 * width, height / 2], [0, 0, 1.0]]), width, height)
    taken = []
    for k in range(views):
        h = height_m * (1 + rng.uniform(-relief / 2, relief / 2))
        shift = np.array([step_m * (k - views / 2), rng.uniform(-0.2, 0.2)])
        pose = looking_down(h, np.deg2rad(rng.uniform(-2, 2, 2)), shift)
        rgb, depth, distance = photograph(texture, camera, pose)
        light, way = 1.0, distance
        if strobe:
            u, v = np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5)
            X = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.K).T * depth[..., None]
            Y = X - np.array(strobe_m)
            reach = np.linalg.norm(Y, axis=-1)
            angle = np.rad2deg(np.arccos(Y[..., 2] / reach))
            light = np.exp(-0.5 * (angle / lobe_deg) ** 2) * (height_m / reach) ** 2
            way = distance + reach
        seen = through(water, rgb, way)
        if strobe:  # exposed so that the brightest ground is just below full scale
            by_day = through(water, rgb, distance)
            seen = seen * light[..., None] * np.exp(1.3 * water.attenuation.min() * height_m) + daylight * by_day
        stored = np.rint((seen + rng.normal(0, noise, seen.shape)).clip(0, 1) * 255) / 255
        taken.append(View(f"{k}.png", Arrays(stored, depth, rgb), camera, pose))
    return Scene("survey", taken, frozenset({"depth", "poses", "reference", "truth"}), water)


def through(water: Water, rgb: np.ndarray, way: np.ndarray) -> np.ndarray:
    """What is seen of colours (H, W, 3) after light's way (H, W) through water, metres."""
    z = way[..., None]
    return rgb * np.exp(-water.attenuation * z) + water.veiling_light * (1 - np.exp(-water.backscatter * z))


def _smooth(rng: np.random.Generator) -> np.ndarray:
    """A texture in [0, 1] with detail at three scales, nearly gray."""
    total = np.zeros((SIZE, SIZE, 3))
    for cell, strength in ((1, 0.3), (4, 0.4), (20, 0.3)):
        few = rng.uniform(0, 1, (SIZE // cell, SIZE // cell, 1)) + 0.3 * rng.uniform(
            -1, 1, (SIZE // cell, SIZE // cell, 3)
        )
        total += strength * few.repeat(cell, axis=0).repeat(cell, axis=1)
    return np.clip(total, 0, 1)
