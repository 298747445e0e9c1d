"""Random seeds: dataset, degradation and method each have their own, and every replicate has new ones.

All methods of one replicate see the same draws of the data, so they stay paired; what a method draws does not depend on
which other methods run. Replicate 0 has the seeds that were given.
"""

import zlib
from typing import Literal

import numpy as np


def seed_of(seed: int, axis: Literal["dataset", "degrade", "method"], replicate: int) -> int:
    """Return the seed that an axis draws with in a replicate, at most 32 bits."""
    if not replicate:
        return seed
    return int(np.random.SeedSequence([seed, zlib.crc32(axis.encode()), replicate]).generate_state(1)[0])
