"""Depth maps of all photos: plane sweeps at reduced size, or a relief of the sparse points.

A sweep is kept where photos agree; small holes are filled, and the map is enlarged to the photo's size. A relief has
the heights of the sparse points over their main plane, as triangles for ray casting. It is for dives too long for plane
sweeps and for seabeds without overhangs: a place has one height.
"""

import functools
import io
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import pixel_rays, scaled_camera
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode, write_png
from sucre_bench.machine.compute import usable_cores
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.packages import load
from sucre_bench.machine.progress import say, track
from sucre_bench.programs.prepare.photos import read_mask
from sucre_bench.programs.prepare.plane_sweep import agreeing, neighbours, planes_of, sweep
from sucre_bench.programs.prepare.shots import Shot

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
_LEAST_TRACK, _FEWEST_OF_RELIEF = 3, 20
_NEAREST = 8
_ODD = 6.0  # in median absolute deviations of a height from its neighbours
_LONG = 6.0  # longest edge, in median edges

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
        made_from, maps = "relief of the sparse points", relief(shots)
    else:
        made_from, maps = "plane sweep, confirmed by other photos", _swept(shots, images, masks, folder, longest)
    return made_from, lambda shot: _masked(maps(shot), shot, masks)


def _masked(values: Array, shot: Shot, masks: Path) -> Array:
    if not (masks / shot.name).is_file():
        return values
    return np.where(read_mask(masks / shot.name, values.shape[1::-1]) > 0, values, np.float32(0))


def _swept(shots: Sequence[Shot], images: Path, masks: Path, folder: Path, longest: int) -> DepthMaps:
    """Sweep every photo that has no file in the folder yet; a depth map is what several sweeps agree on."""
    place = {shot.name: i for i, shot in enumerate(shots)}
    near = [
        [j for j in best if len(shots[j].points)] if len(shot.points) >= _FEWEST_POINTS else []
        for shot, best in zip(shots, neighbours(shots, _SOURCES), strict=True)
    ]
    sizes = [(shot.camera.width, shot.camera.height) for shot in shots]
    scales = [min(1.0, longest / max(size)) for size in sizes]
    small = [
        replace(shot, camera=scaled_camera(shot.camera, size, scale))
        for shot, size, scale in zip(shots, sizes, scales, strict=True)
    ]

    def file(i: int) -> Path:
        return folder / f"{i:06d}.npy"

    @functools.lru_cache(32)
    def gray(i: int) -> Array:
        import cv2

        stored = decode(images / shots[i].name, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH)
        values = cv2.cvtColor(stored.astype(np.float32), cv2.COLOR_BGR2GRAY) * (255 / np.iinfo(stored.dtype).max)
        size = (small[i].camera.width, small[i].camera.height)
        reduced = cv2.resize(values, size, interpolation=cv2.INTER_AREA)
        return _masked(np.asarray(reduced, dtype=np.float32) + 1, shots[i], masks)

    @functools.lru_cache(32)
    def raw(i: int) -> Array:
        return np.asarray(np.load(file(i)))

    def sweep_one(i: int) -> None:
        if file(i).is_file():
            return
        depth = np.zeros((small[i].camera.height, small[i].camera.width), dtype=np.float32)
        if near[i]:
            sources = [small[j] for j in near[i]]
            depth = sweep(small[i], gray(i), sources, [gray(j) for j in near[i]], *planes_of(small[i], sources))
        content = io.BytesIO()
        np.save(content, depth)
        write_atomically(file(i), content.getvalue())

    def depth(shot: Shot) -> Array:
        i = place[shot.name]
        agreed = agreeing(small[i], raw(i), [small[j] for j in near[i]], lambda k: raw(near[i][k]))
        return _enlarged(without_small_holes(agreed), sizes[i])

    with ThreadPoolExecutor(usable_cores()) as pool:
        list(track(pool.map(sweep_one, range(len(shots))), "sweeping", len(shots)))
    return depth


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


def relief(shots: Sequence[Shot]) -> DepthMaps:
    """Return depth maps of the surface through points seen in three photos or more.

    Raises InputError if there are too few such points, or if open3d does not load.
    """
    from scipy.spatial import Delaunay, cKDTree

    ids = np.concatenate([shot.point_ids for shot in shots])
    _, first = np.unique(ids, return_index=True)
    points = np.concatenate([shot.points for shot in shots])[first]
    points = points[np.concatenate([shot.tracks for shot in shots])[first] >= _LEAST_TRACK]
    if len(points) < _FEWEST_OF_RELIEF:
        fault = f"three photos or more agree on only {len(points)} points, too few for a surface"
        raise InputError(fault, "photos", "give --surface dense, or take photos that overlap more")
    centred = points - np.median(points, axis=0)
    axes = np.linalg.svd(centred, full_matrices=False)[2]  # rows: two directions along the main plane, and its normal
    for _ in range(10):  # again, without points far off the plane
        height = np.abs(centred @ axes[2])
        axes = np.linalg.svd(centred[height <= 3 * np.median(height) + 1e-12], full_matrices=False)[2]
    in_plane = centred @ axes.T  # (P, 3), the last is height
    _, near = cKDTree(in_plane[:, :2]).query(in_plane[:, :2], k=min(_NEAREST, len(points)))
    off = np.abs(in_plane[:, 2] - np.median(in_plane[near, 2], axis=1))
    fine = off <= _ODD * max(float(np.median(off)), 1e-12)
    points, in_plane = points[fine], in_plane[fine]
    triangles = Delaunay(in_plane[:, :2]).simplices
    edges = np.linalg.norm(in_plane[triangles][:, :, :2] - np.roll(in_plane[triangles][:, :, :2], 1, axis=1), axis=2)
    triangles = triangles[edges.max(axis=1) <= _LONG * np.median(edges)]

    o3d = load("--surface sparse", "open3d")
    middle, tensor, scene = points.mean(axis=0), o3d.core.Tensor, o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor((points - middle).astype(np.float32)), tensor(triangles.astype(np.uint32)))  # float32

    def depth(shot: Shot) -> Array:
        # Along rays of unit depth, the distance to the hit is the planar depth.
        rays = pixel_rays(shot.camera) @ shot.cam_from_world[:3, :3].astype(np.float32)
        origin = np.broadcast_to((shot.centre - middle).astype(np.float32), rays.shape)
        hit = scene.cast_rays(tensor(np.concatenate([origin, rays], axis=-1)))["t_hit"].numpy()
        return np.where(np.isfinite(hit), hit, 0).astype(np.float32)

    return depth


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
