"""What this process computes with: cores, the device, loops compiled by numba, and the peak of memory it takes."""

from __future__ import annotations

import functools
import math
import os
import sys
import warnings
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Literal

from sucre_bench.machine import progress

# Where networks and kernels compute; auto takes a GPU when there is one.
Device = Literal["auto", "cpu", "cuda"]


def usable_cores() -> int:
    """Return how many processors this process may use. A container or a cluster job may allow fewer than there are."""
    return (
        len(os.sched_getaffinity(0))
        if hasattr(os, "sched_getaffinity")
        else os.cpu_count() or 1
    )


@functools.cache
def compiled(loop: Callable[..., Any]) -> Callable[..., Any]:
    """Return a module's function compiled by numba, imported here and not before; see `compile_loop`."""
    return compile_loop(loop)


def compile_loop(loop: Callable[..., Any], **options: Any) -> Callable[..., Any]:
    """Return a function compiled by numba; the result is cached on disk if there is a place. options: of numba.njit.

    The first compilation of a process is announced in one line. Code that is read from the disk is not compiled.
    The function uses no threads: its callers are threads, and numba's default threading layer allows one caller only.
    """
    with warnings.catch_warnings(record=True) as faults:
        import numba

        from sucre_bench.machine.compiled_code import CheckedCache
    for fault in faults:  # an environment variable that is no number, with a traceback
        _tell(f"{str(fault.message).splitlines()[0].rstrip('.')}; correct it, or unset it")
    _announce_compiling()
    made: Callable[..., Any] = numba.njit(nogil=True, error_model="numpy", **options)(loop)
    with suppress(RuntimeError):
        # neither the folder of the package nor the user's cache can be written
        vars(made)["_cache"] = CheckedCache(loop)
    return made


def start_compiler() -> None:
    """Start numba, for the processes that are forked from this one: it would take each of them half a second."""
    compiled(_nothing)()


def _nothing() -> None:
    pass


def _tell(text: str) -> None:
    if progress.is_watched():
        progress.say(text)
    else:  # a script, a notebook, or a thread
        print(text, file=sys.stderr)


@functools.cache
def _announce_compiling() -> None:
    """Let numba report when it compiles for the first time."""
    from numba.core import event

    class FirstCompilation(event.Listener):
        is_said = False

        def on_start(self, event: object) -> None:
            if self.is_said:
                return
            self.is_said = True
            _tell(
                "compiling loops that were not needed before; each once after an installation or update"
            )

        def on_end(self, event: object) -> None:
            pass

    event.register("numba:compile", FirstCompilation())


class PeakMemory:
    """Measures a block's peak resident memory, in MB above that at its start, plus GPU memory if torch uses some.

    Linux records the peak and lets a process reset its own. On other systems the value is NaN.
    """

    def __enter__(self) -> PeakMemory:
        self.peak_mb = self._before = math.nan
        try:
            Path("/proc/self/clear_refs").write_text("5")
            self._before = self._read("VmRSS")
        except OSError:
            pass
        if gpu := self._gpu():
            gpu.reset_peak_memory_stats()
        return self

    def __exit__(self, *_: object) -> None:
        if not math.isnan(self._before):
            self.peak_mb = max(0.0, self._read("VmHWM") - self._before)
        if gpu := self._gpu():
            gpu_mb = gpu.max_memory_allocated() / 2**20
            self.peak_mb = gpu_mb if math.isnan(self.peak_mb) else self.peak_mb + gpu_mb

    @staticmethod
    def _read(name: str) -> float:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024

    @staticmethod
    def _gpu() -> Any:
        torch = sys.modules.get("torch")
        return torch.cuda if torch and torch.cuda.is_initialized() else None
