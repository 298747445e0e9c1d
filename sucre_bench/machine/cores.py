"""How many processors this process may use, and on which device it computes."""

import os
from typing import Literal

# Where networks and kernels compute; auto takes a GPU when there is one.
Device = Literal["auto", "cpu", "cuda"]


def usable_cores() -> int:
    """Return how many processors this process may use. A container or a cluster job may allow fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
