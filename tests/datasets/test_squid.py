"""The squid dataset against miniatures of its layout, with a pair of cameras worked out by hand."""

import base64
import json
import shutil
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import scipy.io
from support.colmap_folder import HEIGHT, WIDTH
from support.miniatures import loader

from sucre_bench.arrays import Array
from sucre_bench.camera import project
from sucre_bench.datasets.squid import Squid
from sucre_bench.errors import InputError
from sucre_bench.scene import Scene

# As MATLAB writes them: matrices stand transposed, pixels count from 1, rows are points, millimetres.
LEFT: dict[str, Any] = {
    "IntrinsicMatrix": [[50.0, 0, 0], [0, 50, 0], [20.5, 15.5, 1]],
    "ImageSize": [[30.0, 40.0]],
}
RIGHT: dict[str, Any] = {
    "IntrinsicMatrix": [[60.0, 0, 0], [0, 60, 0], [22.5, 15.5, 1]],
    "ImageSize": [[30.0, 40.0]],
}
ROTATION, TRANSLATION = [[0.96, 0, 0.28], [0, 1, 0], [-0.28, 0, 0.96]], [[-150.0, 20.0, 400.0]]
STEREO: dict[str, Any] = {
    "CameraParameters1": LEFT | {"WorldUnits": "mm"},
    "CameraParameters2": RIGHT,
    "RotationOfCamera2": ROTATION,
    "TranslationOfCamera2": TRANSLATION,
}
WORLD = [0.55, 0.25, 2.0]  # metres, in the left camera's frame
# (x, y, z) R + t = (.528 - .56 - .15, .25 + .02, .154 + 1.92 + .4); K with the first pixel's centre at .5.
RIGHT_POINT = [-0.182, 0.27, 2.474]
LEFT_PIXEL = [50 * 0.55 / 2 + 20, 50 * 0.25 / 2 + 15]
RIGHT_PIXEL = [60 * -0.182 / 2.474 + 22, 60 * 0.27 / 2.474 + 15]


def picture16(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 65536, (HEIGHT, WIDTH, 3), dtype=np.uint16)


def write_site(
    site: Path, sets: tuple[str, ...] = ("image_set_01",), stereo: object = STEREO
) -> Path:
    """Pairs of images, and distances that are 9 m but at the world point's pixels, and NaN in the first row."""
    for number, name in enumerate(sets):
        (site / name).mkdir(parents=True)
        maps = {}
        for seed, (image, key, pixel, point) in enumerate(
            [
                ("LFT_4007", "dist_map_l", LEFT_PIXEL, WORLD),
                ("RGT_4011", "dist_map_r", RIGHT_PIXEL, RIGHT_POINT),
            ]
        ):
            shown = picture16(2 * number + seed)[..., ::-1]
            assert cv2.imwrite(str(site / name / f"{image}resizedUndistort.tif"), shown)
            (site / name / f"{image}.NEF").write_bytes(b"raw")
            distance = np.full((HEIGHT, WIDTH), 9.0)
            distance[0], distance[1] = np.nan, 4000.0
            distance[int(pixel[1]), int(pixel[0])] = np.linalg.norm(point)
            maps[key] = distance
        scipy.io.savemat(site / name / "distanceFromCamera.mat", maps)
    if isinstance(stereo, bytes):
        (site / "stereoParams0.5.mat").write_bytes(stereo)
    else:
        scipy.io.savemat(site / "stereoParams0.5.mat", {"stereoParams": stereo})
    return site


# The same as an object of MATLAB's class stereoParameters, as mat-io 1.0.2 writes it.
OBJECT = base64.b64decode(
    "TUFUTEFCIDUuMCBNQVQtZmlsZSBQbGF0Zm9ybS4gQ3JlYXRlZCBvbjogMjAyNi0xMS0yMSAwNzo0MTo0OCBVVEMgYnkgbWF0aW8gd2l0aCBzY2lw"
    "eSAgICAgICAgICAgICAgICAgICAgICAgICAgICAgICDeAAAAAAAAAAABSU0PAAAAVgAAAHic42NgYJgBxGxAzAHEggwQwAjEPEBcXJJalJofkFiU"
    "mFsMEWdh8HX2DwbJC6DKpwKZxXxAMQ8k83ih5rFC+WxQsxmh4iC+BIR5lwlJDoRBfADt5g8/DwAAAMYBAAB4nOVVwU7CQBCdlgqYSIM3Tv6CkRjj"
    "SZpgjBwQEROPZCXVNIFC2h7QExf/xyM3+QU/wIQjicb4Ce6yO2U7FEz0onGSyezMvHnTmW7BBgAnD5DllhvYBCkbyje4FvPSCjGVD0atLnwbJBDr"
    "zZR6VBm35jlDYerVRgt5xrkFz7bCG7G15ljhF7ieeF33KmCDgRu026p+qNUv+km/QJ5D4Evm6rlnRhJvqpil8o9cp0odHp9wnSoVuCrruQE7ZwG3"
    "kRuEe1Dzo8DzQ69TZ/wwhFqP3bot796FDsEuFZfhoh+xyOv7jRuZK8NlwPywS4IhR7t9jSlVLOLn02EJMYkv9pLR9qPjjJR4hnBYGk7E9TuRVWdh"
    "c+qc0/ixB/LS94T5jJanM38ltmaHsLgnWRXHe6L3ECLu0WnMUnMSpKP9pB/nd0kc5aMi+jtr+uP+9P7FuP5I8R47tnou5CkQHtw58gi/JI8v+jvF"
    "88/2cpacd3RA5sf839kLzvrdvYx3Hl6b4/cKPuFbU0Sen+jcJB/7WE/nSdsL7V9Cksn1RB7wnt7N9zOD1b+r9PsT+ENY/38ACR7r19U7sPo+0HkF"
    "bguW5b/t7ROm8XMA"
)


load = loader(Squid)
CORNERS = [[4, 4], [16, 4], [16, 12], [4, 12]]
CHARTS = json.dumps({"images": {"RGT_4011resizedUndistort.tif": {"near": CORNERS}}})


def seen(scene: Scene) -> list[tuple[Array, float]]:
    """Where each view has the world point, and its planar depth there, off by what half a pixel of a ray may be."""
    found = []
    for view in scene:
        pixel, depth = project(view.camera, (view.cam_from_world @ [*WORLD, 1.0])[:3])
        assert view.depth[int(pixel[1]), int(pixel[0])] == pytest.approx(depth, rel=0.01)
        found.append((pixel, float(depth)))
    return found


def check_pair(scene: Scene) -> None:
    (left, left_z), (right, right_z) = seen(scene)
    assert left == pytest.approx(LEFT_PIXEL)
    assert right == pytest.approx(RIGHT_PIXEL)
    assert (left_z, right_z) == pytest.approx((2.0, 2.474))


def test_a_world_point_falls_on_its_mark_at_its_planar_depth_in_both_views(
    tmp_path: Path,
) -> None:
    write_site(tmp_path / "Katzaa")
    scene = load(tmp_path)
    check_pair(scene)
    assert (scene.name, sorted(scene.has)) == ("Katzaa_image_set_01", ["depth", "poses"])
    left, right = scene
    assert [left.name, right.name] == [
        "LFT_4007resizedUndistort.tif",
        "RGT_4011resizedUndistort.tif",
    ]
    assert left.encoding == "linear"
    np.testing.assert_array_equal(np.rint(right.rgb * 65535), picture16(1))
    ray = np.linalg.norm([(39.5 - 20) / 50, (29.5 - 15) / 50, 1])
    assert left.depth[29, 39] == pytest.approx(9 / ray), "a distance is no depth"
    np.testing.assert_allclose(left.distance[2:, 35:], 9, rtol=1e-6)
    assert not left.depth[:2].any(), "NaN, and what lies beyond farthest_m"
    assert load(tmp_path, farthest_m=8.0).views[0].valid.sum() == 1


def test_sites_and_sets_are_scenes_and_their_charts_are_read(tmp_path: Path) -> None:
    write_site(tmp_path / "Satil", ("image_set_01", "image_set_02"))
    shutil.copytree(
        tmp_path / "Satil", tmp_path / "Katzaa", ignore=shutil.ignore_patterns("image_set_02")
    )
    (tmp_path / "Satil/image_set_02/charts.json").write_text(CHARTS)
    scenes = list(Squid(tmp_path, image_scale=0.5).scenes())
    assert [scene.name for scene in scenes] == [
        "Katzaa_image_set_01",
        "Satil_image_set_01",
        "Satil_image_set_02",
    ]
    assert ["charts" in scene.has for scene in scenes] == [False, False, True]
    np.testing.assert_array_equal(scenes[2].views[1].charts[0].corners, np.array(CORNERS) / 2)
    assert len({scene.data_id for scene in scenes}) == 2, "Satil's second set differs"


def test_charts_that_are_asked_for_must_be_in_one_of_the_sets(tmp_path: Path) -> None:
    write_site(tmp_path, ("image_set_01", "image_set_02"))
    with pytest.raises(InputError, match=r"image_set_01/mine\.json: .*dataset\.charts=mine"):
        list(Squid(tmp_path, charts="mine.json").scenes())
    (tmp_path / "image_set_02" / "mine.json").write_text(CHARTS)
    assert [
        "charts" in scene.has for scene in Squid(tmp_path, charts="mine.json").scenes()
    ] == [
        False,
        True,
    ]


IN_METRES = {
    "CameraParameters1": LEFT | {"WorldUnits": "m"},
    "TranslationOfCamera2": np.array(TRANSLATION) / 1000,
}
UPRIGHT = {"K": np.array(RIGHT["IntrinsicMatrix"]).T, "ImageSize": RIGHT["ImageSize"]}


@pytest.mark.parametrize("change", [IN_METRES, {"CameraParameters2": UPRIGHT}])
def test_other_ways_to_write_the_same_calibration(tmp_path: Path, change: Any) -> None:
    check_pair(load(write_site(tmp_path, stereo=STEREO | change)))


def test_a_calibration_without_a_size_is_of_the_released_images(tmp_path: Path) -> None:
    sizeless = {"CameraParameters2": RIGHT | {"ImageSize": np.zeros((0, 0))}}
    right = load(write_site(tmp_path, stereo=STEREO | sizeless)).views[1]
    with pytest.raises(InputError, match="is 40x30, its camera 2737x1827"):
        _ = right.rgb


def test_a_calibration_saved_as_an_object_is_read_with_mat_io(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_site(tmp_path, stereo=OBJECT)
    monkeypatch.setitem(sys.modules, "matio", None)
    with pytest.raises(InputError, match=r"stereoParams0\.5\.mat: .* mat-io"):
        load(tmp_path)

    def made(path: str) -> dict[str, object]:
        sides = {
            f"CameraParameters{k}": SimpleNamespace(properties=p)
            for k, p in ((1, LEFT), (2, RIGHT))
        }
        pair = {
            "RotationOfCamera2": np.array(ROTATION),
            "TranslationOfCamera2": np.array(TRANSLATION),
        }
        return {"stereoParams": SimpleNamespace(properties=sides | pair)}

    module = ModuleType("matio")
    vars(module).update(load_from_mat=made)
    monkeypatch.setitem(sys.modules, "matio", module)
    check_pair(load(tmp_path))


def test_what_is_wrong_with_a_calibration_is_named(tmp_path: Path) -> None:
    write_site(
        tmp_path,
        stereo={key: value for key, value in STEREO.items() if key != "TranslationOfCamera2"},
    )
    path = tmp_path / "stereoParams0.5.mat"
    with pytest.raises(InputError, match=r"stereoParams0\.5\.mat: .*cameras"):
        load(tmp_path)
    scipy.io.savemat(path, {"stereoParams": STEREO | {"RotationOfCamera2": 2 * np.eye(3)}})
    with pytest.raises(InputError, match=r"stereoParams0\.5\.mat: .*rotation"):
        load(tmp_path)


def test_what_is_wrong_with_one_view_leaves_the_other_alone(tmp_path: Path) -> None:
    folder = write_site(tmp_path) / "image_set_01"
    maps = scipy.io.loadmat(folder / "distanceFromCamera.mat")
    scipy.io.savemat(folder / "distanceFromCamera.mat", {"dist_map_r": maps["dist_map_r"]})
    left, right = load(tmp_path)
    with pytest.raises(InputError, match=r"distanceFromCamera\.mat: .* dist_map_l"):
        _ = left.depth
    assert right.depth.max() > 8
    (folder / "distanceFromCamera.mat").unlink()
    scene = load(tmp_path)
    assert (sorted(scene.has), scene.views[1].has_depth) == (["poses"], False)
