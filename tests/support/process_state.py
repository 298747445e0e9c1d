"""State of the whole process that one test could leave to the next: what is set, by name."""

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
_THEIRS = ("PYTEST_", "TORCHINDUCTOR_", "TRITON_", "TF_CPP_", "TPU_", "TCM_", "KMP_", "LD_LIBRARY_PATH", "MLFLOW_")
_THEIRS += ("QT_", "GRPC_")
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGALRM, signal.SIGCHLD, signal.SIGUSR1)

# State of packages that some tests import.
_OF: Mapping[str, Callable[[Any], object]] = {
    "cv2": lambda cv2: cv2.getNumThreads(),
    "jax": lambda jax: jax.config.jax_enable_x64,
    # Past its own items(), which choose a backend.
    "matplotlib": lambda mpl: {name: value for name, value in dict.items(mpl.rcParams) if name != "backend"},
    "matplotlib.pyplot": lambda pyplot: pyplot.get_fignums(),
    "pandas": lambda pandas: [pandas.get_option(f"display.{name}") for name in ("width", "max_rows", "precision")],
    "torch": lambda torch: (torch.get_num_threads(), torch.get_default_dtype(), torch.is_grad_enabled()),
}


def snapshot() -> dict[str, object]:
    """Return the state by name. Packages that are not imported have none."""
    return {
        "numpy's print options and error handling": (np.get_printoptions(), np.geterr()),
        "the current folder": Path.cwd(),
        "sys.path": list(sys.path),
        "sys.argv": list(sys.argv),
        "the hooks for exceptions": (sys.excepthook, threading.excepthook),
        "the recursion limit": sys.getrecursionlimit(),
        "the locale": locale.setlocale(locale.LC_ALL),
        "logging's level": (logging.root.level, logging.root.manager.disable),
        "the timeout of sockets": socket.getdefaulttimeout(),
        "the terminal": (terminal.out.width, terminal.err.width, terminal.out.quiet, terminal.err.quiet),
        "the registry": id(plugins.current()),
        **{f"{kind} plugins": {*plugins.discover(kind)} for kind in plugins.KINDS},
        **{f"the handler of {number.name}": signal.getsignal(number) for number in _SIGNALS},
        **{f"os.environ[{name}]": value for name, value in os.environ.items() if not name.startswith(_THEIRS)},
        **{f"the state of {name}": state(sys.modules[name]) for name, state in _OF.items() if name in sys.modules},
    }


def changed(before: Mapping[str, object], after: Mapping[str, object]) -> list[str]:
    """Return what is other, gone or, of the environment, new: name, before and after."""
    names = [name for name in before if name not in after or after[name] != before[name]]
    names += [name for name in after if name.startswith("os.environ") and name not in before]
    return [f"{name}: {before.get(name)} -> {after.get(name)}" for name in names]
