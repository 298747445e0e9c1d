"""Global state of a process that a plugin must not change: random states, threads, flags, working directory."""

import contextlib
import hashlib
import io
import logging
import os
import random
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.programs.contract.contract import Finding, breach, doubt


def _torch_state(torch: Any) -> dict[str, object]:
    return {
        "torch's random state": torch.random.get_rng_state().numpy().tobytes(),
        "torch's threads": torch.get_num_threads(),
        "torch's default dtype": torch.get_default_dtype(),
        "torch's gradients": torch.is_grad_enabled(),
        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
        "torch's default device": torch.get_default_device(),
    }


# State of packages, if loaded.
_OF: Mapping[str, Callable[[Any], dict[str, object]]] = {
    "torch": _torch_state,
    "cv2": lambda cv2: {"OpenCV's threads": cv2.getNumThreads(), "OpenCV's optimisation": cv2.useOptimized()},
    "jax": lambda jax: {"JAX's 64-bit flag": jax.config.jax_enable_x64},
    "matplotlib": lambda matplotlib: {"matplotlib's style": sorted(map(str, matplotlib.rcParams.items()))},
    "pandas": lambda pandas: {"pandas' width": pandas.get_option("display.width")},
}


# Environment variables that packages set when they are first imported or run: torch for its compiler, OpenCV for its
# libraries. sucre_bench itself may be the one who imports OpenCV.
_THEIRS = ("TORCHINDUCTOR_", "TRITON_", "LD_LIBRARY_PATH")


def snapshot() -> dict[str, str]:
    """Return the global state: a short hash by name."""
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
        **{f"the file {path.name}": "there" for path in Path().iterdir() if not path.name.startswith((".", "__"))},
    }
    for package, state_of in _OF.items():
        module = sys.modules.get(package)
        if module is not None and getattr(getattr(module, "__spec__", None), "_initializing", False) is False:
            state |= state_of(module)
    return {name: hashlib.blake2b(repr(value).encode(), digest_size=8).hexdigest() for name, value in state.items()}


def changed(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return the names of changed state. Packages loaded in between are ignored; new variables and files count.

    Files are not compared after a change of the working directory.
    """
    other = [name for name in before if after.get(name) != before[name]]
    other += [name for name in after if name not in before and name.startswith(("os.environ", "the file"))]
    moved = "the working directory" in other
    return [name for name in other if not (moved and name.startswith("the file"))]


def _remedy(name: str) -> str:
    if name.startswith("os.environ"):
        return "put it back; where importing a package does it, name the package in requires="
    if name.startswith("the file"):
        return "write into a folder of tempfile's, or not at all"
    if name == "torch's random state":
        return "use a generator of its own, torch.Generator().manual_seed(self.seed)"
    if name in ("numpy's random state", "random's state"):
        return "use a generator of its own, numpy.random.default_rng(self.seed)"
    return "put it back"


@contextlib.contextmanager
def watched() -> Iterator[list[Finding]]:
    """Fill a list, when the block ends, with what it changed or printed, and restore the random states.

    The random states are altered first: a plugin that always sets the same seed would else change nothing.
    """
    kept, found = (np.random.get_state(legacy=True), random.getstate()), list[Finding]()
    torch: Any = sys.modules.get("torch")
    torch_kept = torch.random.get_rng_state() if torch else None
    np.random.random()
    random.random()
    if torch:
        torch.rand(1)
    before = snapshot()
    try:
        # A real file, because programs that a plugin starts may inherit it.
        with io.TextIOWrapper(tempfile.TemporaryFile(), "utf-8") as printed:
            with contextlib.redirect_stdout(printed):
                yield found
            printed.seek(0)
            line = printed.read().strip().partition("\n")[0]
        found += [breach(f"changes {name}; {_remedy(name)}") for name in changed(before, snapshot())]
        if line:
            found.append(doubt(f"prints '{line}'; leave the terminal to whoever runs it, warnings.warn reaches people"))
    finally:
        np.random.set_state(kept[0])
        random.setstate(kept[1])
        if torch_kept is not None:
            torch.random.set_rng_state(torch_kept)
