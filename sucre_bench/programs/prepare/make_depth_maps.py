"""Depth maps of all photos: plane sweep, consistency between photos, small holes filled, full size, files."""

import functools
import io
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import scaled_camera
from sucre_bench.imaging.image_files import decode, write_png
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import say, track
from sucre_bench.programs.prepare.options import Surface
from sucre_bench.programs.prepare.plane_sweep import agreeing, planes_of, sweep
from sucre_bench.programs.prepare.registered_photos import Shot, neighbours
from sucre_bench.programs.prepare.relief import relief_of

_MOST_DENSE = 500  # photos: about an hour of plane sweeps on two cores
_SOURCES = 4
_FEWEST_POINTS = 6  # sparse points of a photo that a sweep needs
_SMOOTH = 0.01  # a larger relative difference between neighbours is a border
# A hole is filled up to this size, a share of the image, where its rim lies on one plane.
_LARGEST_HOLE = 0.01  # share of the image
_RIM = 3  # pixels: width of the rim around a hole
_FEWEST_RIM = 12  # fewest pixels of a rim
_FLAT_RIM = 0.005  # relative distance from one plane that nine tenths of the rim must keep
_MOST_MILLIMETRES = 65_500
_NEAR_M = 0.5  # metres; nearer scenes need finer steps than a millimetre


def is_dense(surface: Surface, photos: int) -> bool:
    """Whether depth maps come from plane sweeps; else from a relief of the sparse points. photos: placed ones."""
    return surface == "dense" or (surface == "auto" and photos <= _MOST_DENSE)


# A photo's planar depth (H, W) float32 at its size, in the model's unit, 0 = unknown.
DepthMaps = Callable[[Shot], Array]


def depth_maps(
    shots: Sequence[Shot], images: Path, masks: Path, folder: Path, longest: int | None
) -> tuple[str, DepthMaps]:
    """Return what depth maps are made from, for people, and the function that gives them.

    masks: folder of masks (may be empty); longest: longest side in pixels of swept images, which are stored in
    `folder`; None: no sweep, but the relief of the sparse points.
    """
    if longest is None:
        say(f"{len(shots)} photos: surface through the sparse points")
        relief = relief_of(shots)
        return "relief of the sparse points", lambda shot: _masked(relief.depth(shot), shot, masks)
    dense = Dense(shots, images, masks, folder, longest)
    dense.sweep_all()
    return "plane sweep, confirmed by other photos", dense.depth


class Dense:
    """Plane sweeps at reduced size, stored in a folder. longest: longest side of the swept images, in pixels."""

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
        """Return what the sweeps of this photo and of others agree on, its small holes filled."""
        i = self._place[shot.name]
        near = self._near[i]
        small = agreeing(self._shots[i], self._raw(i), [self._shots[j] for j in near], lambda k: self._raw(near[k]))
        small = without_small_holes(small)
        return _masked(_enlarged(small, (shot.camera.width, shot.camera.height)), shot, self._masks)


def without_small_holes(depth: Array) -> Array:
    """Return planar depth (H, W) with every hole filled whose rim lies on one plane.

    On a plane inverse depth is linear in pixel coordinates. A hole at the image's border, or between an object and its
    background, has no such rim and stays 0.
    """
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats((depth <= 0).astype(np.uint8), connectivity=8)
    filled = depth.copy()
    height, width = depth.shape
    for label in range(1, count):
        x, y, wide, high, area = stats[label]
        if area > _LARGEST_HOLE * depth.size or x == 0 or y == 0 or x + wide == width or y + high == height:
            continue
        window = np.s_[max(0, y - _RIM) : y + high + _RIM, max(0, x - _RIM) : x + wide + _RIM]
        hole = labels[window] == label
        around = cv2.dilate(hole.astype(np.uint8), np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)) > 0
        rows, columns = np.nonzero(around & (depth[window] > 0))
        if len(rows) < _FEWEST_RIM:
            continue
        w = 1 / depth[window][rows, columns].astype(np.float64)
        design = np.column_stack([columns, rows, np.ones(len(rows))])
        plane = np.linalg.lstsq(design, w, rcond=None)[0]
        if np.quantile(np.abs(design @ plane / w - 1), 0.9) > _FLAT_RIM:
            continue
        rows, columns = np.nonzero(hole)
        inside = plane[0] * columns + plane[1] * rows + plane[2]
        if inside.min() > 0:
            filled[window][hole] = 1 / inside
    return filled


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
