"""Plugins that tests run: small, quick, some faulty on purpose, and some that harm their process as none may."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import json
import multiprocessing
import os
import signal
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench import (
    Arrays,
    Camera,
    NotApplicableError,
    Restoration,
    RestoredPair,
    Scene,
    Score,
    View,
    Water,
    dataset,
    method,
    metric,
)
from sucre_bench.errors import DiskFullError


@dataset()
@dataclass(frozen=True)
class Toy:
    """Noise seen through a known filter, with its reference."""

    views: int = 3
    """How many views."""
    tag: str = ""
    """Part of the data's identity: data of another tag are other data."""
    apart: bool = False
    """Whether the views look at places kilometres apart."""

    def scenes(self) -> Iterator[Scene]:
        rng = np.random.default_rng(0)
        views = []
        for number in range(self.views):
            reference = rng.random((40, 60, 3), dtype=np.float32)
            pixels = Arrays(
                reference * np.float32([0.3, 0.8, 0.9]), np.full((40, 60), 2.0), reference
            )
            pose = np.eye(4)
            pose[0, 3] = 1000 * number * self.apart
            views.append(
                View(f"v{number}.png", pixels, Camera(np.diag([50.0, 50, 1]), 60, 40), pose)
            )
        water = Water(np.full(3, 0.1), np.full(3, 0.2), np.full(3, 0.3))
        has = frozenset({"depth", "poses", "reference", "truth"})
        yield Scene("toy", views, has, water, data_id=f"toy{self.views}{self.tag}")


def _flat(level: float, name: str = "a.png") -> View:
    return View(name, Arrays(np.full((8, 8, 3), level, np.float32)))


@dataset()
@dataclass(frozen=True)
class TwoScenes:
    """Two scenes whose views have the same names."""

    def scenes(self) -> Iterator[Scene]:
        for name, level in (("left", 0.2), ("right", 0.8)):
            yield Scene(name, [_flat(level)], frozenset(), data_id=name)


@dataset()
@dataclass(frozen=True)
class Namesakes:
    """Two scenes of one name."""

    def scenes(self) -> Iterator[Scene]:
        for level in (0.2, 0.8):
            yield Scene("one", [_flat(level)], frozenset())


@dataset()
@dataclass(frozen=True)
class Twins:
    """Two views of one name."""

    def scenes(self) -> Iterator[Scene]:
        yield Scene("twins", [_flat(0.0)] * 2, frozenset())


@method()
@dataclass(frozen=True)
class Gain:
    """Multiply by a factor, noting each call in a file."""

    gain: float = 1.0
    """The factor."""
    mode: Literal["plain", "fancy"] = "plain"
    """A word."""
    log: Path | None = None
    """A file that gets a line a call."""
    pause: float = 0.0
    """Seconds a call takes at least."""
    stays_at: str = ""
    """A view that the first call does not come back from: whoever runs it is stopped there."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        if self.log:
            with self.log.open("a") as file:
                file.write(f"{view.name}\n")
            if (
                view.name == self.stays_at
                and self.log.read_text().split().count(view.name) == 1
            ):
                time.sleep(3600)
        time.sleep(self.pause)
        return Restoration(view.rgb * self.gain)


@method(name="gain2")
@dataclass(frozen=True)
class AlsoGain(Gain):
    """The same under another name."""


@method(needs={"charts"})
@dataclass(frozen=True)
class NeedsCharts:
    """Needs what the toy scene lacks."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        raise AssertionError("must not be called")


@method(reads=["table"])
@dataclass(frozen=True)
class Tabulated:
    """Multiplies by a number in a file; has nothing to say about one view; its work was done elsewhere."""

    table: Path
    """A text file with a number, or a folder with such a file "gain"."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        if view.name == "v2.png":
            raise NotApplicableError(f"{view.name}: not in the table; add it")
        file = self.table / "gain" if self.table.is_dir() else self.table
        info = {"seconds": 12.5, "peak_mb": float("nan"), "deviation": [1.0, float("nan")]}
        unknown = np.full(3, np.nan)
        return Restoration(
            view.rgb * float(file.read_text()),
            Water(np.full(3, 0.2), unknown, unknown),
            info=info,
        )


@method(encoding="gamma")
@dataclass(frozen=True)
class Halved:
    """Halves encoded intensities."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        assert view.encoding == "gamma"
        return Restoration(view.rgb * 0.5)


@method()
@dataclass(frozen=True)
class Faulty:
    """Fails on one view, in a way of one's choice."""

    fault: Literal["raise", "shape", "nan", "none", "mutate", "exit", "die", "full"] = "raise"
    """What it does."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        if view.name != "v1.png":
            return Restoration(view.rgb * 1.0)
        match self.fault:
            case "shape":
                return Restoration(view.rgb[::2])
            case "nan":
                return Restoration(np.full_like(view.rgb, np.nan))
            case "none":
                return None
            case "mutate":
                view.rgb[:] = 0
            case "exit":
                sys.exit(0)
            case "full":
                raise DiskFullError("the disk is full", "/tmp")
            case "die":
                os.kill(os.getpid(), signal.SIGKILL)
        raise ValueError("boom\nover two lines")


@metric(
    variants={"plain": "the red channel's mean", "double": "twice that"},
    unit="",
    better="higher",
    range=(0, 9),
)
@dataclass(frozen=True)
class Redness:
    """Mean red of the shown picture."""

    factor: float = 1.0
    """What it is multiplied by."""

    def score(
        self, restored: Restoration, shown: np.ndarray, view: View, variant: str
    ) -> Iterator[Score]:
        yield Score(
            float(np.nanmean(shown[..., 0])) * (2 if variant == "double" else 1) * self.factor,
            n_pixels=shown[..., 0].size,
        )


@metric(variants={"only": ""}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Undefined:
    """A metric that has no value here."""

    def score(
        self, restored: Restoration, shown: np.ndarray, view: View, variant: str
    ) -> Iterator[Score]:
        yield Score(float("nan"))


@metric(variants={"only": ""}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Painter:
    """A metric that writes into the picture it is shown."""

    def score(
        self, restored: Restoration, shown: np.ndarray, view: View, variant: str
    ) -> Iterator[Score]:
        shown[:] = 0
        yield Score(0.0)


@method()
@dataclass(frozen=True)
class LeftHalf(Gain):
    """Gives a colour to some columns of the image only, those of its left half."""

    start: float = 0.0
    """Where they start, as a share of the width."""
    stop: float = 0.5
    """Where they end."""
    rows: float = 1.0
    """Which share of the rows has a colour."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        image = np.array(super().restore(scene, view).image)
        height, width, _ = image.shape
        image[round(self.rows * height) :] = np.nan
        image[:, : round(self.start * width)] = image[:, round(self.stop * width) :] = np.nan
        return Restoration(image)


@method()
@dataclass(frozen=True)
class RightHalf(LeftHalf):
    """The same of its right half."""

    start: float = 0.5
    stop: float = 1.0


@method()
@dataclass(frozen=True)
class Middle(LeftHalf):
    """The same of its middle."""

    start: float = 0.25
    stop: float = 0.75


@metric(
    variants={"shown": "of the pictures", "computed": "of what was computed"},
    needs={"restored_views", "depth", "poses"},
    unit="",
    better="lower",
    range=(0, 9),
    default=["shown"],
)
@dataclass(frozen=True)
class Apart:
    """How far the mean colours of two views' common points are from each other; some pairs are too much for it."""

    fails: bool = False
    """Whether it fails."""

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        if self.fails:
            raise RuntimeError("no score of a pair")
        here, there = (
            (v.shown if variant == "shown" else v.image) for v in (pair.here, pair.there)
        )
        if here is None or there is None:
            raise NotApplicableError("not stored")
        one, other = pair.means(here, there)
        yield Score(float(np.nanmean(np.abs(one - other))), n_pixels=len(one))


class Outside(BaseException):
    """An exception that `except Exception` lets through."""


def _raise(fault: BaseException) -> None:
    raise fault


def _sleep_in_c() -> None:
    # as code does that never returns to Python
    signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGALRM})
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


def _leave_child() -> None:
    multiprocessing.get_context("fork").Process(target=time.sleep, args=(60,)).start()
    os.kill(os.getpid(), signal.SIGKILL)


def _leave_daemon() -> None:
    """Leave a process outside of the group that libraries have forked, with all that is open."""
    if ctypes.CDLL(None).fork() == 0:
        os.setsid()
        time.sleep(20)
        os._exit(0)
    os._exit(3)


def _write_into_pipes() -> None:
    for descriptor in range(3, 64):
        with contextlib.suppress(OSError):
            if stat.S_ISSOCK(os.fstat(descriptor).st_mode):
                os.write(descriptor, b"junk")


def _reload_rows() -> None:
    for name in [name for name in sys.modules if name.startswith("sucre_bench.results")]:
        importlib.reload(sys.modules[name])


_leaked: list[int] = []
ACTS: dict[str, Callable[[], Any]] = {
    "fine": lambda: None,
    "exit": lambda: os._exit(0),
    "segfault": lambda: ctypes.string_at(0),
    "abort": lambda: ctypes.CDLL(None).abort(),
    "child": _leave_child,
    "daemon": _leave_daemon,
    "junk": _write_into_pipes,
    "reload": _reload_rows,
    "outside": lambda: _raise(Outside("away")),
    "generator-exit": lambda: _raise(GeneratorExit()),
    "long": lambda: _raise(ValueError("x" * 1_000_000)),
    "removed-folder": _in_a_removed_folder,
    "leaks": _leak,
    "libraries": _break_libraries,
    "late-segfault": lambda: _later(lambda: ctypes.string_at(0)),
    "elsewhere": lambda: os.chdir("/"),
    "thread": lambda: threading.Thread(target=time.sleep, args=(3600,)).start(),
    "asleep": lambda: time.sleep(3600),
    "asleep-in-c": _sleep_in_c,
    "deaf": _catch_all,
    # the name of a file in another encoding
    "odd-text": lambda: _raise(ValueError("caf\udce9.png is bad")),
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
        yield Scene(
            "stage", [View(name, Arrays(image)) for name in names], frozenset(), data_id="acts"
        )


@method()
@dataclass(frozen=True)
class Actor:
    """Does what the view's name says."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        info = ACTS.get(view.name.removesuffix(".png"), ACTS["fine"])()
        return Restoration(view.rgb * 0.5, info=info or {})


@dataset()
@dataclass(frozen=True)
class Stages:
    """Two scenes of four views."""

    def scenes(self) -> Iterator[Scene]:
        draw = np.random.default_rng(0)
        for scene in ("left", "right"):
            views = [
                View(f"{scene}{k}.png", Arrays(draw.random((8, 8, 3), dtype=np.float32)))
                for k in range(4)
            ]
            yield Scene(scene, views, frozenset(), data_id=scene)


@method()
@dataclass(frozen=True)
class Named:
    """Says which process restored a view, as its device. Adds noise, of the seed that the method is given."""

    sees_whole_scene: bool = False
    """Whether it says that views of a scene belong together."""
    fits_once: bool = False
    """Whether one process can make it, and no other beside it."""
    seed: int = 0
    """Of its noise."""

    def warm_up(self) -> None:
        if self.fits_once:
            Path("taken").touch(exist_ok=False)

    def restore(self, scene: Scene, view: View) -> Restoration:
        time.sleep(0.3)
        noise = np.random.default_rng(self.seed).random(view.rgb.shape, dtype=np.float32)
        return Restoration(view.rgb * 0.5 + 0.1 * noise, info={"device": str(os.getpid())})


@dataset()
@dataclass(frozen=True)
class Called:
    """A view of this name, or a scene."""

    view: str = "a.png"
    """Its name."""
    scene: str = "stage"
    """Its scene's name."""

    def scenes(self) -> Iterator[Scene]:
        yield Scene(self.scene, [_flat(0.5, self.view)], frozenset())


@metric(variants={"only": ""}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Twice:
    """Gives a region two scores."""

    region: str = "image"
    """The region."""

    def score(
        self, restored: Restoration, shown: np.ndarray, view: View, variant: str
    ) -> Iterator[Score]:
        yield Score(0.1, region=self.region)
        yield Score(0.9, region=self.region)


@metric(variants={"only": ""}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Critic:
    """Ends the process for one view."""

    def score(
        self, restored: Restoration, shown: np.ndarray, view: View, variant: str
    ) -> Iterator[Score]:
        if view.name == "after.png":
            os._exit(7)
        yield Score(0.5)
