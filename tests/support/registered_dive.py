"""Two photographs of one point through a lens that bends, in a COLMAP model, as datasets of dives publish them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import tifffile
from scipy.spatial.transform import Rotation

from sucre_bench.camera import project
from sucre_bench.scene import Scene
from support.colmap_folder import write_model
from support.spots import BOTH, HEIGHT, POINT, WIDTH, camera_and_pose, check_both, disk_depth, pose_of, seen, write_spot

K = np.array([[150.0, 0, 83], [0, 150, 57], [0, 0, 1]])
BENT = np.array([-0.3, 0.1, 0.0, 0.0])
CAMERA = f"1 RADIAL {WIDTH} {HEIGHT} 150 83 57 -0.3 0.1"


def model_pose(world_from_cam: np.ndarray, units: float = 1.0) -> tuple[float, ...]:
    """qw qx qy qz tx ty tz, world to camera, in a model whose unit is `units` metres."""
    cam_from_world = np.linalg.inv(world_from_cam)
    x, y, z, w = Rotation.from_matrix(cam_from_world[:3, :3]).as_quat()
    return tuple(float(v) for v in (w, x, y, z, *cam_from_world[:3, 3] / units))


def photographed(world_from_cam: np.ndarray) -> np.ndarray:
    """Where POINT is in a photograph: OpenCV's own projection."""
    return cv2.projectPoints(seen(world_from_cam, POINT)[None], np.zeros(3), np.zeros(3), K, BENT)[0].ravel()


def write_photographs(places: list[Path], sparse: Path, names: tuple[str, str], units: float = 1.0) -> None:
    """Write the photographs in `places`, and the model that calls them `names`."""
    poses = [pose_of(*one) for one in BOTH]
    for pose, place in zip(poses, places, strict=True):
        write_spot(place, photographed(pose))
    write_model(sparse, [(n, model_pose(pose, units), 1) for n, pose in zip(names, poses, strict=True)], [CAMERA])


def write_depths(folder: Path, scene: Scene) -> None:
    """Write a depth map for each of a scene's views, at the view's size: the point's own depth where it is seen."""
    for view in scene:
        camera, pose = camera_and_pose(view)
        at, depth = project(camera, pose[:3, :3] @ POINT + pose[:3, 3])
        path = folder / Path(view.name).parent / f"depth_{Path(view.name).stem}.tif"
        path.parent.mkdir(parents=True, exist_ok=True)
        tifffile.imwrite(path, disk_depth(at, float(depth), (camera.width, camera.height)))


def check_dive(load: Callable[..., Scene], depths: Path) -> None:
    """Its views see the point where it is, undistorted, at full and at half size."""
    without = load()
    assert without.has == {"poses"}
    write_depths(depths, without)
    scene = load()
    assert scene.has == {"poses", "depth"}
    assert scene.data_id != without.data_id
    check_both(*scene)
    moved = np.abs(project(*_first(scene))[0] - photographed(pose_of(*BOTH[0]))).max()
    assert moved > 1, "the lens bends by more than what is tolerated"
    half = load(image_scale=0.5)
    assert half.views[0].rgb.shape == (HEIGHT // 2, WIDTH // 2, 3)
    check_both(*half, tolerance=0.2)
    assert len({scene.data_id, half.data_id}) == 2


def _first(scene: Scene) -> tuple:
    camera, pose = camera_and_pose(scene.views[0])
    return camera, pose[:3, :3] @ POINT + pose[:3, 3]
