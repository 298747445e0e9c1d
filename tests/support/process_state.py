"""State of the whole process that one test could leave to the next: what is set, by name."""

from __future__ import annotations

import locale
import logging
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.machine import terminal

# Variables of the environment that other packages set when they are imported or first used, and pytest's own.
_THEIRS = (
    "PYTEST_",
    "TORCHINDUCTOR_",
    "TRITON_",
    "TF_CPP_",
    "TPU_",
    "TCM_",
    "KMP_",
    "LD_LIBRARY_PATH",
    "MLFLOW_",
    "QT_",
    "GRPC_",
)
_SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGALRM,
    signal.SIGCHLD,
    signal.SIGUSR1,
    signal.SIGUSR2,
)


def _matplotlib(matplotlib: Any) -> dict[str, object]:
    style = dict(dict.items(matplotlib.rcParams))  # past its own items(), which choose a backend
    backend = style.pop("backend")
    return {"matplotlib's style": style, **({"matplotlib's backend": backend} if isinstance(backend, str) else {})}


def _torch(torch: Any) -> dict[str, object]:
    return {
        "torch's threads": torch.get_num_threads(),
        "torch's default dtype": torch.get_default_dtype(),
        "torch's gradients": torch.is_grad_enabled(),
        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
    }


# State of packages that some tests import.
_OF: Mapping[str, Callable[[Any], dict[str, object]]] = {
    "cv2": lambda cv2: {"OpenCV's threads": cv2.getNumThreads()},
    "jax": lambda jax: {"JAX's 64-bit flag": jax.config.jax_enable_x64},
    "matplotlib": _matplotlib,
    "matplotlib.pyplot": lambda pyplot: {"open figures": pyplot.get_fignums()},
    "pandas": lambda pandas: {
        f"pandas' {name}": pandas.get_option(name)
        for name in ("display.width", "display.max_rows", "display.max_columns", "display.precision")
    },
    "torch": _torch,
}


def _plugins(kind: plugins.Kind) -> dict[str, type]:
    return {name: type(plugin) for name, plugin in plugins.discover(kind).items()}


def snapshot() -> dict[str, object]:
    """Return the state by name. Packages that are not imported have none."""
    state: dict[str, object] = {
        "numpy's print options": np.get_printoptions(),
        "numpy's error handling": np.geterr(),
        "the current folder": Path.cwd(),
        "sys.path": list(sys.path),
        "sys.argv": list(sys.argv),
        "sys.excepthook": sys.excepthook,
        "threading.excepthook": threading.excepthook,
        "the recursion limit": sys.getrecursionlimit(),
        "the locale": locale.setlocale(locale.LC_ALL),
        "logging's level": (logging.root.level, logging.root.manager.disable),
        "the timeout of sockets": socket.getdefaulttimeout(),
        "the terminal": (terminal.out.width, terminal.err.width, terminal.out.quiet, terminal.err.quiet),
        "the registry": id(plugins.current()),
        **{f"{kind} plugins": _plugins(kind) for kind in ("dataset", "method", "metric")},
        **{f"the handler of {number.name}": signal.getsignal(number) for number in _SIGNALS},
        **{f"os.environ[{name}]": value for name, value in os.environ.items() if not name.startswith(_THEIRS)},
    }
    for package, state_of in _OF.items():
        if package in sys.modules:
            state |= state_of(sys.modules[package])
    return state


def changed(before: Mapping[str, object], after: Mapping[str, object]) -> list[str]:
    """Return what is other, gone or, of the environment, new: name, before and after."""
    names = [name for name in before if name not in after or after[name] != before[name]]
    names += [name for name in after if name.startswith("os.environ") and name not in before]
    return [f"{name}: {_difference(before.get(name), after.get(name))}" for name in names]


def _difference(before: object, after: object) -> str:
    if isinstance(before, dict) and isinstance(after, dict):
        names = [name for name in {**before, **after} if before.get(name) != after.get(name)]
        return ", ".join(f"{name}: {before.get(name)} -> {after.get(name)}" for name in names)
    return f"{before} -> {after}"
