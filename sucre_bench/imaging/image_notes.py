"""Notes on images that can be read, but perhaps not as their owner means them: one line for each folder."""

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.machine.progress import say

_FEW_BITS = 12


def note_few_bits(path: Path, values: npt.NDArray[Any]) -> None:
    """Say that values of 16 bits use few of them: cameras of 10 or 12 bits often write them unscaled."""
    if values.dtype != np.uint16:
        return
    largest = int(values.max(initial=0))
    if 0 < largest < 2**_FEW_BITS:
        fault = f"no value of {path.name} is above {largest}, of 65535, so it is read as dark"
        _say_once(
            path.parent, "bits", f"{fault}; if the camera has {_FEW_BITS} bits or fewer, scale its values to 16 bits"
        )


def note_alpha(place: str, alpha: npt.NDArray[Any]) -> None:
    """Say that pixels of a photograph are transparent. alpha: (H, W) of any unsigned type."""
    if n_transparent := int((alpha < np.iinfo(alpha.dtype).max).sum()):
        path = Path(place)
        fault = f"{n_transparent} pixels of {path.name} are transparent, and read with the colours stored there"
        _say_once(path.parent, "alpha", f"{fault}; save it without transparency if these are not right")


_said: set[tuple[Path, str]] = set()


def _say_once(folder: Path, about: str, text: str) -> None:
    if (folder, about) not in _said:
        _said.add((folder, about))
        say(f"{folder}: {text}")
