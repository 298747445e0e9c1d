"""CIE Lab of colour charts (D50): from and to sRGB, and between illuminants; Lab (D65) and luma of images.

Charts: CIE 1931 2 degree observer, Bradford. sRGB and its matrices are those of IEC 61966-2-1, Lab that of CIE 15:2004.
The package colour-science gives the same within 1e-9; it is imported for rare illuminants only, since it brings
matplotlib and takes seconds.
"""

from collections.abc import Mapping
from types import ModuleType
from typing import Any, cast

import numpy as np

from sucre_bench.arrays import AnyArray, Array
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.provenance import load

_XYZ_OF_RGB = np.array(
    [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
)
_RGB_OF_XYZ = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]]
)
_BRADFORD = np.array(
    [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]]
)

# Chromaticities (x, y) of the illuminants that makers of charts name (CIE 15:2004, table T.3).
_WHITES: Mapping[str, tuple[float, float]] = {
    "A": (0.44758, 0.40745),
    "C": (0.31006, 0.31616),
    "D50": (0.3457, 0.3585),
    "D55": (0.33243, 0.34744),
    "D65": (0.3127, 0.3290),
    "D75": (0.29903, 0.31488),
    "E": (1 / 3, 1 / 3),
}


def colour_science() -> ModuleType:
    """Return the package colour, whose import alters how numpy writes numbers (in CSV files, too), without that.

    InputError if it is not installed.
    """
    with np.printoptions():
        return cast(ModuleType, load("ColorChecker SG and rare illuminants", "colour"))


def lab_d50(srgb: AnyArray) -> Array:
    """Return CIE Lab under D50 of gamma-encoded sRGB (..., 3) in [0, 1], adapted from D65 by Bradford's transform."""
    return lab_d50_of_linear(srgb_decode(np.asarray(srgb, dtype=np.float64)))


def lab_d50_of_linear(rgb: Array) -> Array:
    """Return CIE Lab under D50 of linear light (..., 3) in sRGB's primaries, adapted from D65."""
    return lab_d50_of_xyz(_mapped(_XYZ_OF_RGB, rgb), _white("D65"))


def srgb_of_lab_d50(lab: AnyArray) -> Array:
    """Return gamma-encoded sRGB of CIE Lab under D50 (..., 3), clipped to [0, 1]: a picture shows no more."""
    XYZ = _xyz_of_lab(np.asarray(lab, dtype=np.float64)) * _white("D50")
    return srgb_encode(_mapped(linear_srgb_of_xyz("D50"), XYZ)).clip(0, 1)


def linear_srgb_of_xyz(white: str | Array) -> Array:
    """Return the matrix (3, 3) from XYZ under an illuminant, or a white (3,), to linear light of sRGB's primaries."""
    return _RGB_OF_XYZ @ _adaptation(white, "D65")


def lab_d50_from(lab: AnyArray, illuminant: str) -> Array:
    """Return CIE Lab under D50 of CIE Lab (..., 3) under another illuminant. InputError for one that is unknown."""
    white = _white(illuminant)
    if illuminant == "D50":
        return lab
    return lab_d50_of_xyz(_xyz_of_lab(np.asarray(lab, dtype=np.float64)) * white, white)


def lab_d50_of_xyz(XYZ: Array, white: Array) -> Array:
    """Return CIE Lab under D50 of XYZ (..., 3) seen under another white, XYZ (3,) with Y = 1.

    Source: CIE 15:2004, eq. 8.3 to 8.11.
    """
    relative = _mapped(_adaptation(white, "D50"), XYZ) / _white("D50")
    bright = relative > (24 / 116) ** 3
    f = np.where(bright, np.cbrt(relative), 841 / 108 * relative + 16 / 116)
    x, y, z = np.moveaxis(f, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def ciede2000(a: AnyArray, b: AnyArray) -> Array:
    """Return CIEDE2000 between CIE Lab colours a and b (..., 3), k_L = k_C = k_H = 1 (Sharma et al. 2005)."""
    from skimage.color import deltaE_ciede2000

    return np.asarray(deltaE_ciede2000(a, b))


def contrast(lab: Array) -> float:
    """Return the mean CIEDE2000 between colours (P, 3) in CIE Lab and others, half of the list away."""
    return float(ciede2000(lab, np.roll(lab, len(lab) // 2, axis=0)).mean())


def _xyz_of_lab(lab: Array) -> Array:
    """XYZ (..., 3) over that of the white, of CIE Lab."""
    L, a, b = np.moveaxis(lab, -1, 0)
    y = (L + 16) / 116
    f = np.stack([y + a / 500, y, y - b / 200], axis=-1)
    return np.where(f > 24 / 116, f**3, 108 / 841 * (f - 16 / 116))


def _mapped(matrix: Array, colours: Array) -> Array:
    """A matrix (3, 3) times each colour (..., 3). Not by BLAS, whose threads cost more than so small a product."""
    return np.asarray(np.einsum("ij,...j->...i", matrix, colours))


def _adaptation(source: str | Array, target: str) -> Array:
    """The matrix (3, 3) that takes XYZ under an illuminant, or a white, to what looks alike under another: Bradford."""
    white = _white(source) if isinstance(source, str) else source
    ratio = (_BRADFORD @ _white(target)) / (_BRADFORD @ white)
    return np.linalg.solve(_BRADFORD, ratio[:, None] * _BRADFORD)


def _white(illuminant: str) -> Array:
    """XYZ (3,) of an illuminant, Y = 1."""
    known: Mapping[str, Any] = _WHITES
    if illuminant not in known:
        known = colour_science().CCS_ILLUMINANTS["CIE 1931 2 Degree Standard Observer"]
    if illuminant not in known:
        raise InputError(
            f"illuminant '{illuminant}': unknown; {did_you_mean(illuminant, known)}"
        )
    x, y = known[illuminant]
    return np.array([x / y, 1, (1 - x - y) / y])


def to_lab(rgb: Array) -> Array:
    """Return L in [0, 100], a and b about [-110, 110], (H, W, 3) float32, of RGB in [0, 1], clipped."""
    import cv2

    return np.asarray(cv2.cvtColor(np.clip(rgb, 0, 1).astype(np.float32), cv2.COLOR_RGB2Lab))


def from_lab(lab: Array) -> Array:
    """Return RGB (H, W, 3) float32 in [0, 1], colours outside of sRGB clipped."""
    import cv2

    return np.asarray(
        cv2.cvtColor(np.ascontiguousarray(lab, dtype=np.float32), cv2.COLOR_Lab2RGB)
    ).clip(0, 1)


def luma(rgb: Array) -> Array:
    """Return 0.299 R + 0.587 G + 0.114 B, (H, W) float32; rgb: (H, W, 3) float32. A gray pixel keeps its value."""
    import cv2

    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
