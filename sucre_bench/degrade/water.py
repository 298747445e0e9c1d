"""Water of known parameters, added to dry images: I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 2)."""

from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.machine.files import expanded
from sucre_bench.scene import Water

_PLACE = "degrade.add_water"


def read_water(given: Any, place: str = _PLACE) -> Water:
    """Return a water given as a `Water`, as nine numbers (B, beta, gamma, each RGB), or as the path of a JSON file.

    Raises InputError for a file without these numbers, or for values out of range: B in [0, 1], beta and gamma >= 0.
    """
    parts, encoding = given, None
    if isinstance(given, Water):
        encoding = given.encoding
        parts = [given.veiling_light, given.attenuation, given.backscatter]
    elif isinstance(given, (str, Path)):
        place = str(expanded(given))
        return read_water(_from_file(Path(place)), place)
    elif np.shape(given) == (9,):
        parts = [given[0:3], given[3:6], given[6:9]]
    try:
        numbers = np.array(parts, dtype=np.float64)
    except (TypeError, ValueError):
        numbers = np.empty(0)
    if numbers.shape != (3, 3):
        raise InputError(
            "not a water", place, "give nine numbers, [B, beta, gamma] each RGB, or a JSON file with those three"
        )
    if not (np.isfinite(numbers).all() and (numbers >= 0).all() and (numbers[0] <= 1).all()):
        raise InputError("no water has these values", place, "B is in [0, 1], beta and gamma are at least 0 per metre")
    B, beta, gamma = numbers
    return Water(B, beta, gamma, encoding)


def _from_file(path: Path) -> Water:
    from sucre_bench.results.water_file import read_water as in_file

    remedy = 'write {"B": [r, g, b], "beta": ..., "gamma": ...}'
    try:
        water = in_file(path)
    except FileNotFoundError:
        raise MissingFileError("no such file", path, remedy) from None
    if water is None:
        raise InputError("no B, beta and gamma in it", path, remedy)
    return water


def under_water(image: Array, z: Array, water: Water) -> Array:
    """Return an image (H, W, 3) float32 as it looks through water, of stored intensities, clipped to [0, 1].

    z: (H, W) metres, 0 = unknown. A pixel without distance gets that of the nearest pixel with one; there must be one.
    It would otherwise look as in air, for which no image-only method is made.
    """
    if (z == 0).any():
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(z == 0, return_distances=False, return_indices=True)
        z = z[tuple(nearest)]
    seen = np.empty(image.shape, dtype=np.float32)
    for c in range(3):  # a channel at a time, to save memory: 24 megapixels
        B, beta, gamma = (float(p[c]) for p in (water.veiling_light, water.attenuation, water.backscatter))
        seen[..., c] = (image[..., c] * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z))).clip(0, 1)
    return seen
