"""Restoring one view, measured, and checked against what a method must return."""

from __future__ import annotations

import math
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.colour import srgb_decode, srgb_encode
from sucre_bench.errors import PluginError
from sucre_bench.scene import Array, Encoding, Pixels, Plane, Restoration, Scene, View, Water

__all__ = ["Measured", "measured_restore", "restored", "with_truth"]


@dataclass(frozen=True)
class Measured:
    """A restoration, and what it took: wall seconds, MB of memory above what was held before."""

    restoration: Restoration
    seconds: float
    peak_mb: float


def measured_restore(method: Any, scene: Scene, view: View) -> Measured:
    """Restore a view and measure it. PluginError when the result is not what a method must return.

    The view's own planes are decoded before the clock starts: reading the target is not restoring it. Where a method
    says of itself in `info` what it took ("seconds", "peak_mb"), since its work was done elsewhere, that counts.
    """
    _ = view.rgb, view.has_depth
    with _PeakMemory() as memory:
        started = time.perf_counter()
        restoration = restored(method, scene, view)
        seconds = time.perf_counter() - started
    info = restoration.info
    took = (float(info.get(name, own)) for name, own in (("seconds", seconds), ("peak_mb", memory.peak_mb)))
    return Measured(with_truth(restoration, scene, view), *took)


def with_truth(restoration: Restoration, scene: Scene, view: View) -> Restoration:
    """Return a restoration whose info holds the scene's "true_water" as well, where it is known."""
    if not scene.water:
        return restoration
    return replace(restoration, info={**restoration.info, "true_water": _explaining(scene.water, view.encoding)})


def restored(method: Any, scene: Scene, view: View) -> Restoration:
    """Return a method's restoration, checked: the image in the view's encoding, float32 as the confidence is, the water
    saying what it explains.

    A method that assumes encoded intensities gets those of a linear view, and its image is decoded again. Raises
    PluginError when the result is not what a method must return, and what the method raises.
    """
    converts = method.__plugin__.encoding == "gamma" and view.encoding == "linear"
    given = replace(view, pixels=_Encoded(view.pixels), encoding="gamma") if converts else view
    restoration = method.restore(scene, given)
    if not isinstance(restoration, Restoration):
        raise PluginError(f"the method returned {type(restoration).__name__}; a method returns a Restoration")
    image = np.asarray(restoration.image)
    if image.shape != view.rgb.shape or not np.issubdtype(image.dtype, np.floating):
        raise PluginError(
            f"the method returned an image {image.shape} {image.dtype}; it must be {view.rgb.shape} and floating"
        )
    if not np.isfinite(image).all(axis=-1).any():
        raise PluginError(f"the method gave no pixel of {view.name} a colour; its result is all NaN or infinite")
    water = restoration.water and _explaining(restoration.water, given.encoding)
    info = dict(restoration.info)
    if converts:
        image, info["converted"] = srgb_decode(image), "encoded (sRGB) for the method, its result decoded"
    confidence = restoration.confidence
    return replace(
        restoration,
        image=image.astype(np.float32, copy=False),
        water=water,
        confidence=None if confidence is None else np.asarray(confidence).astype(np.float32, copy=False),
        info=info,
    )


def _explaining(water: Water, encoding: Encoding) -> Water:
    """A water that says which intensities it explains: those of the view, where it did not."""
    return water if water.encoding else replace(water, encoding=encoding)


@dataclass(frozen=True)
class _Encoded:
    """The pixels of a linear view, gamma-encoded."""

    pixels: Pixels

    def load(self, plane: Plane) -> Array | None:
        values = self.pixels.load(plane)
        return values if values is None or plane == "depth" else srgb_encode(values).astype(np.float32)


class _PeakMemory:
    """The highest resident memory in a `with`, in MB above that at its start; GPU memory where torch holds some.

    Linux keeps the high-water mark and lets a process reset its own; elsewhere it is unknown (NaN).
    """

    _STATUS = Path("/proc/self/status")

    def __enter__(self) -> _PeakMemory:
        self.peak_mb = math.nan
        try:
            Path("/proc/self/clear_refs").write_text("5")
            self._before = self._read("VmRSS")
        except OSError:
            self._before = math.nan
        if gpu := self._gpu():
            gpu.reset_peak_memory_stats()
        return self

    def __exit__(self, *_: object) -> None:
        if not math.isnan(self._before):
            self.peak_mb = max(0.0, self._read("VmHWM") - self._before)
        if gpu := self._gpu():
            self.peak_mb = float(np.nansum([self.peak_mb, gpu.max_memory_allocated() / 2**20]))

    def _read(self, name: str) -> float:
        line = next(line for line in self._STATUS.read_text().splitlines() if line.startswith(name))
        return int(line.split()[1]) / 1024

    @staticmethod
    def _gpu() -> Any:
        torch = sys.modules.get("torch")
        return torch.cuda if torch and torch.cuda.is_initialized() else None
