"""CIE Lab of colour charts: from and to sRGB, and between illuminants (CIE 1931 2 degree observer, Bradford).

`colour_science` is the package that does the sums, for whoever needs more of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import ModuleType

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, did_you_mean

__all__ = ["ciede2000", "colour_science", "lab_d50", "lab_d50_from", "srgb_of_lab_d50"]


def colour_science() -> ModuleType:
    """Return the package colour, whose import alters how numpy writes numbers (in CSV files, too), without that."""
    with np.printoptions():
        import colour

    return colour


def lab_d50(srgb: Array) -> Array:
    """Return CIE Lab under D50 of gamma-encoded sRGB (..., 3) in [0, 1], adapted from D65 by Bradford's transform."""
    colour = colour_science()
    white = _white("D50")
    XYZ = colour.sRGB_to_XYZ(srgb, illuminant=white, chromatic_adaptation_transform="Bradford")
    return np.asarray(colour.XYZ_to_Lab(XYZ, white))


def srgb_of_lab_d50(lab: Array) -> Array:
    """Return gamma-encoded sRGB of CIE Lab under D50 (..., 3), clipped to [0, 1]: a picture shows no more."""
    colour = colour_science()
    XYZ = colour.Lab_to_XYZ(lab, _white("D50"))
    srgb = colour.XYZ_to_sRGB(XYZ, illuminant=_white("D50"), chromatic_adaptation_transform="Bradford")
    return np.asarray(srgb).clip(0, 1)


def lab_d50_from(lab: Array, illuminant: str) -> Array:
    """Return CIE Lab under D50 of CIE Lab (..., 3) under another illuminant. InputError for one that is unknown."""
    colour = colour_science()
    white, d50 = _white(illuminant), _white("D50")
    if illuminant == "D50":
        return lab
    XYZ = colour.chromatic_adaptation(
        colour.Lab_to_XYZ(lab, white), colour.xy_to_XYZ(white), colour.xy_to_XYZ(d50), transform="Bradford"
    )  # by default von Kries'
    return np.asarray(colour.XYZ_to_Lab(XYZ, d50))


def ciede2000(a: Array, b: Array) -> Array:
    """Return CIEDE2000 between CIE Lab colours a and b (..., 3), k_L = k_C = k_H = 1 (Sharma et al. 2005)."""
    return np.asarray(colour_science().delta_E(a, b, method="CIE 2000"))


def _white(illuminant: str) -> Array:
    """The chromaticity (2,) of an illuminant."""
    observers: Mapping[str, Mapping[str, Array]] = colour_science().CCS_ILLUMINANTS
    known = observers["CIE 1931 2 Degree Standard Observer"]
    if illuminant not in known:
        raise InputError(f"illuminant '{illuminant}': unknown; {did_you_mean(illuminant, known)}")
    return known[illuminant]
