"""Pixels that a run decodes once: its processes, methods and targets map them from a store."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.loading.view_files import Files
from sucre_bench.machine import cache
from sucre_bench.machine.compute import compiled
from sucre_bench.machine.provenance import engine_hash
from sucre_bench.scene import Plane, Scene

_FULL = np.float32(255)


@dataclass(frozen=True, eq=False)
class SharedPixels:
    """Decoded files, which a store holds while one is in use (`machine.cache.storing`).

    files: what is decoded; key: of the view in the store, the same for the same data and code. Images whose values are
    the levels of 8 bits are stored as these, a quarter of the size; what `load` returns is equal to the last bit.
    """

    files: Files
    key: str

    @property
    def is_jpeg(self) -> bool:
        """Whether the image is a JPEG file."""
        return self.files.is_jpeg

    def load(self, plane: Plane) -> Array | None:
        """Return a plane; of depth maps, the file's mapped values. Raises InputError for a file that is unreadable."""
        store = cache.current()
        if store is None or not self._has(plane):
            return self.files.load(plane)
        values = store.get(f"{self.key} {plane}", lambda: self._decoded(plane))
        return values.astype(np.float32) / np.iinfo(np.uint8).max if values.dtype == np.uint8 else values

    def levels(self) -> npt.NDArray[np.uint8] | None:
        """Return the image (H, W, 3) as mapped 8-bit levels; None without a store, or if it has other values."""
        store = cache.current()
        if store is None:
            return None
        values = store.get(f"{self.key} rgb", lambda: self._decoded("rgb"))
        return values if values.dtype == np.uint8 else None

    def _has(self, plane: Plane) -> bool:
        return plane == "rgb" or getattr(self.files, plane) is not None

    def _decoded(self, plane: Plane) -> npt.NDArray[Any]:
        values = self.files.load(plane)
        assert values is not None
        return values if plane == "depth" else _compact(values)


def with_shared_pixels(scene: Scene) -> Scene:
    """Return a scene whose files are decoded once a run. One without a data_id cannot be known again, and stays."""
    if not scene.data_id:
        return scene
    key = f"{engine_hash()} {scene.data_id}"
    views = [
        replace(view, pixels=SharedPixels(view.pixels, f"{key} {view.name}"))
        if isinstance(view.pixels, Files)
        else view
        for view in scene.views
    ]
    return replace(scene, views=views)


def _compact(image: Array) -> npt.NDArray[Any]:
    """An image as levels of 8 bits, if these give back every value exactly; else as it is."""
    levels = np.empty(image.shape, dtype=np.uint8)
    is_exact = compiled(_to_levels)(np.ascontiguousarray(image).reshape(-1), levels.reshape(-1), _FULL)
    return levels if is_exact else image


def _to_levels(values: Array, levels: npt.NDArray[np.uint8], full: np.float32) -> bool:
    half, exact = np.float32(0.5), True
    for i in range(len(values)):
        value = values[i]
        level = np.uint8(value * full + half) if value >= 0 and value <= 1 else np.uint8(0)
        levels[i] = level
        exact &= np.float32(level) / full == value
    return exact
