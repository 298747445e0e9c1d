"""The most pixels that a picture may have. Sizes are read from headers, so that a wrong or hostile file of a few bytes
does not fill the memory.
"""

import os
from collections.abc import Sequence
from math import prod

from sucre_bench.errors import InputError

VARIABLE = "SUCRE_BENCH_MAX_MEGAPIXELS"
_MEGAPIXELS = 250.0  # two of the largest cameras' pictures
_CHANNELS = 4


def most_pixels() -> int:
    """Return the limit: that of the environment, or 250 megapixels. Raises InputError if it is no number above 0."""
    text = os.environ.get(VARIABLE, "")
    try:
        limit = float(text or _MEGAPIXELS)
    except ValueError:
        limit = 0
    if not limit > 0:
        raise InputError(f"{VARIABLE}: '{text}' is no number above 0; give megapixels, for example 1000")
    return int(min(limit, 1e9) * 1e6)


def check_pixels(place: object, size: tuple[int, int]) -> None:
    """Raise InputError if a picture of a size (width, height) has too many pixels."""
    if size[0] * size[1] > most_pixels():
        raise _too_large(place, f"{size[0]}x{size[1]}", size[0] * size[1])


def check_array(place: object, shape: Sequence[int]) -> None:
    """Raise InputError if an array has more values than four channels of the largest picture."""
    if prod(shape) > _CHANNELS * most_pixels():
        raise _too_large(place, "x".join(map(str, shape)), prod(shape) // _CHANNELS)


def _too_large(place: object, size: str, pixels: int) -> InputError:
    needed = -(-pixels // 1_000_000)
    return InputError(
        f"is {size}, more than {most_pixels() / 1e6:g} megapixels",
        place,
        f"if that is right, set {VARIABLE}={needed} before the command",
    )
