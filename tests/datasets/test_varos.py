"""The varos dataset against miniatures of its layout, with a camera and poses worked out by hand."""

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.colmap_folder import picture, write_image
from support.miniatures import loader

from sucre_bench.arrays import Array
from sucre_bench.camera import project
from sucre_bench.datasets.varos import Varos
from sucre_bench.errors import InputError
from sucre_bench.scene import View

WIDTH = 32
HEIGHT = 18
CAMERA = "focal_length: 30.0\nsensor_width: 32.0\nsensor_height: 24.0\nresolution:\n  width: 32\n  height: 18\n"
HEADER = "# timestamp [ns],r11,r12,r13,s_x_vw [m],r21,r22,r23,s_y_vw [m],r31,r32,r33,s_z_vw [m]"
POSE_FILE = "camM0_poses/camM0_poses_transformation_matrix.csv"
# Camera to world, looking along +z. Frame 7: at the origin. Frame 8: at (5, 0, 10), looking along the world's -x.
POSES = {7: "1,0,0,0, 0,1,0,0, 0,0,1,0", 8: "0,0,-1,5, 0,1,0,0, 1,0,0,10"}


def metres(value: float) -> int:
    return round(value / 25 * 65535)


def write_dive(cam: Path, camera: str = CAMERA, sub: str = "") -> Path:
    """Two frames whose only near depth is at the point above."""
    marks = {7: (19, 12), 8: (16, 16)}  # column, row: 30 x / z + 16, 30 y / z + 9
    for frame, depth in ((7, 10.0), (8, 4.0)):
        for plane in "AB":
            shown = picture(frame + (plane == "B"), WIDTH, HEIGHT)
            write_image(cam / plane / sub / f"seq01_veh0_camM0_{plane}-{frame:08d}.png", shown)
        values = np.full((HEIGHT, WIDTH), 65535, np.uint16)
        values[3, 5] = metres(20.0)
        column, row = marks[frame]
        values[row, column] = metres(depth)
        write_image(cam / "D" / sub / f"seq01_veh0_camM0_D-{frame:08d}.png", values)
    (cam / "camM0.yaml").write_text(camera)
    (cam / "camM0_timestamps.csv").write_text(
        "#timestamp [ns],A,B,C,D\n"
        + "".join(
            f"{100_000_000 * frame},{','.join(f'seq01_veh0_camM0_{p}-{frame:08d}.png' for p in 'ABCD')}\n"
            for frame in (7, 8)
        )
    )
    rows = "".join(f"{100_000_000 * frame + 4_999_936},{POSES[frame]}\n" for frame in (8, 7))
    (cam / "camM0_poses").mkdir()
    (cam / POSE_FILE).write_text(f"{HEADER}\n{rows}")
    return cam


# In front of both: 10 m before frame 7, 4 m before frame 8.
WORLD = [1.0, 1.0, 10.0, 1.0]


load = loader(Varos)


def seen(view: View) -> tuple[Array, float]:
    pixel, depth = project(view.camera, (view.cam_from_world @ WORLD)[:3])
    return pixel, float(depth)


def test_a_world_point_falls_on_its_mark_at_its_depth_in_both_views(tmp_path: Path) -> None:
    cam = write_dive(tmp_path / "2021-08-17_SEQ1" / "vehicle0" / "cam0")
    scene = load(tmp_path)
    assert scene.name == "2021-08-17_SEQ1_vehicle0_cam0"
    assert [view.name for view in scene] == [
        f"seq01_veh0_camM0_A-0000000{frame}.png" for frame in (7, 8)
    ]
    assert scene.has == {"poses", "depth", "reference"}
    for view, pixel, depth in zip(
        scene, ((19.0, 12.0), (16.0, 16.5)), (10.0, 4.0), strict=True
    ):
        at, z = seen(view)
        assert at == pytest.approx(pixel)
        assert z == pytest.approx(depth)
        assert view.depth[int(at[1]), int(at[0])] == pytest.approx(depth, abs=25 / 65535), (
            "the mark is there"
        )
    assert scene.views[0].depth[3, 5] == pytest.approx(20.0, abs=25 / 65535)
    assert scene.views[0].depth[0, 0] == 0, "25 m and more is unknown"
    assert scene.views[0].distance[3, 5] > 20.5
    reference = scene.views[0].reference
    np.testing.assert_array_equal(np.rint(reference * 255), picture(8, WIDTH, HEIGHT))
    np.testing.assert_array_equal(np.rint(scene.views[0].rgb * 255), picture(7, WIDTH, HEIGHT))
    assert load(cam).data_id == scene.data_id


def test_folders_of_ones_own_are_found_with_the_camera_above_them(tmp_path: Path) -> None:
    write_dive(
        tmp_path / "cam0",
        "%YAML:1.0\n---\nfocal_length: 30\nsensor_width: 32\nresolution: [32, 18]\n",
        sub="train",
    )
    for sub in ("val", "test"):
        write_image(
            tmp_path / "cam0" / sub / "A" / "frame-00000008.png", picture(1, WIDTH, HEIGHT)
        )
    inner = load(tmp_path / "cam0")
    assert inner.views[0].name == "train/seq01_veh0_camM0_A-00000007.png"
    assert seen(inner.views[1])[0] == pytest.approx([16, 16.5])
    for plane in "ABD":
        shutil.rmtree(tmp_path / "cam0" / plane)
    test, val = Varos(tmp_path / "cam0").scenes()
    assert (test.name, val.name, sorted(test.has)) == ("test", "val", ["poses"])
    assert seen(val.views[0])[1] == pytest.approx(4.0)


def test_times_without_file_names_go_by_order_or_are_refused(tmp_path: Path) -> None:
    cam = write_dive(tmp_path / "cam0")
    (cam / "camM0_timestamps.csv").write_text("700000000\n800000000\n")
    assert seen(load(cam).views[1])[1] == pytest.approx(4.0)
    (cam / "camM0_timestamps.csv").write_text("600000000\n700000000\n800000000\n")
    with pytest.raises(InputError, match=r"camM0_timestamps\.csv: 3 times .* for 2 images"):
        load(cam)


def test_a_frame_without_a_pose_of_its_time_has_none(tmp_path: Path) -> None:
    cam = write_dive(tmp_path / "cam0")
    (cam / POSE_FILE).write_text(f"{HEADER}\n700000000,{POSES[7]}\n")
    scene = load(cam)
    assert [view.cam_from_world is None for view in scene] == [False, True]


def test_what_is_wrong_with_one_view_leaves_the_other_alone(tmp_path: Path) -> None:
    cam = write_dive(tmp_path / "cam0")
    b, d = (sorted((cam / plane).iterdir()) for plane in "BD")
    b[0].unlink()
    assert cv2.imwrite(str(d[0]), np.full((HEIGHT, WIDTH), 9, np.uint8))
    first, second = load(cam)
    with pytest.raises(InputError, match=r"frame 7\b"):
        _ = first.reference
    with pytest.raises(InputError, match=r"uint8 .*18x32.*16-bit"):
        _ = first.depth
    assert second.reference is not None


def test_a_pose_that_is_no_rotation_is_named_by_row(tmp_path: Path) -> None:
    cam = write_dive(tmp_path / "cam0")
    (cam / POSE_FILE).write_text(
        f"{HEADER}\n700000000,{POSES[7]}\n800000000,0,0,-1,5, 0,1,0,0, 2,0,0,10\n"
    )
    with pytest.raises(InputError, match=r"row 3 .*rotation"):
        load(cam)
