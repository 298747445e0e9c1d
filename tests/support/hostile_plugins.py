"""Plugins that do to their process what plugins must not do; each view another thing, which stands in its name."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench import Arrays, Restoration, Scene, Score, View, dataset, method, metric


class Outside(BaseException):
    """An exception that `except Exception` lets through."""


def _raise(fault: BaseException) -> None:
    raise fault


def _sleep_in_c() -> None:
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})  # as code does that never returns to Python
    ctypes.CDLL(None).sleep(3600)


def _catch_all() -> None:
    while True:
        with contextlib.suppress(BaseException):
            time.sleep(3600)


def _in_a_removed_folder() -> None:
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)


def _later(act: Callable[[], object]) -> None:
    threading.Timer(0.3, act).start()


def _leak() -> None:
    _leaked.extend(os.open(os.devnull, os.O_RDONLY) for _ in range(20_000))


def _break_libraries() -> None:
    json.dumps = np.asarray = np.isnan = os.replace = None  # type: ignore[assignment]
    sys.modules.pop("pandas", None)


_leaked: list[int] = []

ACTS: dict[str, Callable[[], Any]] = {
    "fine": lambda: None,
    "exit": lambda: os._exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "abort": lambda: ctypes.CDLL(None).abort(),
    "outside": lambda: _raise(Outside("away")),
    "generator-exit": lambda: _raise(GeneratorExit()),
    "long": lambda: _raise(ValueError("x" * 1_000_000)),
    "removed-folder": _in_a_removed_folder,
    "leaks": _leak,
    "libraries": _break_libraries,
    "late-segfault": lambda: _later(lambda: ctypes.string_at(0)),
    "no-files": lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (3, 3)),
    "elsewhere": lambda: os.chdir("/"),
    "thread": lambda: threading.Thread(target=time.sleep, args=(3600,)).start(),
    "asleep": lambda: time.sleep(3600),
    "asleep-in-c": _sleep_in_c,
    "deaf": _catch_all,
    "odd-text": lambda: _raise(ValueError("caf\udce9.png is bad")),  # the name of a file in another encoding
    "odd-hint": lambda: {"hints": ["caf\udce9"]},
    "odd-device": lambda: {"device": "caf\udce9"},
}


@dataset()
@dataclass(frozen=True)
class Acts:
    """A view for each act, and a view that is fine before and after each."""

    acts: tuple[str, ...] = ()
    """Names of ACTS."""

    def scenes(self) -> Iterator[Scene]:
        names = ["before.png", *(f"{act}.png" for act in self.acts), "after.png"]
        image = np.random.default_rng(0).random((8, 8, 3), dtype=np.float32)
        yield Scene("stage", [View(name, Arrays(image)) for name in names], frozenset(), data_id="acts")


@method()
@dataclass(frozen=True)
class Actor:
    """Does what the view's name says."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        info = ACTS.get(view.name.removesuffix(".png"), ACTS["fine"])()
        return Restoration(view.rgb * 0.5, info=info or {})


@metric(variants={"only": ""}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Critic:
    """Ends the process for one view."""

    def score(self, restored: Restoration, shown: np.ndarray, view: View, variant: str) -> Iterator[Score]:
        if view.name == "after.png":
            os._exit(7)
        yield Score(0.5)
