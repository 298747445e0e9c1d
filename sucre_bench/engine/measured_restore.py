"""Restores one view: measures time and memory, and checks that the result keeps the contract."""

import importlib
import time
from typing import Any

from sucre_bench.machine.peak_memory import PeakMemory
from sucre_bench.plugins.call_method import restored, with_truth
from sucre_bench.results.restorations import Measured
from sucre_bench.scene import Scene, View


def make_ready(method: Any) -> None:
    """Let a method import and compile, so that the first view's time is not that of imports.

    One that has a `warm_up()` imports there what its options need. For others all that they require is imported.
    """
    if hasattr(method, "warm_up"):
        method.warm_up()
        return
    for package in method.__plugin__.requires:
        importlib.import_module(package)


def measured_restore(method: Any, scene: Scene, view: View) -> Measured:
    """Restore a view and measure it. PluginError when the result is not what a method must return.

    The view's own planes are decoded before the clock starts: reading the target is not restoring it. Where a method
    says of itself in `info` what it took ("seconds", "peak_mb"), since its work was done elsewhere, that counts.
    """
    _ = view.rgb, view.has_depth
    with PeakMemory() as memory:
        started = time.perf_counter()
        restoration = restored(method, scene, view)
        seconds = time.perf_counter() - started
    info = restoration.info
    took = (float(info.get(name, measured)) for name, measured in (("seconds", seconds), ("peak_mb", memory.peak_mb)))
    return Measured(with_truth(restoration, scene, view), *took)
