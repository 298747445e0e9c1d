"""What is global to a process and no plugin's to change: random states, threads, flags, the folder it runs in."""

from __future__ import annotations

import contextlib
import hashlib
import logging
import os
import random
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

__all__ = ["changed", "snapshot", "watched"]


def _torch_state(torch: Any) -> dict[str, object]:
    return {
        "torch's random state": torch.random.get_rng_state().numpy().tobytes(),
        "torch's threads": torch.get_num_threads(),
        "torch's default dtype": torch.get_default_dtype(),
        "torch's gradients": torch.is_grad_enabled(),
        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
        "torch's default device": torch.get_default_device(),
    }


# Of packages that are loaded.
_OF: Mapping[str, Callable[[Any], dict[str, object]]] = {
    "torch": _torch_state,
    "cv2": lambda cv2: {"OpenCV's threads": cv2.getNumThreads(), "OpenCV's optimisation": cv2.useOptimized()},
    "jax": lambda jax: {"JAX's 64-bit flag": jax.config.jax_enable_x64},
    "matplotlib": lambda matplotlib: {"matplotlib's style": sorted(map(str, matplotlib.rcParams.items()))},
    "pandas": lambda pandas: {"pandas' width": pandas.get_option("display.width")},
}


# Variables that packages set for themselves when they first run: torch for its compiler.
_THEIRS = ("TORCHINDUCTOR_", "TRITON_")


def snapshot() -> dict[str, str]:
    """Return everything global by name, each as a short hash."""
    state: dict[str, object] = {
        "numpy's random state": [np.asarray(part).tobytes() for part in np.random.get_state(legacy=True)],
        "random's state": random.getstate(),
        "numpy's error handling": sorted(np.geterr().items()),
        "numpy's print options": sorted(map(str, np.get_printoptions().items())),
        "the working directory": Path.cwd(),
        "the search path": tuple(sys.path),
        "logging's level": logging.getLogger().level,
        "logging's handlers": len(logging.getLogger().handlers),
        "the recursion limit": sys.getrecursionlimit(),
        **{f"os.environ[{name}]": value for name, value in os.environ.items() if not name.startswith(_THEIRS)},
    }
    for package, state_of in _OF.items():
        module = sys.modules.get(package)
        if module is not None and getattr(getattr(module, "__spec__", None), "_initializing", False) is False:
            state |= state_of(module)
    return {name: hashlib.blake2b(repr(value).encode(), digest_size=8).hexdigest() for name, value in state.items()}


def changed(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return what is not as it was; of a package loaded in between nothing is known, but variables may be new."""
    other = [name for name in before if after.get(name) != before[name]]
    return other + [name for name in after if name not in before and name.startswith("os.environ")]


@contextlib.contextmanager
def watched() -> Iterator[list[str]]:
    """Fill a list, when the `with` ends, with what was changed in it; what is random is as before afterwards.

    The random states are stirred first: who seeds them alike each time would change nothing the second time.
    """
    kept, found = (np.random.get_state(legacy=True), random.getstate()), list[str]()
    torch: Any = sys.modules.get("torch")
    torch_kept = torch.random.get_rng_state() if torch else None
    np.random.random()
    random.random()
    if torch:
        torch.rand(1)
    before = snapshot()
    try:
        yield found
        found += changed(before, snapshot())
    finally:
        np.random.set_state(kept[0])
        random.setstate(kept[1])
        if torch_kept is not None:
            torch.random.set_rng_state(torch_kept)
