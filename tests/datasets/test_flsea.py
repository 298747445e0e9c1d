"""The flsea dataset against miniatures of its layout, its lens against OpenCV's projection."""

from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from support.messages import Lines
from support.miniatures import HEIGHT, WIDTH, centre, disk_depth, loader, one_line, write_spot

from sucre_bench.camera import unproject
from sucre_bench.datasets.flsea import Flsea
from sucre_bench.errors import InputError
from sucre_bench.machine.progress import watched_by

# of Kalibr: pixel centres at whole numbers
K = np.array([[150.0, 0, 82.5], [0, 148, 56.5], [0, 0, 1]])
BENT = np.array([-0.3, 0.1, 0.004, -0.003])
POINT = np.array([1.6, -1.1, 5.0])  # of the camera, in a corner of the image
REPORT = f"""Calibration results
===================
Calibration configuration
=========================

cam0
-----
  Camera model: pinhole
  Focal length: [{K[0, 0]}, {K[1, 1]}]
  Principal point: [{K[0, 2]}, {K[1, 2]}]
  Distortion model: radtan
  Distortion coefficients: [{", ".join(map(str, BENT))}]
  Type: aprilgrid
"""
FRAMES = ("16233051861828957", "16233051862684293")


def spot() -> np.ndarray:
    return cv2.projectPoints(POINT[None], np.zeros(3), np.zeros(3), K, BENT)[0].ravel() + 0.5


def write_dive(root: Path, place: str = "canyons/flatiron/flatiron") -> Path:
    dive = root / place
    (dive / "depth").mkdir(parents=True)
    for frame in FRAMES:
        write_spot(dive / "imgs" / f"{frame}.tiff", spot())
        write_spot(dive / "seaErra" / f"{frame}_SeaErra.tiff", np.array([20.5, 30.5]))
        depth = disk_depth(spot(), POINT[2])
        depth[-1, 0] = 0
        tifffile.imwrite(dive / "depth" / f"{frame}_SeaErra_abs_depth.tif", depth)
    (root / "canyons" / "calibration").mkdir(exist_ok=True, parents=True)
    (root / "canyons" / "calibration" / "seaErra-kalibr-results-imucam.txt").write_text(REPORT)
    return dive


load = loader(Flsea)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_known_point_is_seen_where_it_is_with_its_depth(tmp_path: Path, scale: float) -> None:
    write_dive(tmp_path)
    scene = load(tmp_path, image_scale=scale)
    assert (scene.name, scene.has) == ("canyons_flatiron", {"depth"})
    assert [view.name for view in scene] == [f"{frame}.tiff" for frame in FRAMES]
    view = scene.views[1]
    assert view.cam_from_world is None
    at = centre(view.rgb)
    depth = view.depth[int(at[1]), int(at[0])]
    assert depth == 5.0
    assert view.distance[int(at[1]), int(at[0])] == pytest.approx(
        np.linalg.norm(POINT), rel=2e-3
    )
    np.testing.assert_allclose(
        unproject(view.camera, at[0], at[1], np.float64(depth)), POINT, atol=0.01
    )
    assert np.abs(at / scale - spot()).max() > 1, "it lies elsewhere in the photograph"


def test_a_camchain_in_place_of_the_report_is_the_same_camera(tmp_path: Path) -> None:
    write_dive(tmp_path)
    camchain = tmp_path / "camchain.yaml"
    focal = f"[{K[0, 0]}, {K[1, 1]}, {K[0, 2]}, {K[1, 2]}]"
    camchain.write_text(
        f"cam0:\n  camera_model: pinhole\n  intrinsics: {focal}\n  distortion_model: radtan\n"
        f"  distortion_coeffs: {BENT.tolist()}\n  resolution: [{WIDTH}, {HEIGHT}]\n"
    )
    assert load(tmp_path, calibration=camchain).data_id == load(tmp_path).data_id
    camchain.write_text("cam0: {camera_model: omni, intrinsics: [1, 2, 3, 4]}")
    with pytest.raises(InputError, match=r"camchain\.yaml: .*omni.*none"):
        load(tmp_path, calibration=camchain)


def test_without_undistortion_views_are_as_stored_and_have_no_camera(tmp_path: Path) -> None:
    dive = write_dive(tmp_path)
    for scene in (
        load(tmp_path, undistort=False),
        load(dive),
    ):
        # from the dive, the calibration is not in sight
        view = scene.views[0]
        assert view.camera is None
        np.testing.assert_allclose(centre(view.rgb), spot(), atol=0.02)
        assert view.depth[-1, 0] == 0
        np.testing.assert_array_equal(view.depth == 5, disk_depth(spot(), 5) == 5)


def test_views_without_a_calibration_in_sight_are_said_to_be_distorted(tmp_path: Path) -> None:
    dive, said = write_dive(tmp_path), Lines()
    with watched_by(said):
        load(tmp_path)
        load(dive, undistort=False)
        assert not said.lines
        load(dive)
    assert [text.split(":")[0] for text in said.lines] == [str(dive)]
    assert "distorted" in said.lines[0]


def test_the_nearest_calibration_counts(tmp_path: Path) -> None:
    dive = write_dive(tmp_path)
    near = load(tmp_path).data_id
    (tmp_path / "calibration").mkdir()
    far = "cam0: {camera_model: pinhole, intrinsics: [99, 99, 80, 60], distortion_model: none}"
    (tmp_path / "calibration" / "camchain.yaml").write_text(far)
    assert load(tmp_path).data_id == near
    (dive / "calibration").mkdir()
    (dive / "calibration" / "camchain.yaml").write_text(far)
    assert load(tmp_path).data_id != near


def test_enhanced_images_are_images_and_no_reference(tmp_path: Path) -> None:
    write_dive(tmp_path)
    (view, _) = load(tmp_path, images="seaErra", undistort=False)
    np.testing.assert_allclose(centre(view.rgb), [20.5, 30.5], atol=0.02)
    assert view.depth.max() == 9
    assert view.reference is None


def test_depth_maps_of_other_names_are_named(tmp_path: Path) -> None:
    dive = write_dive(tmp_path)
    maps = [dive / "depth" / f"{frame}_SeaErra_abs_depth.tif" for frame in FRAMES]
    maps[0].rename(dive / "depth" / f"{FRAMES[1]}.tif")
    with pytest.raises(
        InputError, match=rf"{FRAMES[1]}\.tif: {FRAMES[1]}_SeaErra_abs_depth\.tif "
    ):
        _ = load(tmp_path).views[1].depth
    (dive / "depth" / f"{FRAMES[1]}.tif").unlink()
    assert [view.has_depth for view in load(tmp_path)] == [False, True]
    maps[1].rename(dive / "depth" / "other.tif")
    with one_line(f"{FRAMES[0]}_SeaErra_abs_depth.tif"):
        load(tmp_path)
