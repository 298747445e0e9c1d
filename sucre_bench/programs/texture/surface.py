"""Depth maps and pictures fused into one coloured surface: truncated signed distances in a sparse grid of voxels.

Each view adds its colours, and distances along its axis, to the voxels near its surface. A voxel stores the means
(Curless and Levoy 1996, with unit weights; in Open3D's sparse blocks). The surface is where the mean distance is zero.
A pixel counts if it has depth and is not black, which means "no colour". Views are read one after the other. Memory
depends on the surface's area and the voxels' size, not on the number of views.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask, Picture, evenly
from sucre_bench.camera import moved, unproject
from sucre_bench.engine.reopen_results import Frame
from sucre_bench.errors import InputError
from sucre_bench.machine.progress import track
from sucre_bench.scene import View

_BYTES_PER_CELL = 1000  # measured at the peak
_TRUNCATION = 8.0  # voxels, Open3D's own
_BLOCK = 16
_LOOKED_EVERY = 4  # pixels: what Open3D looks at for blocks, along each side
_MOST_REPEATS = 8
_FINEST = 0.25  # smallest voxel, in pixel footprints: a smaller one shows no more
_CELLS_PER_BLOCK = 120  # measured: 140 to 175
# The area is estimated with cells of 16 footprints and every fourth pixel: far or oblique surfaces leave no gaps.
_COARSE = 16
_STRIDE_PX = 4
_LOOKED_AT = 40  # views whose pixels' footprints are measured


@dataclass(frozen=True, eq=False)
class Model:
    """A coloured surface in the scene's coordinates.

    points: (P, 3) float32 metres; colours: (P, 3) uint8 sRGB; triangles: (T, 3) int32, empty for a point cloud.
    """

    points: Array
    colours: npt.NDArray[np.uint8]
    triangles: npt.NDArray[np.int32]


@dataclass(frozen=True)
class Cells:
    """The resolution of a surface. voxel: metres; count: about the number of squares of that size that cover it."""

    voxel: float
    count: int


def choose_cells(frames: Sequence[Frame], voxel: float | None = None, *, most_cells: int = 1_000_000) -> Cells:
    """Return the voxels' size for these views and their number; reads every depth map once.

    voxel: metres. The default is the median footprint of the pixels, depth / focal length, or more if that would give
    more than `most_cells`. A million cells make 1.2 to 1.6 million points, 50 to 70 MB as .glb.
    Raises InputError if no view has depth, camera and pose, if voxels are finer than the views' pixels, or if the
    memory cannot hold them.
    """
    footprints = [_footprint(frames[k].view) for k in evenly(len(frames), _LOOKED_AT)]
    known = [one for one in footprints if one > 0]
    if not known:
        raise InputError("texture: no view has camera, pose and depth; choose a dataset that has them")
    footprint = float(np.median(known))
    if voxel is not None and voxel < _FINEST * footprint:
        fault = f"finer than the views, whose pixels show {footprint:.2g} m"
        raise InputError(f"--voxel {voxel:g}: {fault}; give {_FINEST * footprint:.2g} or more")
    side = _COARSE * max(footprint, voxel or 0)
    area = _occupied(frames, side) * side**2
    if voxel is None:
        voxel = max(footprint, float(np.sqrt(area / most_cells)))
    cells = Cells(voxel, int(area / voxel**2))
    _check_memory(cells, area)
    return cells


def _footprint(view: View) -> float:
    """The median footprint of a view's pixels on the surface, in metres; 0 without depth."""
    if not _fusable(view):
        return 0.0
    depth = view.depth[::_STRIDE_PX, ::_STRIDE_PX]
    return float(np.median(depth[depth > 0]) / view.placed[0].K[0, 0]) if (depth > 0).any() else 0.0


def _fusable(view: View) -> bool:
    return view.camera is not None and view.cam_from_world is not None and view.has_depth


def _occupied(frames: Sequence[Frame], side: float) -> int:
    """The number of cells of a coarse grid that hold points of the views."""
    occupied = np.empty(0, np.int64)
    for frame in track(frames, "area"):
        view = frame.view
        if _fusable(view):
            places = np.floor(_some_points(view) / side).astype(np.int64)  # (P, 3)
            keys = np.unique((places + (1 << 20)) @ np.array([1 << 42, 1 << 21, 1]))
            occupied = np.union1d(occupied, keys)
    return len(occupied)


def _some_points(view: View) -> Array:
    """World points (P, 3) of every fourth pixel of every fourth row."""
    camera, pose = view.placed
    depth = view.depth[::_STRIDE_PX, ::_STRIDE_PX]
    row, column = np.nonzero(depth > 0)
    x, y = column * _STRIDE_PX + 0.5, row * _STRIDE_PX + 0.5
    points = unproject(camera, x, y, depth[row, column].astype(np.float64)).T
    return moved(points, np.linalg.inv(pose))


def _check_memory(cells: Cells, area: float) -> None:
    import psutil

    free = psutil.virtual_memory().available
    if cells.count * _BYTES_PER_CELL > free:
        enough = np.sqrt(area * _BYTES_PER_CELL / free) * 1.05
        needed = f"{cells.count / 1e6:.0f} million cells take {cells.count * _BYTES_PER_CELL / 2**30:.0f} GB"
        raise InputError(f"--voxel {cells.voxel:g}: {needed}, {free / 2**30:.0f} are free; give {enough:.2g} or more")


def fuse(frames: Sequence[Frame], method: str, cells: Cells, mesh: bool = True, mask: str = "") -> Model:
    """Return the surface of views in the colours of a method.

    method: its label, or "input"; mesh: with triangles, else points only; mask: another method, whose holes are left
    out, too. Raises InputError if no pixel has both depth and colour, or if a picture cannot be read.
    """
    grid = _grid(cells)
    for frame in track(frames, f"fusing {method}"):
        if _fusable(frame.view):
            picture = frame.picture(method)
            coloured = _coloured(picture)
            if mask:
                coloured &= _coloured(frame.picture(mask))
            _integrate(grid, frame.view, picture, coloured, cells.voxel)
    if not grid.hashmap().size():
        raise InputError(f"{method}: no pixel has both depth and colour; choose another method")
    return _extract(grid, mesh)


def _coloured(picture: Picture) -> Mask:
    return np.asarray(picture.any(axis=-1))


def _grid(cells: Cells) -> Any:
    import open3d as o3d

    grid: Any = o3d.t.geometry.VoxelBlockGrid  # its stubs know no plain tuples
    return grid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(o3d.core.float32,) * 3,
        attr_channels=(1, 1, 3),
        voxel_size=cells.voxel,
        block_resolution=_BLOCK,
        block_count=max(100, cells.count // _CELLS_PER_BLOCK),  # it would grow, but by copying to twice the size
    )


def _integrate(grid: Any, view: View, picture: Picture, coloured: Mask, voxel: float) -> None:
    import open3d as o3d

    camera, cam_from_world = view.placed
    depth = np.where(coloured, view.depth, np.float32(0))
    if not depth.any():
        return
    tensor: Any = o3d.core.Tensor  # its stubs know no arrays
    image: Any = o3d.t.geometry.Image
    pose = tensor(np.array(cam_from_world))
    scale_and_reach = (1.0, float(depth.max()) + 1.0)
    more = _repeats(depth, camera.K, voxel)
    dense = image(tensor(depth.repeat(more, axis=0).repeat(more, axis=1)))
    K, finer = tensor(np.array(camera.K)), tensor(camera.K * [[more], [more], [1]])
    blocks = grid.compute_unique_block_coordinates(dense, finer, pose, *scale_and_reach, _TRUNCATION)
    # A voxel gets the pixel that it projects into, by rounding down: pixel centres are at +0.5 here, as in ours.
    planes = (image(tensor(plane)) for plane in (depth, picture / np.float32(255)))
    grid.integrate(blocks, *planes, K, pose, *scale_and_reach, _TRUNCATION)


def _repeats(depth: Array, K: Array, voxel: float) -> int:
    """How often to repeat pixels so that no block falls between every fourth one, which Open3D looks at.

    Far pixels are far apart on the surface, and twice as far if it is seen from the side.
    """
    apart = _LOOKED_EVERY * 2 * float(np.percentile(depth[depth > 0], 99)) / K[0, 0]
    return min(_MOST_REPEATS, max(1, math.ceil(apart / (_BLOCK * voxel))))


def _extract(grid: Any, mesh: bool) -> Model:
    """The surface of a grid, parts seen by a single view included."""
    seen_once = 0.5
    if mesh:
        surface = grid.extract_triangle_mesh(seen_once)
        of, triangles = surface.vertex, surface.triangle.indices.numpy().astype(np.int32).reshape(-1, 3)
    else:
        of, triangles = grid.extract_point_cloud(seen_once).point, np.empty((0, 3), np.int32)
    if not len(of.positions):
        raise InputError("texture: the views show too little of a surface; give smaller voxels, --voxel METRES")
    colours = np.rint(of.colors.numpy().clip(0, 1) * 255).astype(np.uint8)
    return Model(np.asarray(of.positions.numpy(), np.float32), colours, triangles)
