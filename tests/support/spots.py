"""Two photographs of one point, as any export is to describe them: a spot in each image, a disk in each depth map."""

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from scipy.spatial.transform import Rotation

from sucre_bench.camera import Camera, project, relative_pose, unproject
from sucre_bench.errors import InputError
from sucre_bench.scene import Scene, View
from support.colmap_folder import write_model

WIDTH, HEIGHT = 160, 120
FAR = 9.0  # depth around the disk
POINT = np.array([0.7, -0.4, 5.0])  # of the world; off every axis, so that a distance is no depth
BOTH = ((-0.8, -0.2, -0.1), (0.05, -0.04, 0.6)), ((1.5, -0.1, 0.7), (-0.05, 0.1, -0.3))  # centre; turn about x, y, z


def pose_of(centre: tuple[float, float, float], turn: tuple[float, float, float]) -> np.ndarray:
    """World-from-camera (4, 4), in the axes x right, y down, z ahead."""
    pose = np.eye(4)
    pose[:3, :3] = cv2.Rodrigues(np.array(turn))[0]
    pose[:3, 3] = centre
    return pose


def seen(pose: np.ndarray, point: np.ndarray = POINT) -> np.ndarray:
    """A world point in the camera's frame."""
    return pose[:3, :3].T @ (point - pose[:3, 3])


def write_spot(path: Path, at: np.ndarray, size: tuple[int, int] = (WIDTH, HEIGHT)) -> None:
    """Write a black image with a soft spot centred at a pixel position (centres at +0.5)."""
    u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    spot = 255 * np.exp(-((u - at[0]) ** 2 + (v - at[1]) ** 2) / (2 * 1.0**2))
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), np.repeat(np.rint(spot)[..., None], 3, axis=-1).astype(np.uint8))


def disk_depth(at: np.ndarray, depth: float, size: tuple[int, int] = (WIDTH, HEIGHT)) -> np.ndarray:
    """A depth map (H, W) float32: `depth` within 2 pixels of a position, FAR elsewhere."""
    u, v = np.meshgrid(np.arange(size[0]) + 0.5, np.arange(size[1]) + 0.5)
    return np.where(np.hypot(u - at[0], v - at[1]) < 2, depth, FAR).astype(np.float32)


def centre(rgb: np.ndarray) -> np.ndarray:
    """The spot's centre of mass, in pixels with centres at +0.5."""
    weight = rgb[..., 1].astype(np.float64)
    v, u = np.indices(weight.shape) + 0.5
    return np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()


def camera_and_pose(view: View) -> tuple[Camera, np.ndarray]:
    assert view.cam_from_world is not None
    assert view.rgb.shape == (view.camera.height, view.camera.width, 3)
    return view.camera, view.cam_from_world


def check_both(a: View, b: View, tolerance: float = 0.1, point: np.ndarray | None = POINT) -> None:
    """The point falls on the spot of each view; each depth there is its; and a's spot, lifted by a's depth, is b's."""
    for one, other in ((a, b), (b, a)):
        (camera, pose), (camera_b, pose_b) = camera_and_pose(one), camera_and_pose(other)
        spot = centre(one.rgb)
        depth = one.depth[int(spot[1]), int(spot[0])]
        if point is not None:
            at, z = project(camera, pose[:3, :3] @ point + pose[:3, 3])
            np.testing.assert_allclose(at, spot, atol=tolerance)
            np.testing.assert_allclose(depth, z, rtol=1e-3)
        lifted = unproject(camera, spot[0], spot[1], np.float64(depth))
        carried = relative_pose(pose_b, pose) @ [*lifted, 1]
        np.testing.assert_allclose(project(camera_b, carried[:3])[0], centre(other.rgb), atol=2 * tolerance)


def check_message(message: str, *parts: str) -> None:
    """One line, "place: fault; remedy", that holds these parts."""
    assert "\n" not in message
    assert ": " in message.split("; ")[0]
    assert "; " in message
    for part in parts:
        assert part in message, message


@contextlib.contextmanager
def one_line(*parts: str) -> Iterator[None]:
    """What is within raises InputError, whose message `check_message` finds right."""
    with pytest.raises(InputError) as fault:
        yield
    check_message(str(fault.value), *parts)


def cut(path: Path, share: float = 0.5) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: int(len(content) * share)])


def check_scene_fault(load: Callable[[], Scene], root: Path, parts: list[str]) -> None:
    """Loading raises one line about a file below root."""
    with one_line(str(root), *parts):
        load()


def check_view_fault(bad: View, good: View, plane: str, root: Path, parts: list[str]) -> None:
    """A plane of one view raises one line about a file below root, that of another view is there."""
    assert getattr(good, plane).shape[:2] == (HEIGHT, WIDTH)
    with one_line(str(root), *parts):
        getattr(bad, plane)


Change = Callable[[Path], object]


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
