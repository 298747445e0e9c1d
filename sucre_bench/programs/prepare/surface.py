"""One surface of the whole scene, and the depth at which each photo sees it.

The measured depths of all photos become points with normals, and these one closed surface. Source: Kazhdan & Hoppe,
Screened Poisson surface reconstruction, ACM TOG 2013, by Open3D. Parts far from every measured point are cut off, so
open water stays open, and parts that stand before what photos measured. Photos agree because all see the same surface.
"""

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import moved, pixel_rays, unproject
from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular
from sucre_bench.machine.provenance import load
from sucre_bench.programs.prepare.shots import Shot

# side of a voxel, in pixels of a photo at the median depth; a voxel has one point
_VOXEL_PX = 4.0
_LEVELS = 5, 12  # of the octree
_MOST_POINTS = 4_000_000  # before they are reduced to one a voxel
# a point is an outlier if it is farther from its neighbours, in standard deviations
_NEIGHBOURS = 20
_SPREAD = 2.0
# a larger relative difference of neighbouring depths is an edge, which has no normal
_SMOOTH = 0.02
# relative: the surface hides what a photo measured, or is what it measured
_IN_FRONT = 0.03
_ON = 0.01
_ROWS = 256  # that rays are cast for at a time


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles."""

    vertices: Array
    """(V, 3) float64 in the world."""

    triangles: npt.NDArray[np.int64]
    """(T, 3), indices of their vertices."""

    gaps: Array
    """(V,), distance of each vertex from the nearest measured point, 0 if unknown."""

    def caster(self) -> Callable[..., tuple[Array, npt.NDArray[np.int64]]]:
        """Return the function that gives a shot's planar depth (H, W) float32, 0 = none, and triangles (H, W).

        Its second argument, (P, 2) pixels x, y, gives these alone: (1, P).
        """
        o3d = load("prepare", "open3d")
        tensor = o3d.core.Tensor
        scene = o3d.t.geometry.RaycastingScene()
        middle = np.median(self.vertices, axis=0)  # rays are float32
        around = (self.vertices - middle).astype(np.float32)
        scene.add_triangles(tensor(around), tensor(self.triangles.astype(np.uint32)))

        def cast(shot: Shot, at: Array | None = None) -> tuple[Array, npt.NDArray[np.int64]]:
            # Along rays of unit depth, the distance to the hit is the planar depth.
            if at is None:
                rays = pixel_rays(shot.camera)
            else:
                rays = unproject(
                    shot.camera, at[:, 0], at[:, 1], np.ones(len(at), np.float32)
                ).T[None]
            rays = rays @ shot.cam_from_world[:3, :3].astype(np.float32)
            depth, triangle = (
                np.zeros(rays.shape[:2], np.float32),
                np.zeros(rays.shape[:2], np.int64),
            )
            for top in range(0, len(rays), _ROWS):
                block = rays[top : top + _ROWS]
                origin = np.broadcast_to((shot.centre - middle).astype(np.float32), block.shape)
                hit = scene.cast_rays(tensor(np.concatenate([origin, block], axis=-1)))
                at = hit["t_hit"].numpy()
                depth[top : top + _ROWS] = np.where(np.isfinite(at), at, 0)
                triangle[top : top + _ROWS] = np.where(
                    np.isfinite(at), hit["primitive_ids"].numpy(), 0
                )
            return depth, triangle

        return cast


def read_mesh(path: Path) -> Surface:
    """Return the triangles of a .ply, .obj, .glb, .stl or .off file. Raises InputError if it holds none."""
    regular(path, "give a mesh: .ply, .obj or .glb")
    o3d = load("prepare", "open3d")
    with (
        tempfile.TemporaryDirectory() as folder,
        o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error),
    ):
        content = path.read_bytes() if path.suffix.lower() == ".glb" else b""
        if content and len(content) == int.from_bytes(content[12:16], "little") + 20:
            # Without a second part, as Open3D writes it and does not read it: as .gltf it does.
            path_read = Path(folder) / "mesh.gltf"
            path_read.write_bytes(content[20:])
        else:
            path_read = path
        mesh = o3d.io.read_triangle_mesh(str(path_read))
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    if not len(triangles) or not np.isfinite(vertices).all():
        raise InputError(
            "holds no triangles that can be read", path, "export the mesh as .ply, .obj or .glb"
        )
    return Surface(vertices, triangles, np.zeros(len(vertices)))


def fused(shots: Sequence[Shot], depth_of: Callable[[int], Array], widest: float) -> Surface:
    """Return the surface of all depth maps; a place without extent if they hold too few points.

    depth_of: the measured depth map (H, W) of a shot by its index, 0 = unknown; widest: largest distance from a
    measured point, as a share of that from the nearest camera.
    """
    from scipy.spatial import cKDTree

    o3d = load("prepare", "open3d")
    footprint = np.median(
        [np.median(s.seen_points()[1]) / s.camera.K[0, 0] for s in shots if len(s.points)]
    )
    cloud = _points(shots, depth_of, _VOXEL_PX * footprint, o3d)
    if cloud is None:
        return Surface(np.zeros((3, 3)), np.zeros((1, 3), np.int64), np.zeros(3))
    middle = cloud.get_center()
    cloud.translate(-middle)
    side = float(np.max(cloud.get_max_bound() - cloud.get_min_bound()))
    level = int(np.clip(np.ceil(np.log2(side / (_VOXEL_PX * footprint))), *_LEVELS))
    with o3d.utility.VerbosityContextManager(o3d.utility.VerbosityLevel.Error):
        mesh, _ = o3d.geometry.TriangleMesh.create_from_point_cloud_poisson(
            cloud,
            depth=level,
            scale=1.05,
            linear_fit=True,
            n_threads=1,  # several threads make another surface each time
        )
    vertices, triangles = np.asarray(mesh.vertices), np.asarray(mesh.triangles)
    gaps = cKDTree(np.asarray(cloud.points)).query(vertices)[0]
    centres = np.array([shot.centre for shot in shots]) - middle
    near = gaps <= widest * cKDTree(centres).query(vertices)[0]
    surface = Surface(vertices + middle, triangles[near[triangles].all(axis=1)], gaps)
    return _carved(surface, shots, depth_of)


def _points(
    shots: Sequence[Shot], depth_of: Callable[[int], Array], voxel: float, o3d: Any
) -> Any:
    """The measured points of all photos with normals, one a voxel, without outliers; None if there are too few."""
    cloud = o3d.geometry.PointCloud()
    for i, shot in enumerate(shots):
        points, normals = _with_normals(shot, depth_of(i))
        one = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points))
        one.normals = o3d.utility.Vector3dVector(normals)
        cloud += one
        if len(cloud.points) > _MOST_POINTS or shot is shots[-1]:
            cloud = cloud.voxel_down_sample(voxel)
    if len(cloud.points) <= _NEIGHBOURS:
        return None
    return cloud.remove_statistical_outlier(_NEIGHBOURS, _SPREAD)[0]


def _with_normals(shot: Shot, depth: Array) -> tuple[Array, Array]:
    """Every second pixel's point and unit normal, each (P, 3) in the world, where its neighbours go on smoothly."""
    points = pixel_rays(shot.camera).astype(np.float64) * depth[..., None]
    inner = np.s_[1:-1:2, 1:-1:2]
    left, right = np.s_[1:-1:2, :-2:2], np.s_[1:-1:2, 2::2]
    above, below = np.s_[:-2:2, 1:-1:2], np.s_[2::2, 1:-1:2]
    around = np.stack([depth[side] for side in (left, right, above, below)])
    smooth = (depth[inner] > 0) & (np.abs(around - depth[inner]) < _SMOOTH * depth[inner]).all(
        axis=0
    )
    normals = np.cross(
        (points[below] - points[above])[smooth], (points[right] - points[left])[smooth]
    )
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    turn = shot.cam_from_world[:3, :3]
    return moved(points[inner][smooth], np.linalg.inv(shot.cam_from_world)), normals @ turn


def _carved(
    surface: Surface, shots: Sequence[Shot], depth_of: Callable[[int], Array]
) -> Surface:
    """The surface without the triangles that hide what more photos measured behind them than confirm them."""
    cast = surface.caster()
    corners = surface.triangles.T
    votes = np.zeros(len(surface.triangles))
    for i, shot in enumerate(shots):
        (depth, triangle), measured = cast(shot), depth_of(i)
        both = (depth > 0) & (measured > 0)
        nearer = 1 - depth[both] / measured[both]
        vote = np.where(nearer > _IN_FRONT, -1, nearer > -_ON)
        votes += np.bincount(triangle[both], vote, len(votes))
    # One pixel does not decide: neighbours vote, too.
    around = np.sum(
        [np.bincount(corner, votes, len(surface.vertices)) for corner in corners], axis=0
    )
    kept = np.sum([around[corner] for corner in corners], axis=0) >= 0
    return Surface(surface.vertices, surface.triangles[kept], surface.gaps)
