"""How many processors this process may use, and on which device it computes."""

from __future__ import annotations

import functools
import importlib.util
import os
import sys
from pathlib import Path
from typing import Literal

# Where networks and kernels compute; auto takes a GPU when there is one.
Device = Literal["auto", "cpu", "cuda"]


def usable_cores() -> int:
    """Return how many processors this process may use. A container or a cluster job may allow fewer than there are."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@functools.cache
def may_have_gpu() -> bool:
    """Whether PyTorch may see a GPU. False is certain, and found without importing PyTorch, which takes seconds.

    A PyTorch that was built for the CPU says so in its file of versions. On Linux the driver's devices must be there.
    """
    torch = importlib.util.find_spec("torch")
    if torch is None or torch.origin is None:
        return False
    try:
        versions: dict[str, object] = {}
        exec((Path(torch.origin).parent / "version.py").read_text(encoding="utf-8"), versions)
    except Exception:  # a build that keeps its versions otherwise
        return True
    if not (versions.get("cuda") or versions.get("hip")):
        return False
    return sys.platform != "linux" or any(Path(device).exists() for device in _GPU_DEVICES)


# NVIDIA's driver, the same under Windows' subsystem for Linux, and AMD's.
_GPU_DEVICES = ("/dev/nvidiactl", "/dev/dxg", "/dev/kfd")
