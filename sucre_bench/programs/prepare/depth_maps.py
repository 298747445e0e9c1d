"""Depth maps of all photos: of the surface that plane sweeps give, or of a relief of the sparse points.

Sweeps are made at reduced size and kept where photos agree. The surface through all of them closes their holes. A
relief has the heights of the sparse points over their main plane. It is for dives too long for plane sweeps and for
seabeds without overhangs: a place has one height.
"""

import functools
import io
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Size
from sucre_bench.camera import scaled_camera
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode, write_png
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import say, track
from sucre_bench.programs.prepare.photos import read_mask
from sucre_bench.programs.prepare.plane_sweep import agreeing, neighbours, planes_of, sweep
from sucre_bench.programs.prepare.shots import Shot
from sucre_bench.programs.prepare.surface import Surface, fused

_SOURCES = 4
_FEWEST_POINTS = 6  # sparse points of a photo that a sweep needs
_SMOOTH = 0.01  # a larger relative difference between neighbours is a border
_EDGE = 0.05  # relative difference of the surface from what the photo measured, above which the latter counts
_WIDEST = 0.1  # gap in the surface from a measured point, as a share of the distance from the nearest camera
_NEXT = 0.01  # likewise: closer to a measured point, another photo measured the place
_MOST_MILLIMETRES = 65_500
_NEAR_M = 0.5  # metres; nearer scenes need finer steps than a millimetre
_LEAST_TRACK = 3
_FEWEST_OF_RELIEF = 20
_NEAREST = 8
_ODD = 6.0  # in median absolute deviations of a height from its neighbours
_LONG = 6.0  # longest edge, in median edges

# How a pixel got its depth, as `depth_origin/` stores it; 0: it has none.
MEASURED = 1
FUSED = 2
INTERPOLATED = 3
GIVEN = 4


class DepthMap(NamedTuple):
    """The depth of a photo, and how each pixel got it."""

    depth: Array
    """(H, W) float32 at the photo's size, planar, in the model's unit, 0 = unknown."""

    origin: npt.NDArray[np.uint8]
    """(H, W) uint8, how each pixel got its depth: 1 measured in this photo, 2 in another one, 3 between measured
    points, 4 given."""


DepthMaps = Callable[[Shot], DepthMap]


def _gray(path: Path, size: Size) -> Array:
    """A gray image (H, W) float32 from 0 to 255, of a size (W, H)."""
    import cv2

    stored = decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
    gray = cv2.cvtColor(stored.astype(np.float32), cv2.COLOR_BGR2GRAY)
    values = gray * (255 / np.iinfo(stored.dtype).max)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def swept(
    shots: Sequence[Shot], images: Path, masks: Path, folder: Path, longest: int
) -> DepthMaps:
    """Return the depth maps of the surface that all plane sweeps give.

    masks: folder of masks (may be empty); folder: for sweeps, those that are there are not made again;
    longest: longest side in pixels of swept images.
    """
    place = {shot.name: i for i, shot in enumerate(shots)}
    near = [
        [j for j in best if len(shots[j].points)] if len(shot.points) >= _FEWEST_POINTS else []
        for shot, best in zip(shots, neighbours(shots, _SOURCES), strict=True)
    ]
    sizes = [shot.camera.size for shot in shots]
    small = [
        replace(shot, camera=scaled_camera(shot.camera, size, min(1.0, longest / max(size))))
        for shot, size in zip(shots, sizes, strict=True)
    ]

    @functools.lru_cache(32)
    def gray(i: int) -> Array:
        return masked(_gray(images / shots[i].name, small[i].camera.size) + 1, shots[i], masks)

    @functools.lru_cache(32)
    def raw(i: int) -> Array:
        return np.asarray(np.load(folder / f"{i:06d}.npy"))

    @functools.lru_cache(64)
    def agreed(i: int) -> Array:
        return agreeing(
            small[i], raw(i), [small[j] for j in near[i]], lambda k: raw(near[i][k])
        )

    def sweep_one(i: int) -> None:
        file = folder / f"{i:06d}.npy"
        depth = np.zeros((small[i].camera.height, small[i].camera.width), np.float32)
        with suppress(OSError, ValueError, TypeError, EOFError):
            # what NumPy raises for a file that was cut short
            if np.load(file, mmap_mode="r").shape == depth.shape:
                return
        if near[i]:
            sources = [small[j] for j in near[i]]
            depth = sweep(
                small[i],
                gray(i),
                sources,
                [gray(j) for j in near[i]],
                *planes_of(small[i], sources),
            )
        content = io.BytesIO()
        np.save(content, depth)  # into a file it does not say that the disk is full
        write_atomically(file, content.getvalue())

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(track(pool.map(sweep_one, range(len(shots))), "sweeping", len(shots)))
    say("fusing the depths of all photos into one surface")
    surface = fused(small, agreed, _WIDEST)
    cast = surface.caster()

    def depth(shot: Shot) -> DepthMap:
        i = place[shot.name]
        on_surface, triangle = cast(small[i])
        measured = agreed(i)
        gap = surface.gaps[surface.triangles[triangle, 0]] / np.maximum(on_surface, 1e-9)
        # At edges and thin things, which the surface smooths, what several photos measured is better.
        own = (measured > 0) & ~(np.abs(on_surface - measured) < _EDGE * measured)
        both = np.where(own, measured, on_surface)
        origin = np.where(
            measured > 0, MEASURED, np.where(gap < _NEXT, FUSED, INTERPOLATED)
        ) * (both > 0)
        return DepthMap(_enlarged(both, sizes[i]), nearest(origin.astype(np.uint8), sizes[i]))

    return depth


def masked(values: AnyArray, shot: Shot, masks: Path) -> AnyArray:
    """Return values (H, W) of a shot, 0 where its mask is black; masks: folder of masks (may be empty)."""
    if not (masks / shot.name).is_file():
        return values
    return np.where(read_mask(masks / shot.name, values.shape[1::-1]) > 0, values, 0).astype(
        values.dtype
    )


def of_surface(surface: Surface, origin: int) -> DepthMaps:
    """Return the depth maps of a surface, at the photos' sizes; origin: of all pixels that it gives a depth."""
    cast = surface.caster()

    def depth(shot: Shot) -> DepthMap:
        seen, _ = cast(shot)
        return DepthMap(seen, ((seen > 0) * origin).astype(np.uint8))

    return depth


def nearest(values: AnyArray, size: Size) -> AnyArray:
    """Return a map (H, W) at another size (width, height), each pixel the nearest one of the map."""
    import cv2

    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_NEAREST_EXACT))


def _enlarged(depth: Array, size: Size) -> Array:
    """Enlarge a depth map: linearly within a surface, by the nearest pixel at its borders."""
    import cv2

    if depth.shape[::-1] == size:
        return depth
    coarse = nearest(depth, size)
    filled = cv2.resize((depth > 0).astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    smooth = cv2.resize(depth, size, interpolation=cv2.INTER_LINEAR)
    one_surface = (filled > 0.999) & (np.abs(smooth - coarse) <= _SMOOTH * coarse)
    return np.where(one_surface, smooth, coarse).astype(np.float32)


def relief(shots: Sequence[Shot]) -> Surface:
    """Return the surface through points seen in three photos or more. Raises InputError if there are too few."""
    from scipy.spatial import Delaunay, cKDTree

    ids = np.concatenate([shot.point_ids for shot in shots])
    _, first = np.unique(ids, return_index=True)
    points = np.concatenate([shot.points for shot in shots])[first]
    points = points[np.concatenate([shot.tracks for shot in shots])[first] >= _LEAST_TRACK]
    if len(points) < _FEWEST_OF_RELIEF:
        fault = (
            f"three photos or more agree on only {len(points)} points, too few for a surface"
        )
        raise InputError(
            fault, "photos", "give --surface dense, or take photos that overlap more"
        )
    centred = points - np.median(points, axis=0)
    # rows: two directions along the main plane, and its normal
    axes = np.linalg.svd(centred, full_matrices=False)[2]
    for _ in range(10):  # again, without points far off the plane
        height = np.abs(centred @ axes[2])
        axes = np.linalg.svd(
            centred[height <= 3 * np.median(height) + 1e-12], full_matrices=False
        )[2]
    in_plane = centred @ axes.T  # (P, 3), the last is height
    _, near = cKDTree(in_plane[:, :2]).query(in_plane[:, :2], k=min(_NEAREST, len(points)))
    off = np.abs(in_plane[:, 2] - np.median(in_plane[near, 2], axis=1))
    fine = off <= _ODD * max(float(np.median(off)), 1e-12)
    points, in_plane = points[fine], in_plane[fine]
    triangles = Delaunay(in_plane[:, :2]).simplices
    edges = np.linalg.norm(
        in_plane[triangles][:, :, :2] - np.roll(in_plane[triangles][:, :, :2], 1, axis=1),
        axis=2,
    )
    triangles = triangles[edges.max(axis=1) <= _LONG * np.median(edges)]
    return Surface(points, triangles, np.zeros(len(points)))


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
