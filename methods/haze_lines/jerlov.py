"""Jerlov's optical water types, as ratios of the attenuation of blue, green and red.

Attenuation at the wavelengths of the sensors' peaks, from Jerlov 1976, Marine optics, as used by Berman, Levy, Avidan &
Treibitz 2021: from clear ocean (I) over murky ocean (III) to the coast (1C to 5C).
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array


@dataclass(frozen=True)
class WaterType:
    """A water: blue_to_red = beta_B / beta_R and blue_to_green = beta_B / beta_G, attenuation coefficients in 1/m."""

    name: str
    blue_to_red: float
    blue_to_green: float

    @property
    def exponents(self) -> Array:
        """(3,) float32, beta_B / beta_c of red, green, blue: the transmission of a channel to this power is blue's."""
        return np.array([self.blue_to_red, self.blue_to_green, 1.0], dtype=np.float32)


WATER_TYPES = (
    WaterType("I", 0.1118, 0.4566),
    WaterType("IA", 0.1452, 0.5499),
    WaterType("IB", 0.1745, 0.6341),
    WaterType("II", 0.2773, 0.7937),
    WaterType("III", 0.4051, 0.9539),
    WaterType("1C", 0.4642, 1.0930),
    WaterType("3C", 0.6515, 1.1244),
    WaterType("5C", 1.0000, 1.2725),
)
