"""Depth maps of all photos: plane sweep, consistency between photos, small holes filled, full size, files."""

import functools
import io
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Protocol

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import scaled_camera
from sucre_bench.imaging.image_files import decode, write_png
from sucre_bench.machine.cores import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.programs.prepare.fill_depth_holes import without_small_holes
from sucre_bench.programs.prepare.options import Surface
from sucre_bench.programs.prepare.plane_sweep import agreeing, planes_of, sweep
from sucre_bench.programs.prepare.registered_photos import Shot, neighbours
from sucre_bench.programs.prepare.relief import Relief

_MOST_DENSE = 500  # photos: about an hour of plane sweeps on two cores
_SOURCES = 4
_FEWEST_POINTS = 6  # sparse points of a photo that a sweep needs
_SMOOTH = 0.01  # a larger relative difference between neighbours is a border
_MOST_MILLIMETRES = 65_500
_NEAR_M = 0.5  # metres; nearer scenes need finer steps than a millimetre


def is_dense(surface: Surface, photos: int) -> bool:
    """Whether depth maps come from plane sweeps; else from a relief of the sparse points. photos: placed ones."""
    return surface == "dense" or (surface == "auto" and photos <= _MOST_DENSE)


class DepthMaps(Protocol):
    """A source of depth maps. surface: what they are made from, for people."""

    surface: str

    def depth(self, shot: Shot) -> Array:
        """Return planar depth (H, W) float32 at the shot's size, in the model's unit, 0 = unknown."""
        ...


class Sparse:
    """Rays cast at a surface through the sparse points. masks: folder of masks (may be empty)."""

    surface = "relief of the sparse points"

    def __init__(self, relief: Relief, masks: Path) -> None:
        self._relief, self._masks = relief, masks

    def depth(self, shot: Shot) -> Array:
        return _masked(self._relief.depth(shot), shot, self._masks)


class Dense:
    """Plane sweeps at reduced size, stored in a folder. longest: longest side of the swept images, in pixels."""

    surface = "plane sweep, confirmed by other photos"

    def __init__(self, shots: Sequence[Shot], images: Path, masks: Path, folder: Path, longest: int) -> None:
        self._images, self._masks, self._folder = images, masks, folder
        self._shots = [_shrunk(shot, longest) for shot in shots]
        self._near = [
            [j for j in near if len(shots[j].points) >= 1] if len(shot.points) >= _FEWEST_POINTS else []
            for shot, near in zip(shots, neighbours(shots, _SOURCES), strict=True)
        ]
        self._place = {shot.name: i for i, shot in enumerate(shots)}
        self._gray = functools.lru_cache(32)(self._read_gray)
        self._raw = functools.lru_cache(32)(lambda i: np.load(self._file(i)))

    def sweep_all(self) -> None:
        """Sweep every photo that has no file yet."""
        with ThreadPoolExecutor(usable_cores()) as pool:
            for _ in track(pool.map(self._sweep, range(len(self._shots))), "sweeping", len(self._shots)):
                pass

    def _sweep(self, i: int) -> None:
        if self._file(i).is_file():
            return
        shot, sources = self._shots[i], [self._shots[j] for j in self._near[i]]
        depth = np.zeros((shot.camera.height, shot.camera.width), dtype=np.float32)
        if sources:
            grays = [self._gray(j) for j in self._near[i]]
            depth = sweep(shot, self._gray(i), sources, grays, planes_of(shot, sources))
        content = io.BytesIO()
        np.save(content, depth)
        write_atomically(self._file(i), content.getvalue())

    def _file(self, i: int) -> Path:
        return self._folder / f"{i:06d}.npy"

    def _read_gray(self, i: int) -> Array:
        import cv2

        shot = self._shots[i]
        stored = decode(self._images / shot.name, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
        gray = cv2.cvtColor(stored.astype(np.float32), cv2.COLOR_BGR2GRAY) * (255 / np.iinfo(stored.dtype).max)
        small = cv2.resize(gray, (shot.camera.width, shot.camera.height), interpolation=cv2.INTER_AREA)
        return _masked(np.asarray(small, dtype=np.float32) + 1, shot, self._masks)

    def depth(self, shot: Shot) -> Array:
        i = self._place[shot.name]
        near = self._near[i]
        small = agreeing(self._shots[i], self._raw(i), [self._shots[j] for j in near], lambda k: self._raw(near[k]))
        small = without_small_holes(small)
        return _masked(_enlarged(small, (shot.camera.width, shot.camera.height)), shot, self._masks)


def _shrunk(shot: Shot, longest: int) -> Shot:
    size = (shot.camera.width, shot.camera.height)
    return replace(shot, camera=scaled_camera(shot.camera, size, min(1.0, longest / max(size))))


def _enlarged(depth: Array, size: tuple[int, int]) -> Array:
    """Enlarge a depth map: linearly within a surface, by the nearest pixel at its borders."""
    import cv2

    if depth.shape[::-1] == size:
        return depth
    nearest = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT)
    filled = cv2.resize((depth > 0).astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    smooth = cv2.resize(depth, size, interpolation=cv2.INTER_LINEAR)
    one_surface = (filled > 0.999) & (np.abs(smooth - nearest) <= _SMOOTH * nearest)
    return np.where(one_surface, smooth, nearest).astype(np.float32)


def _masked(values: Array, shot: Shot, masks: Path) -> Array:
    import cv2

    if not (masks / shot.name).is_file():
        return values
    mask = decode(masks / shot.name, cv2.IMREAD_GRAYSCALE)
    return np.where(cv2.resize(mask, values.shape[1::-1], interpolation=cv2.INTER_NEAREST) > 0, values, np.float32(0))


def write_depth(folder: Path, name: str, metres: Array) -> bool:
    """Write the depth map of image `name` and return True; if it holds no depth, write nothing and return False.

    16-bit millimetres, or float metres (.tif) if millimetres would overflow or be too coarse.
    """
    import tifffile

    pure = PurePosixPath(name)
    stem = folder / pure.with_name(f"depth_{pure.stem}")
    filled = metres[metres > 0]
    if not len(filled):
        return False
    if 1000 * filled.max() > _MOST_MILLIMETRES or np.median(filled) < _NEAR_M:
        content = io.BytesIO()
        tifffile.imwrite(content, metres.astype(np.float32), compression=None)
        write_atomically(stem.with_name(f"{stem.name}.tif"), content.getvalue())
    else:
        write_png(stem.with_name(f"{stem.name}.png"), np.rint(1000 * metres).astype(np.uint16))
    return True
