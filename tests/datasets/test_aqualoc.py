"""The aqualoc dataset against miniatures of its layout, its lens against OpenCV's fisheye projection."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support.miniatures import (
    BOTH,
    HEIGHT,
    POINT,
    WIDTH,
    camera_and_pose,
    centre,
    loader,
    one_line,
    pose_of,
    seen,
    write_spot,
)

from sucre_bench.camera import project
from sucre_bench.datasets.aqualoc import Aqualoc
from sucre_bench.errors import InputError

# of Kalibr: pixel centres at whole numbers
K = np.array([[110.0, 0, 82.5], [0, 112, 56.5], [0, 0, 1]])
BENT = np.array([-0.06, -0.004, 0.027, -0.03])
CALIBRATION = f"""cam0:
  camera_model: pinhole
  distortion_coeffs: {BENT.tolist()}
  distortion_model: equidistant
  intrinsics: [110.0, 112.0, 82.5, 56.5]
  resolution: [{WIDTH}, {HEIGHT}]
  rostopic: /camera/image_raw
"""


def spot(world_from_cam: np.ndarray) -> np.ndarray:
    points = seen(world_from_cam)[None, None]
    return cv2.fisheye.projectPoints(points, np.zeros(3), np.zeros(3), K, BENT)[0].ravel() + 0.5


def write_site(
    root: Path,
    site: str = "harbor",
    folder: str = "harbor_images_sequence_07",
    trajectory: str = "07",
) -> Path:
    """Frames 5 and 12 with poses, 20 without; an older trajectory whose scale is wrong."""
    frames = root / "raw_data" / folder
    lines = ["# img_nb tx ty tz qx qy qz qw"]
    for frame, one in zip((5, 12), BOTH, strict=True):
        pose = pose_of(*one)
        write_spot(frames / f"frame{frame:06d}.png", spot(pose))
        lines.append(
            " ".join(
                map(str, [frame, *pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()])
            )
        )
    write_spot(frames / "frame000020.png", np.array([3.0, 4.0]))
    (root / f"{site}_calibration_files").mkdir(exist_ok=True)
    (root / f"{site}_calibration_files" / f"{site}_camera_calib.yaml").write_text(CALIBRATION)
    truth = root / f"{site}_groundtruth_files"
    truth.mkdir(exist_ok=True)
    (truth / f"new_{site}_colmap_traj_sequence_{trajectory}.txt").write_text("\n".join(lines))
    (truth / f"{site}_colmap_traj_sequence_{trajectory}.txt").write_text("5 9 9 9 0 0 0 1")
    return root


load = loader(Aqualoc)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_known_point_is_seen_where_it_is_in_undistorted_frames(
    tmp_path: Path, scale: float
) -> None:
    scene = load(write_site(tmp_path), image_scale=scale)
    assert (scene.name, scene.has) == ("harbor_07", {"poses"})
    assert [view.name for view in scene] == [
        "frame000005.png",
        "frame000012.png",
        "frame000020.png",
    ]
    for view, one in zip(scene.views[:2], BOTH, strict=True):
        camera, pose = camera_and_pose(view)
        np.testing.assert_allclose(
            centre(view.rgb), project(camera, pose[:3, :3] @ POINT + pose[:3, 3])[0], atol=0.1
        )
        np.testing.assert_allclose(np.linalg.inv(pose)[:3, 3], one[0], atol=1e-12)
        assert np.abs(centre(view.rgb) / scale - spot(pose_of(*one))).max() > 0.5, (
            "it lies elsewhere in the frame"
        )
    assert scene.views[2].camera is not None
    assert scene.views[2].cam_from_world is None


def test_sequences_of_both_sites_are_scenes_of_their_own(tmp_path: Path) -> None:
    write_site(tmp_path / "Harbor_sites_sequences")
    write_site(tmp_path / "Archaeological_site_sequences", "archaeo", "images_sequence_7", "07")
    scenes = list(Aqualoc(tmp_path).scenes())
    assert [scene.name for scene in scenes] == ["archaeo_07", "harbor_07"]
    write_site(tmp_path / "again")
    with pytest.raises(InputError, match="sequence harbor_07 is also"):
        list(Aqualoc(tmp_path).scenes())


def test_without_a_trajectory_there_are_no_poses(tmp_path: Path) -> None:
    write_site(tmp_path)
    truth = tmp_path / "harbor_groundtruth_files"
    (truth / "new_harbor_colmap_traj_sequence_07.txt").unlink()
    (old,) = truth.iterdir()
    _, pose = camera_and_pose(load(tmp_path).views[0])
    np.testing.assert_allclose(-pose[:3, 3], [9, 9, 9])
    old.unlink()
    scene = load(tmp_path)
    assert scene.has == frozenset()
    assert all(view.camera is not None and view.cam_from_world is None for view in scene)


@pytest.mark.parametrize(
    ("line", "part"),
    [
        ("12 1 2 3 0 0 0", "line 2"),
        ("12 1 2 3 0 0 1 1", "line 2"),
        ("12 1 2 nan 0 0 0 1", "line 2"),
        ("", "holds"),
        ("99 1 2 3 0 0 0 1", "frames, 99"),
    ],
)
def test_a_wrong_trajectory_is_named_by_line(tmp_path: Path, line: str, part: str) -> None:
    path = (
        write_site(tmp_path)
        / "harbor_groundtruth_files"
        / "new_harbor_colmap_traj_sequence_07.txt"
    )
    path.write_text(f"# a comment\n{line}\n")
    with one_line(str(path), part):
        load(tmp_path)
