"""What the tests share: the toy plugins, the command line as a user runs it, and that none leaves a process changed."""

from __future__ import annotations

import functools
import gc
import locale
import logging
import os
import re
import signal
import socket
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from support.browser import Browser

# before numpy and torch: there is a process of tests for each core
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.pop("COLUMNS", None)  # a terminal made while it is set keeps this width
if not re.fullmatch(r"[\w./-]+", tempfile.gettempdir(), re.ASCII):
    # tests write such paths as Hydra's words, unquoted
    os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", "/tmp")

import numpy as np
from support.command_line import Done, registry, run_here, run_program
from support.places import TOYS

from sucre_bench import plugins
from sucre_bench.machine import terminal
from sucre_bench.machine.compute import usable_cores

gc.disable()  # until all tests are collected: what is imported stays

# A shell without job control starts what it puts behind (`.ci/run &`) deaf to Ctrl-C, and all its children are born
# so; the programs that tests interrupt must hear it.
if signal.getsignal(signal.SIGINT) == signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


# The files that take longest, longest first: they are begun first, so that all processes end together. The first four
# need different compiled loops: a process waits while another compiles what both need.
SLOW = (
    "methods/sucre/test_real_dives.py",
    "engine/slurm/test_slurm.py",
    "golden/test_golden.py",
    "programs/contract/test_built_in.py",
    "programs/prepare/test_prepare.py",
    "methods/sucre/test_judge.py",
    "methods/sucre/test_light.py",
    "methods/sucre/test_exact.py",
    "reports/test_mlflow.py",
    "reports/page/test_in_browser.py",
    "engine/test_real_images.py",
    "hostile/test_current_folder.py",
    "methods/sucre/test_footprint.py",
    "programs/verify/test_verify_bundle.py",
    "methods/sucre/test_sucre.py",
    "programs/people/test_in_browser.py",
    "docs/test_site.py",
    "hostile/test_plugins.py",
    "engine/test_sweep.py",
    "hostile/test_refusing_machines.py",
    "programs/test_match_published.py",
    "programs/contract/test_write_plugin.py",
    "engine/test_common_pixels.py",
    "datasets/test_demo.py",
    "engine/test_done_views.py",
    "docs/test_docs.py",
    "docs/test_examples.py",
    "programs/prepare/test_given.py",
    "hostile/test_commands.py",
    "docs/test_tutorial.py",
    "programs/restore/test_restore.py",
    "hostile/test_killed.py",
    "hostile/test_remedies.py",
    "machine/test_terminal.py",
    "hostile/test_results_of_others.py",
    "methods/test_haze_lines.py",
    "reports/page/test_page.py",
)
# Begun last: the file that starts JAX, after which its process can fork no workers, and rooms whose tests need none.
LAST = ("methods/sucre/test_passes.py", "imaging", "metrics", "multiview")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the slow files first, JAX and what may follow it last. A file's tests stay together, in their order."""
    tests = Path(__file__).parent
    rank = {tests / name: place for place, name in enumerate((*SLOW, "", *LAST))}
    items.sort(key=lambda item: rank.get(item.path, rank.get(item.path.parent, len(SLOW))))


def pytest_xdist_auto_num_workers() -> int | None:
    """Two processes of tests more than there are cores: some wait, for a queue, a browser or another process."""
    return None if os.environ.get("PYTEST_XDIST_AUTO_NUM_WORKERS") else usable_cores() + 2


def pytest_collection_finish() -> None:
    """What is imported by now lasts: the search for garbage passes over it."""
    gc.freeze()
    gc.enable()
    gc.set_threshold(10_000, 20, 20)


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
)
_THEIRS += ("QT_", "GRPC_")
_SIGNALS = (
    signal.SIGINT,
    signal.SIGTERM,
    signal.SIGHUP,
    signal.SIGALRM,
    signal.SIGCHLD,
    signal.SIGUSR1,
)

# State of packages that some tests import.
_OF: Mapping[str, Callable[[Any], object]] = {
    "cv2": lambda cv2: cv2.getNumThreads(),
    "jax": lambda jax: jax.config.jax_enable_x64,
    # Past its own items(), which choose a backend.
    "matplotlib": lambda mpl: {
        name: value for name, value in dict.items(mpl.rcParams) if name != "backend"
    },
    "matplotlib.pyplot": lambda pyplot: pyplot.get_fignums(),
    "pandas": lambda pandas: [
        pandas.get_option(f"display.{name}") for name in ("width", "max_rows", "precision")
    ],
    "torch": lambda torch: (
        torch.get_num_threads(),
        torch.get_default_dtype(),
        torch.is_grad_enabled(),
    ),
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
        "the terminal": (
            terminal.out.width,
            terminal.err.width,
            terminal.out.quiet,
            terminal.err.quiet,
        ),
        "the registry": id(plugins.current()),
        **{f"{kind} plugins": {*plugins.discover(kind)} for kind in plugins.KINDS},
        **{f"the handler of {number.name}": signal.getsignal(number) for number in _SIGNALS},
        **{
            f"os.environ[{name}]": value
            for name, value in os.environ.items()
            if not name.startswith(_THEIRS)
        },
        **{
            f"the state of {name}": state(sys.modules[name])
            for name, state in _OF.items()
            if name in sys.modules
        },
    }


def changed(before: Mapping[str, object], after: Mapping[str, object]) -> list[str]:
    """Return what is other, gone or, of the environment, new: name, before and after."""
    names = [name for name in before if name not in after or after[name] != before[name]]
    names += [name for name in after if name.startswith("os.environ") and name not in before]
    return [f"{name}: {before.get(name)} -> {after.get(name)}" for name in names]


_before: dict[str, object] = {}


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> Iterator[None]:
    """Note the state of the process before the test's fixtures, those of its module among them."""
    _before.clear()
    _before.update(snapshot())
    return (yield)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_teardown(item: pytest.Item) -> Iterator[None]:
    """Fail a test that leaves the process other than it was: the next test would depend on the order."""
    answer = yield
    if left := changed(_before, snapshot()):
        pytest.fail("leaves the process changed\n" + "\n".join(left), pytrace=False)
    return answer


@pytest.fixture(autouse=True)
def same_draws(request: pytest.FixtureRequest) -> Iterator[None]:
    """A generator of random numbers that a module's tests share draws the same in each of them, in any order."""
    shared = [
        value
        for value in vars(request.module).values()
        if isinstance(value, np.random.Generator)
    ]
    states = [generator.bit_generator.state for generator in shared]
    yield
    for generator, state in zip(shared, states, strict=True):
        generator.bit_generator.state = state


@pytest.fixture(autouse=True)
def own_registry() -> Iterator[None]:
    """Plugins that the test loads are forgotten after it."""
    with plugins.using(registry()):
        yield


@pytest.fixture
def toys(own_registry: None) -> Iterator[str]:
    """The toy plugins, loaded in this process; the path of their file for other processes."""
    with plugins.using(registry(TOYS)):
        yield str(TOYS)


@pytest.fixture(scope="session")
def small_demo(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The words of a small demo scene, made once for all tests."""
    from sucre_bench.datasets.demo import Demo

    size = {"width": 96, "height": 72, "views": 4}
    own = tmp_path_factory.getbasetemp()
    root = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "demo"
    Demo(root=root, **size).folder()
    return [
        "dataset=demo",
        f"dataset.root={root}",
        *(f"dataset.{name}={value}" for name, value in size.items()),
    ]


@pytest.fixture
def bench(tmp_path: Path) -> Callable[..., Done]:
    """Run `sucre-bench ARGUMENTS` in an empty folder, with plain output, in this process."""
    return functools.partial(run_here, tmp_path)


@pytest.fixture
def program(tmp_path: Path) -> Callable[..., Done]:
    """Run `sucre-bench ARGUMENTS` in an empty folder as a process of its own; keywords are its environment."""
    return functools.partial(run_program, tmp_path)


@pytest.fixture(scope="module")
def chrome(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    """A browser for the tests of a file."""
    from support.browser import Browser, chromium

    browser = Browser(chromium(), tmp_path_factory.mktemp("profile"))
    yield browser
    browser.close()
