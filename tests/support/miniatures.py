"""Datasets in miniature; most are two photographs of one point: a spot in each image, a disk in each depth map."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import tifffile
from scipy.spatial.transform import Rotation

from sucre_bench.camera import Camera, project, relative_pose, unproject
from sucre_bench.errors import InputError
from sucre_bench.scene import Scene, View
from support.colmap_folder import picture, to_binary, write_image, write_model

WIDTH = 160
HEIGHT = 120
FAR = 9.0  # depth around the disk
# of the world; off every axis, so that a distance is no depth
POINT = np.array([0.7, -0.4, 5.0])
# centre; turn about x, y, z
BOTH = (
    ((-0.8, -0.2, -0.1), (0.05, -0.04, 0.6)),
    ((1.5, -0.1, 0.7), (-0.05, 0.1, -0.3)),
)


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
    assert cv2.imwrite(
        str(path), np.repeat(np.rint(spot)[..., None], 3, axis=-1).astype(np.uint8)
    )


def disk_depth(
    at: np.ndarray, depth: float, size: tuple[int, int] = (WIDTH, HEIGHT)
) -> np.ndarray:
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


def check_both(
    a: View, b: View, tolerance: float = 0.1, point: np.ndarray | None = POINT
) -> None:
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
        np.testing.assert_allclose(
            project(camera_b, carried[:3])[0], centre(other.rgb), atol=2 * tolerance
        )


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


def loader(dataset: Callable[..., Any]) -> Callable[..., Scene]:
    """Return what opens a dataset that has one scene: of its root and its options."""

    def load(root: Path, **options: object) -> Scene:
        (scene,) = dataset(root=root, **options).scenes()
        return scene

    return load


def cut(path: Path) -> None:
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])


def check_view_fault(bad: View, good: View, plane: str, root: Path, parts: list[str]) -> None:
    """A plane of one view raises one line about a file below root, that of another view is there."""
    assert getattr(good, plane).shape[:2] == (good.camera.height, good.camera.width)
    with one_line(str(root), *parts):
        getattr(bad, plane)


Change = Callable[[Path], object]
Load = Callable[[Path], Scene]
Test = Callable[[Path, Any], None]


def scene_fault_test(
    write: Change, load: Load, cases: Mapping[str, tuple[Change, list[str]]]
) -> Test:
    """A test of changes to the files of a dataset: opening it raises one line about one of them, with these parts."""

    @pytest.mark.parametrize("case", cases.values(), ids=list(cases))
    def test(tmp_path: Path, case: tuple[Change, list[str]]) -> None:
        change, parts = case
        write(tmp_path)
        change(tmp_path)
        with one_line(str(tmp_path), *parts):
            load(tmp_path)

    return test


def view_fault_test(
    write: Change, load: Load, cases: Mapping[str, tuple[str, Change, list[str]]]
) -> Test:
    """A test of changes to the files of the first of two views: a plane of it raises, that of the other is there."""

    @pytest.mark.parametrize("case", cases.values(), ids=list(cases))
    def test(tmp_path: Path, case: tuple[str, Change, list[str]]) -> None:
        plane, change, parts = case
        write(tmp_path)
        change(tmp_path)
        check_view_fault(*load(tmp_path), plane, tmp_path, parts)

    return test


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
    return cv2.projectPoints(
        seen(world_from_cam, POINT)[None], np.zeros(3), np.zeros(3), K, BENT
    )[0].ravel()


def write_photographs(
    places: list[Path], sparse: Path, names: tuple[str, str], units: float = 1.0
) -> None:
    """Write the photographs in `places`, and the model that calls them `names`."""
    poses = [pose_of(*one) for one in BOTH]
    for pose, place in zip(poses, places, strict=True):
        write_spot(place, photographed(pose))
    write_model(
        sparse,
        [(n, model_pose(pose, units), 1) for n, pose in zip(names, poses, strict=True)],
        [CAMERA],
    )


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


def write_images(folder: Path, *names: str, seed: int = 0) -> Path:
    for number, name in enumerate(names):
        write_image(folder / name, picture(seed + number))
    return folder


YEAR = ("20150412T093000.png", "20150412T093005.png")


def write_year(root: Path, year: str = "2015", names: tuple[str, str] = YEAR) -> Path:
    place = root / year
    write_photographs([place / "images" / name for name in names], place / "sfm", names)
    return root


REEF = ("MTN_1.png", "MTN_2.png")


def write_reef(
    place: Path, images: str = "images_wb", sparse: str = "sparse/0", units: float = 1.0
) -> Path:
    write_photographs([place / images / name for name in REEF], place / sparse, REEF, units)
    to_binary(place / sparse)
    return place


SET_SIZE = (60, 40)  # width, height


def picture16(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (*SET_SIZE[::-1], 3), dtype=np.uint16)


def write_set(
    place: Path, stems: tuple[str, ...] = ("T_S01", "T_S02"), folder: str = "depth"
) -> Path:
    """Images, and depth maps at half their size: 2 m, and 3 m + 1 m a row in the right half."""
    width, height = (side // 2 for side in SET_SIZE)
    for seed, stem in enumerate(stems):
        write_image(place / "linearPNG" / f"{stem}.png", picture16(seed))
        depth = np.full((height, width), 2, np.float32)
        depth[:, width // 2 :] = 3 + np.arange(height)[:, None]
        depth[0, 0] = 0
        (place / folder).mkdir(exist_ok=True)
        tifffile.imwrite(place / folder / f"depth{stem}.tif", depth)
    return place


SCALE = 2.5  # metres in a unit of the chunk
TURN = pose_of((0, 0, 0), (0.4, -1.1, 0.7))[:3, :3]
TRANSFORM = (
    f"<transform><rotation>{' '.join(map(repr, TURN.ravel().tolist()))}</rotation>"
    f"<translation>4.1e6 -3.2e6 2.9e6</translation><scale>{SCALE}</scale></transform>"
)
INNER = {"f": 150.0, "cx": 4.0, "cy": -2.5}
LENSES: dict[str, dict[str, float]] = {
    "pinhole": {},
    "usual": {"k1": -0.5, "k2": 0.05, "k3": -0.01, "p1": 0.012, "p2": -0.004, "b1": 6.0},
    "every term": {
        "k1": -0.5,
        "k4": 12.0,
        "p1": 0.02,
        "p2": 0.03,
        "p3": 3.0,
        "p4": 20.0,
        "b1": 5.0,
        "b2": 9.0,
    },
    "fisheye": {"k1": 0.02, "k2": -0.03, "k4": 0.002},
    "fisheye with every term": {"k1": 0.02, "k3": 0.01, "p1": 0.008, "p2": -0.006, "b2": -4.0},
}


def imaged(point: np.ndarray, lens: str) -> np.ndarray:
    """Where the sensor images a point of the camera's frame (manual, appendix "Camera models"): centres at +0.5."""
    c = {
        **dict.fromkeys(("k1", "k2", "k3", "k4", "p1", "p2", "p3", "p4", "b1", "b2"), 0.0),
        **INNER,
        **LENSES[lens],
    }
    x, y = point[:2] / point[2]
    if "fisheye" in lens:
        r = np.hypot(x, y)
        x, y = x * np.arctan(r) / r, y * np.arctan(r) / r
    r2 = x * x + y * y
    radial = 1 + c["k1"] * r2 + c["k2"] * r2**2 + c["k3"] * r2**3 + c["k4"] * r2**4
    more = 1 + c["p3"] * r2 + c["p4"] * r2**2
    xd = x * radial + (c["p1"] * (r2 + 2 * x * x) + 2 * c["p2"] * x * y) * more
    yd = y * radial + (c["p2"] * (r2 + 2 * y * y) + 2 * c["p1"] * x * y) * more
    u = WIDTH / 2 + c["cx"] + xd * c["f"] + xd * c["b1"] + yd * c["b2"]
    return np.array([u, HEIGHT / 2 + c["cy"] + yd * c["f"]])


def undistorted(point: np.ndarray, lens: str) -> np.ndarray:
    """Where the sensor would image it without distortion."""
    x, y = point[:2] / point[2]
    f, b1 = INNER["f"], LENSES[lens].get("b1", 0.0)
    return np.array([(f + b1) * x + WIDTH / 2 + INNER["cx"], f * y + HEIGHT / 2 + INNER["cy"]])


def chunk_xml(
    lens: str, cameras: str, transform: str = TRANSFORM, frames: str = "", sensors: str = ""
) -> str:
    terms = "".join(
        f"<{name}>{value!r}</{name}>" for name, value in {**INNER, **LENSES[lens]}.items()
    )
    kind = "fisheye" if "fisheye" in lens else "frame"
    size = f'<resolution width="{WIDTH}" height="{HEIGHT}"/>'
    return (
        f'<chunk label="Dive 1" enabled="true"><sensors next_id="2"><sensor id="0" label="GoPro" type="{kind}">{size}'
        f'<calibration type="{kind}" class="initial">{size}<f>99</f></calibration>'
        f'<calibration type="{kind}" class="adjusted">{size}{terms}</calibration></sensor>{sensors}</sensors>'
        f'<components active_id="0"><component id="0" label="Component 1">{transform}</component></components>'
        f"<cameras>{cameras}</cameras>{frames}</chunk>"
    )


def camera_xml(number: int, label: str, more: str = "", posed: bool = True) -> str:
    pose = " ".join(map(repr, pose_of(*BOTH[number]).ravel().tolist()))
    inside = f"<transform>{pose}</transform>" if posed else ""
    return f'<camera id="{number}" sensor_id="0" component_id="0" label="{label}" {more}>{inside}</camera>'


CAMERAS = camera_xml(0, "DSC_0.JPG") + camera_xml(1, "DSC_1")
OTHERS = (
    '<camera id="7" sensor_id="0" label="not aligned"/><camera id="8"><property name="no camera"/></camera>'
    + camera_xml(1, "switched off", 'enabled="false"').replace('id="1"', 'id="9"')
)


def write_survey(
    root: Path, lens: str = "usual", unit: float = SCALE, cameras: str = CAMERAS + OTHERS
) -> Path:
    """Photographs of the point and Metashape's own depth maps; unit: of theirs, in the chunk's."""
    for number in range(2):
        point = seen(pose_of(*BOTH[number]))
        write_spot(root / f"images/DSC_{number}.png", imaged(point, lens))
        (root / "depths").mkdir(exist_ok=True)
        depth = disk_depth(
            undistorted(point, lens) / 2, unit * point[2], (WIDTH // 2, HEIGHT // 2)
        )
        tifffile.imwrite(root / f"depths/DSC_{number}.tif", depth)
    (root / "cameras.xml").write_text(
        f'<document version="2.0.0">{chunk_xml(lens, cameras)}</document>'
    )
    return root
