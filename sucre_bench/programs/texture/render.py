"""Renders coloured surfaces side by side, seen from behind and above one of the cameras (the paper's texture figure).

Rays are cast into the triangles on the CPU (Open3D's ray casting); no graphics driver is needed.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Picture
from sucre_bench.camera import Camera, unproject
from sucre_bench.engine.reopen_results import Frame
from sucre_bench.errors import InputError
from sucre_bench.imaging.drawing import captioned
from sucre_bench.programs.texture.surface import Model

_SIZE = (960, 720)  # size of a picture in pixels
_FOCAL = 0.8  # focal length by width: 64 degrees
_FINER = 2  # rays a pixel, along each side
_BACK, _ABOVE = 0.35, 0.3  # the viewpoint, in units of the distance to the surface


def side_by_side(models: Mapping[str, Model], frames: Sequence[Frame]) -> Picture:
    """Return the surfaces next to each other with their names, (720, n * 960, 3) uint8 RGB, on white.

    Raises InputError if no view has depth.
    """
    camera, pose = vantage(frames)
    return np.hstack([captioned(rendered(model, camera, pose), name) for name, model in models.items()])


def vantage(frames: Sequence[Frame]) -> tuple[Camera, Array]:
    """Return a camera behind and above the middle view's, aimed at the same surface, and its cam_from_world."""
    by_distance = sorted(range(len(frames)), key=lambda k: abs(k - len(frames) // 2))
    for k in by_distance:
        view = frames[k].view
        if view.camera is not None and view.cam_from_world is not None and view.has_depth and view.valid.any():
            break
    else:
        raise InputError("texture: no view has camera, pose and depth; leave --picture out")
    row, column = np.nonzero(view.valid)
    points = unproject(view.camera, column + 0.5, row + 0.5, view.depth[row, column])
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
    return Camera(K, wide, high), turn @ view.cam_from_world


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
