"""The nerfstudio dataset against scenes written here, with lenses and axes worked out by their published formulas."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.bent_rays import bent
from support.miniatures import (
    BOTH,
    HEIGHT,
    WIDTH,
    Change,
    check_both,
    disk_depth,
    loader,
    pose_of,
    scene_fault_test,
    seen,
    view_fault_test,
    write_spot,
)

from sucre_bench.datasets.nerfstudio import Nerfstudio

INTRINSICS = {"fl_x": 150.0, "fl_y": 140.0, "cx": 83.0, "cy": 57.5}
LENSES: dict[str, dict[str, Any]] = {
    "pinhole": {"camera_model": "PINHOLE"},
    "perspective": {
        "camera_model": "OPENCV",
        "k1": -0.5,
        "k2": 0.15,
        "p1": 0.004,
        "p2": -0.006,
    },
    "four radial terms": {
        "camera_model": "OPENCV",
        "k1": -0.12,
        "k2": 0.03,
        "k3": -0.02,
        "k4": 0.02,
    },
    "fisheye": {
        "camera_model": "OPENCV_FISHEYE",
        "k1": 0.02,
        "k2": -0.03,
        "k3": 0.004,
        "k4": -0.001,
    },
}


def photographed(x: float, y: float, lens: dict[str, Any]) -> np.ndarray:
    """Where the lens images the ray (x, y, 1): pixels with centres at +0.5."""
    k, p = (
        [lens.get(f"k{i}", 0.0) for i in range(1, 5)],
        [lens.get(f"p{i}", 0.0) for i in (1, 2)],
    )
    at = bent(x, y, "FISHEYE" in lens["camera_model"], k, p)
    return np.array(at) * (INTRINSICS["fl_x"], INTRINSICS["fl_y"]) + (
        INTRINSICS["cx"],
        INTRINSICS["cy"],
    )


def frame_of(number: int, scale: float = 1.0) -> tuple[np.ndarray, list[list[float]]]:
    """The point in a camera's frame, and the camera's pose as nerfstudio writes it: y up, z back."""
    pose = pose_of(*BOTH[number])
    opengl = pose @ np.diag([1.0, -1.0, -1.0, 1.0])
    opengl[:3, 3] *= scale
    return seen(pose), opengl.tolist()


def write_scene(root: Path, lens: str = "pinhole", **more: Any) -> Path:
    """Two images of the point, 16-bit depth maps in millimetres of the images as they are stored."""
    common = {**LENSES[lens], **INTRINSICS, "w": WIDTH, "h": HEIGHT, **more}
    frames = []
    for number in range(2):
        (x, y, z), matrix = frame_of(number, more.get("applied_scale", 1.0))
        at = photographed(x / z, y / z, LENSES[lens])
        write_spot(root / f"images/{number}.png", at)
        unit = more.get("depth_unit_scale_factor", 0.001)
        (root / "depths").mkdir(exist_ok=True)
        cv2.imwrite(
            str(root / f"depths/{number}.png"),
            np.rint(disk_depth(at, z) / unit).astype(np.uint16),
        )
        name = {
            "file_path": f"./images/{number}.png",
            "depth_file_path": f"depths/{number}.png",
        }
        frames.append({**name, "transform_matrix": matrix})
    (root / "transforms.json").write_text(json.dumps({**common, "frames": frames}))
    return root


load = loader(Nerfstudio)


def edit(change: Any) -> Change:
    """Change what the JSON holds, in place."""

    def apply(root: Path) -> None:
        content = json.loads((root / "transforms.json").read_text())
        change(content)
        (root / "transforms.json").write_text(json.dumps(content))

    return apply


def test_a_pose_that_was_written_with_three_digits_is_one(tmp_path: Path) -> None:
    pose = [
        [-0.589, -0.075, 0.805, 0],
        [0.762, -0.385, 0.521, 0],
        [0.271, 0.92, 0.283, 2],
        [0, 0, 0, 1],
    ]
    edit(lambda content: content["frames"][0].update(transform_matrix=pose))(
        write_scene(tmp_path)
    )
    assert load(tmp_path)["images/0.png"].cam_from_world @ [0, 0, 2, 1] == pytest.approx(
        [0, 0, 0, 1]
    )


@pytest.mark.parametrize("lens", LENSES)
def test_a_known_point_is_seen_where_it_is_in_both_views(tmp_path: Path, lens: str) -> None:
    scene = load(write_scene(tmp_path, lens))
    assert [view.name for view in scene] == ["images/0.png", "images/1.png"]
    assert scene.has == {"poses", "depth"}
    check_both(*scene)
    check_both(*load(tmp_path, image_scale=0.5))


def test_scales_that_were_applied_are_taken_back(tmp_path: Path) -> None:
    check_both(*load(write_scene(tmp_path, applied_scale=0.25, depth_unit_scale_factor=0.0005)))


@pytest.mark.parametrize("suffix", [".npy", ".tif"])
def test_float_depth_maps_are_multiplied_too(tmp_path: Path, suffix: str) -> None:
    import tifffile

    write_scene(tmp_path)
    for number in range(2):
        (x, y, z), _ = frame_of(number)
        metres = disk_depth(photographed(x / z, y / z, LENSES["pinhole"]), z)
        path = tmp_path / f"depths/{number}{suffix}"
        np.save(path, metres) if suffix == ".npy" else tifffile.imwrite(path, metres)
    edit(
        lambda c: [
            f.update(depth_file_path=f["depth_file_path"][:-4] + suffix) for f in c["frames"]
        ]
    )(tmp_path)
    check_both(*load(tmp_path, depth_scale=1.0))
    assert load(tmp_path).views[0].depth.max() == pytest.approx(9.0 / 1000), (
        "0.001, where nothing else is said"
    )


@pytest.mark.parametrize(
    ("units", "unit"),
    [({"integer_depth_scale": 0.0002}, 0.0002), ({"depth_scaling_factor": 4000.0}, 1 / 4000)],
    ids=["instant-ngp", "dense-depth-priors"],
)
def test_other_programs_keys_are_read(
    tmp_path: Path, units: dict[str, float], unit: float
) -> None:
    write_scene(tmp_path, depth_unit_scale_factor=unit)

    def change(content: dict[str, Any]) -> None:
        content |= {**units, "fx": content.pop("fl_x"), "fy": content.pop("fl_y")}
        del content["depth_unit_scale_factor"]
        for frame in content["frames"]:
            frame["depth_path"] = frame.pop("depth_file_path")

    edit(change)(tmp_path)
    check_both(*load(tmp_path))


def test_paths_of_another_computer_are_found_by_folder_and_name(tmp_path: Path) -> None:
    """Also of an image that was converted."""
    write_scene(tmp_path)

    def change(content: dict[str, Any]) -> None:
        for number, frame in enumerate(content["frames"]):
            frame["file_path"] = f"/home/someone/scene/images/{number}.jpg"
            frame["depth_file_path"] = f"C:\\scene\\depths\\{number}.png"

    edit(change)(tmp_path)
    scene = load(tmp_path)
    assert [view.name for view in scene] == ["images/0.png", "images/1.png"]
    check_both(*scene)


def test_views_stand_in_natural_order(tmp_path: Path) -> None:
    write_scene(tmp_path)

    def change(content: dict[str, Any]) -> None:
        for name, frame in zip((10, 9), content["frames"], strict=True):
            (tmp_path / frame["file_path"]).rename(tmp_path / f"images/{name}.png")
            frame["file_path"] = f"images/{name}.png"

    edit(change)(tmp_path)
    assert [view.name for view in load(tmp_path)] == ["images/9.png", "images/10.png"]


def test_intrinsics_may_stand_with_each_frame(tmp_path: Path) -> None:
    write_scene(tmp_path)
    own = {**INTRINSICS, "w": WIDTH, "h": HEIGHT}

    def change(content: dict[str, Any]) -> None:
        content["frames"] = [{**frame, **own} for frame in content["frames"]]
        content.update(dict.fromkeys(own, 1.0))

    edit(change)(tmp_path)
    check_both(*load(tmp_path))


def test_blender_scenes_have_a_field_of_view_and_names_without_suffix(tmp_path: Path) -> None:
    """transforms_train.json and _test.json are taken together; the principal point is in the middle."""
    angle = 0.9
    focal = WIDTH / 2 / np.tan(angle / 2)
    for number, split in enumerate(("train", "test")):
        (x, y, z), matrix = frame_of(number)
        at = np.array([focal * x / z + WIDTH / 2, focal * y / z + HEIGHT / 2])
        write_spot(tmp_path / split / "r_0.png", at)
        np.save(tmp_path / split / "d.npy", disk_depth(at, z))
        frames = [
            {
                "file_path": f"./{split}/r_0",
                "depth_file_path": f"{split}/d.npy",
                "transform_matrix": matrix,
            }
        ]
        content = {"camera_angle_x": angle, "frames": frames}
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(content))
    scene = load(tmp_path, depth_scale=1.0)
    assert [view.name for view in scene] == ["test/r_0.png", "train/r_0.png"]
    check_both(*scene)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_masked_pixels_have_no_depth(tmp_path: Path, suffix: str) -> None:
    write_scene(tmp_path)
    before = load(tmp_path).data_id
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[:, :48] = 0  # whole blocks of a JPEG
    cv2.imwrite(str(tmp_path / f"mask{suffix}"), np.dstack([mask] * 3))
    edit(lambda content: content["frames"][0].update(mask_path=f"mask{suffix}"))(tmp_path)
    scene = load(tmp_path)
    assert (scene.views[0].depth > 0).tolist() == (mask > 0).tolist()
    assert (scene.views[1].depth > 0).all()
    cv2.imwrite(str(tmp_path / f"mask{suffix}"), 255 - mask)
    assert len({scene.data_id, before, load(tmp_path).data_id}) == 3


def frame(**values: Any) -> Change:
    return edit(lambda content: content["frames"][0].update(values))


FLIPPED = np.diag([1.0, 1.0, -1.0, 1.0]).tolist()
SCENE: dict[str, tuple[Change, list[str]]] = {
    "no frames": (
        edit(lambda content: content.update(frames=[])),
        ["transforms.json: ", "no frames"],
    ),
    "a list": (
        lambda root: (root / "transforms.json").write_text("[1]"),
        ["transforms.json: ", "no frames"],
    ),
    "no path": (frame(file_path=None), ["no usable file_path"]),
    "an image twice": (frame(file_path="images/1.png"), ["images/1.png", "frame 0", "frame 1"]),
    "a mirrored pose": (frame(transform_matrix=FLIPPED), ["images/0.png", "transform_matrix"]),
    "a scaled pose": (frame(transform_matrix=(2 * np.eye(4)).tolist()), ["transform_matrix"]),
    "nothing applied": (
        edit(lambda c: c.update(applied_scale=0)),
        ["transforms.json: applied_scale is 0"],
    ),
    "no unit": (
        edit(lambda c: c.update(depth_unit_scale_factor=-1)),
        ["depth_unit_scale_factor is -1"],
    ),
    "no pose": (frame(transform_matrix="identity"), ["transform_matrix"]),
    "text for a number": (frame(fl_x="150"), ["fl_x is '150'", "number"]),
    "no focal length": (
        edit(lambda content: [content.pop(key) for key in ("fl_x", "fl_y")]),
        ["camera_angle_x"],
    ),
    "an unknown lens": (
        edit(lambda content: content.update(camera_model="EQUIRECTANGULAR")),
        ["EQUIRECTANGULAR"],
    ),
    "a name that is no UTF-8": (
        frame(file_path="caf\udce9.png"),
        ["transforms.json: ", "udce9"],
    ),
    "no images": (
        lambda root: [path.unlink() for path in root.glob("images/*")],
        ["images/0.png: no such file", "transforms.json"],
    ),
}


test_a_fault_of_the_scene_is_one_line_about_the_file = scene_fault_test(
    write_scene, load, SCENE
)


VIEW: dict[str, tuple[str, Change, list[str]]] = {
    "a path from the top": (
        "rgb",
        frame(file_path="/etc/passwd"),
        ["etc/passwd: no such file"],
    ),
    "a mask above": ("depth", frame(mask_path="a/../../m.png"), ["m.png: "]),
    "depth of a kind": (
        "depth",
        frame(depth_file_path="images/0.jpg"),
        ["images/0.jpg"],
    ),
}


test_a_fault_of_one_view_leaves_the_other = view_fault_test(write_scene, load, VIEW)
