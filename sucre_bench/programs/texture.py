"""Makes a coloured surface of a scene: depth maps fused into points or a mesh in a method's colours, and its picture.

Depth maps and pictures become truncated signed distances in a sparse grid of voxels. Each view adds its colours, and
distances along its axis, to the voxels near its surface. A voxel stores the means (Curless and Levoy 1996, with unit
weights; in Open3D's sparse blocks). The surface is where the mean distance is zero. A pixel counts if it has depth and
is not black, which means "no colour". Views are read one after the other. Memory depends on the surface's area and the
voxels' size, not on the number of views.

Files: PLY (points or triangles) in the scene's coordinates, and binary glTF 2.0, .glb (triangles). Vertex colours of
glTF are linear light, so they are decoded from sRGB and stored with 16 bits. The material is unlit
(KHR_materials_unlit): a viewer's lamps would change the colours. In glTF y is up, so a node rotates the cameras' mean
upward direction to y.

Pictures show surfaces side by side, seen from behind and above one of the cameras (the paper's texture figure). Rays
are cast into the triangles on the CPU (Open3D's ray casting); no graphics driver is needed.
"""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask, Picture, evenly
from sucre_bench.camera import Camera, moved, unproject
from sucre_bench.engine.reopen_results import Frame
from sucre_bench.errors import InputError, check_number
from sucre_bench.imaging.drawing import captioned, save_marked
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.machine.files import open_atomically, write_atomically
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

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125  # glTF's names of types
_VERTICES, _INDICES = 34962, 34963  # and of what buffers hold

_SIZE = (960, 720)  # size of a picture in pixels
_FOCAL = 0.8  # focal length by width: 64 degrees
_FINER = 2  # rays a pixel, along each side
_BACK, _ABOVE = 0.35, 0.3  # the viewpoint, in units of the distance to the surface


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
    import psutil

    known = []
    for view in (frames[k].view for k in evenly(len(frames), _LOOKED_AT)):
        if _is_fusable(view) and (depth := view.depth[::_STRIDE_PX, ::_STRIDE_PX]).max(initial=0) > 0:
            known.append(np.median(depth[depth > 0]) / view.placed[0].K[0, 0])
    if not known:
        raise InputError("texture: no view has camera, pose and depth; choose a dataset that has them")
    footprint = float(np.median(known))
    if voxel is not None:
        check_number("--voxel", voxel, "(0, 1000]")
    if voxel is not None and voxel < _FINEST * footprint:
        fault = f"finer than the views, whose pixels show {footprint:.2g} m"
        raise InputError(f"--voxel {voxel:g}: {fault}; give {_FINEST * footprint:.2g} or more")
    side = _COARSE * max(footprint, voxel or 0)
    occupied = np.empty(0, np.int64)  # cells of a coarse grid that hold points of the views
    for view in (frame.view for frame in track(frames, "area") if _is_fusable(frame.view)):
        camera, pose = view.placed
        depth = view.depth[::_STRIDE_PX, ::_STRIDE_PX]
        row, column = np.nonzero(depth > 0)
        x, y = column * _STRIDE_PX + 0.5, row * _STRIDE_PX + 0.5
        points = unproject(camera, x, y, depth[row, column].astype(np.float64)).T
        places = np.floor(moved(points, np.linalg.inv(pose)) / side).astype(np.int64)  # (P, 3)
        occupied = np.union1d(occupied, (places + (1 << 20)) @ np.array([1 << 42, 1 << 21, 1]))
    area = len(occupied) * side**2
    if voxel is None:
        voxel = max(footprint, float(np.sqrt(area / most_cells)))
    cells, free = Cells(voxel, int(area / voxel**2)), psutil.virtual_memory().available
    if cells.count * _BYTES_PER_CELL > free:
        enough = np.sqrt(area * _BYTES_PER_CELL / free) * 1.05
        needed = f"{cells.count / 1e6:.0f} million cells take {cells.count * _BYTES_PER_CELL / 2**30:.0f} GB"
        raise InputError(f"--voxel {voxel:g}: {needed}, {free / 2**30:.0f} are free; give {enough:.2g} or more")
    return cells


def _is_fusable(view: View) -> bool:
    return view.camera is not None and view.cam_from_world is not None and view.has_depth


def fuse(frames: Sequence[Frame], method: str, cells: Cells, mesh: bool = True, mask: str = "") -> Model:
    """Return the surface of views in the colours of a method.

    method: its label, or "input"; mesh: with triangles, else points only; mask: another method, whose holes are left
    out, too. Raises InputError if no pixel has both depth and colour, or if a picture cannot be read.
    """
    import open3d as o3d

    new_grid: Any = o3d.t.geometry.VoxelBlockGrid  # its stubs know no plain tuples
    grid = new_grid(
        attr_names=("tsdf", "weight", "color"),
        attr_dtypes=(o3d.core.float32,) * 3,
        attr_channels=(1, 1, 3),
        voxel_size=cells.voxel,
        block_resolution=_BLOCK,
        block_count=max(100, cells.count // _CELLS_PER_BLOCK),  # it would grow, but by copying to twice the size
    )
    for frame in track(frames, f"fusing {method}"):
        if _is_fusable(frame.view):
            picture = frame.picture(method)
            coloured: Mask = np.asarray(picture.any(axis=-1))
            if mask:
                coloured &= frame.picture(mask).any(axis=-1)
            _integrate(grid, frame.view, picture, coloured, cells.voxel)
    if not grid.hashmap().size():
        raise InputError(f"{method}: no pixel has both depth and colour; choose another method")
    seen_once = 0.5  # parts seen by a single view are included
    if mesh:
        surface = grid.extract_triangle_mesh(seen_once)
        of, triangles = surface.vertex, surface.triangle.indices.numpy().astype(np.int32).reshape(-1, 3)
    else:
        of, triangles = grid.extract_point_cloud(seen_once).point, np.empty((0, 3), np.int32)
    if not len(of.positions):
        raise InputError("texture: the views show too little of a surface; give smaller voxels, --voxel METRES")
    colours = np.rint(of.colors.numpy().clip(0, 1) * 255).astype(np.uint8)
    return Model(np.asarray(of.positions.numpy(), np.float32), colours, triangles)


def _integrate(grid: Any, view: View, picture: Picture, coloured: Mask, voxel: float) -> None:
    """Add a view's distances and colours to the grid."""
    import open3d as o3d

    camera, cam_from_world = view.placed
    depth = np.where(coloured, view.depth, np.float32(0))
    if not depth.any():
        return
    # Open3D looks at every fourth pixel for blocks, far pixels are far apart on the surface, and twice as far if it is
    # seen from the side: pixels are repeated so that no block falls between.
    apart = _LOOKED_EVERY * 2 * float(np.percentile(depth[depth > 0], 99)) / camera.K[0, 0]
    more = min(_MOST_REPEATS, max(1, math.ceil(apart / (_BLOCK * voxel))))
    tensor: Any = o3d.core.Tensor  # its stubs know no arrays
    image: Any = o3d.t.geometry.Image
    pose = tensor(np.array(cam_from_world))
    scale_and_reach = (1.0, float(depth.max()) + 1.0)
    dense = image(tensor(depth.repeat(more, axis=0).repeat(more, axis=1)))
    K, finer = tensor(np.array(camera.K)), tensor(camera.K * [[more], [more], [1]])
    blocks = grid.compute_unique_block_coordinates(dense, finer, pose, *scale_and_reach, _TRUNCATION)
    # A voxel gets the pixel that it projects into, by rounding down: pixel centres are at +0.5 here, as in ours.
    planes = (image(tensor(plane)) for plane in (depth, picture / np.float32(255)))
    grid.integrate(blocks, *planes, K, pose, *scale_and_reach, _TRUNCATION)


def write_model(path: Path, model: Model, up: Array) -> None:
    """Write a surface as .ply or .glb. up: (3,) the scene's upward direction. Raises OutputError if that fails."""
    if path.suffix.lower() == ".glb":
        write_atomically(path, _glb(model, up))
        return
    vertices = np.empty(len(model.points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = model.points, model.colours
    header = ["ply", "format binary_little_endian 1.0", "comment sucre_bench", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    faces = np.empty(len(model.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    if len(faces):
        faces["count"], faces["corners"] = 3, model.triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    write_atomically(path, "\n".join([*header, "end_header\n"]).encode() + vertices.tobytes() + faces.tobytes())


def mean_up(views: Sequence[View]) -> Array:
    """Return the mean upward direction (3,) of views' cameras, a unit vector; -y of the world if they cancel out."""
    poses = [view.cam_from_world for view in views if view.cam_from_world is not None]
    total = -np.sum([pose[1, :3] for pose in poses], axis=0) if poses else np.zeros(3)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 1e-3 * len(poses) > 0 else np.array([0.0, -1.0, 0.0])


def _glb(model: Model, up: Array) -> bytes:
    from scipy.spatial.transform import Rotation

    turn, _ = Rotation.align_vectors(np.array([[0.0, 1.0, 0.0]]), up[None])  # the shortest way
    levels = (srgb_decode(np.arange(256) / 255) * 65535 + 0.5).astype("<u2")
    colours = np.full((len(model.points), 4), 65535, "<u2")  # with alpha: each vertex is to begin at a multiple of four
    colours[:, :3] = levels[model.colours]
    parts = [model.points.astype("<f4"), colours, model.triangles.astype("<u4").reshape(-1)]
    sizes = [part.nbytes for part in parts]
    starts = np.cumsum([0, *sizes]).tolist()
    low, high = (bound(model.points, axis=0).tolist() for bound in (np.min, np.max))
    kinds = (
        {"componentType": _FLOAT, "type": "VEC3", "min": low, "max": high},
        {"componentType": _UINT16, "type": "VEC4", "normalized": True},
        {"componentType": _UINT32, "type": "SCALAR"},
    )
    primitive = {"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0, "mode": 4}
    content = {
        "asset": {"version": "2.0", "generator": "sucre_bench"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": turn.as_quat().tolist()}],
        "meshes": [{"primitives": [primitive]}],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}],
        "accessors": [
            {"bufferView": k, "count": len(part), **kind}
            for k, (part, kind) in enumerate(zip(parts, kinds, strict=True))
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size, "target": target}
            for start, size, target in zip(starts, sizes, (_VERTICES, _VERTICES, _INDICES), strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + starts[-1]
    head = b"glTF" + np.array([2, total, len(text)], "<u4").tobytes() + b"JSON"
    return b"".join([head, text, np.uint32(starts[-1]).tobytes(), b"BIN\0", *(part.tobytes() for part in parts)])


def write_picture(path: Path, models: Mapping[str, Model], frames: Sequence[Frame]) -> None:
    """Write the surfaces next to each other with their names as a PNG, 720 x (n * 960) pixels, on white.

    Raises InputError if no view has depth.
    """
    from PIL import Image

    camera, pose = vantage(frames)
    pictures = np.hstack([captioned(rendered(model, camera, pose), name) for name, model in models.items()])
    with open_atomically(path) as file:
        save_marked(file, Image.fromarray(pictures), ".png")


def vantage(frames: Sequence[Frame]) -> tuple[Camera, Array]:
    """Return a camera behind and above the middle view's, aimed at the same surface, and its cam_from_world."""
    by_distance = sorted(range(len(frames)), key=lambda k: abs(k - len(frames) // 2))
    views = (frames[k].view for k in by_distance)
    view = next((view for view in views if _is_fusable(view) and view.valid.any()), None)
    if view is None:
        raise InputError("texture: no view has camera, pose and depth; leave --picture out")
    camera, cam_from_world = view.placed
    row, column = np.nonzero(view.valid)
    points = unproject(camera, column + 0.5, row + 0.5, view.depth[row, column])
    target = np.median(points, axis=1).astype(np.float64)
    eye = np.array([0.0, -_ABOVE, -_BACK]) * target[2]
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross([0.0, 1.0, 0.0], forward)
    right /= np.linalg.norm(right)
    turn = np.eye(4)
    turn[:3, :3] = right, np.cross(forward, right), forward
    turn[:3, 3] = -turn[:3, :3] @ eye
    wide, high = _SIZE
    K = np.array([[_FOCAL * wide, 0, wide / 2], [0, _FOCAL * wide, high / 2], [0, 0, 1.0]])
    return Camera(K, wide, high), turn @ cam_from_world


def rendered(model: Model, camera: Camera, cam_from_world: Array) -> Picture:
    """Return a camera's picture of a surface with triangles, (H, W, 3) uint8 RGB, on white.

    Colours are interpolated between a triangle's corners, and averaged over four rays a pixel.
    """
    import cv2
    import open3d as o3d

    tensor: Any = o3d.core.Tensor  # its stubs know no arrays
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(model.points), tensor(model.triangles.astype(np.uint32)))
    K = camera.K * [[_FINER], [_FINER], [1]]
    size = (_FINER * camera.width, _FINER * camera.height)
    hits = scene.cast_rays(scene.create_rays_pinhole(tensor(K), tensor(np.array(cam_from_world)), *size))
    hit = np.isfinite(hits["t_hit"].numpy())
    second, third = np.moveaxis(hits["primitive_uvs"].numpy()[hit], -1, 0)
    corners = model.colours[model.triangles[hits["primitive_ids"].numpy()[hit]]]  # (P, 3, 3)
    shares = np.stack([1 - second - third, second, third], axis=-1)
    fine = np.full((*hit.shape, 3), 255, np.float32)
    fine[hit] = (corners * shares[..., None]).sum(axis=1)
    small = cv2.resize(fine, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.asarray(np.rint(small).clip(0, 255).astype(np.uint8))
