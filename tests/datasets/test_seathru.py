"""The seathru dataset against miniatures of its layouts, and its packaged charts against frames read by hand."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import cv2
import numpy as np
import pytest
import tifffile
from support.colmap_folder import write_model
from support.miniatures import SET_SIZE, loader, picture16, write_set
from support.places import DATA

from sucre_bench.arrays import Array
from sucre_bench.camera import project
from sucre_bench.datasets.colmap import Colmap
from sucre_bench.datasets.seathru import Seathru
from sucre_bench.errors import InputError
from sucre_bench.loading.d5_charts import published_charts

load = loader(Seathru)


WIDTH, HEIGHT = SET_SIZE


# -- images and depth --------------------------------------------------------------------------------------


def test_images_are_linear_and_depth_of_another_size_is_taken_by_nearest(
    tmp_path: Path,
) -> None:
    write_set(tmp_path / "D1" / "D1")
    scene = load(tmp_path)
    assert (scene.name, [view.name for view in scene]) == ("D1", ["T_S01.png", "T_S02.png"])
    assert sorted(scene.has) == ["depth"]
    view = scene.views[1]
    assert (view.encoding, view.camera, view.cam_from_world) == ("linear", None, None)
    np.testing.assert_array_equal(np.rint(view.rgb * 65535), picture16(1))
    assert set(np.unique(view.depth)) == {0, 2, *range(3, 23)}, "nothing between two values"
    assert (view.depth[:2, :2] == 0).all()
    assert (view.depth[11, 40], view.depth[11, 20]) == (8, 2)
    assert load(tmp_path / "D1" / "D1" / "linearPNG").data_id == scene.data_id


def test_each_set_is_a_scene_and_odd_files_are_left_alone(tmp_path: Path) -> None:
    write_set(tmp_path / "D3" / "D3", ("LFT_0001",), "depthMaps")
    write_set(tmp_path / "D4" / "D4", ("a", "b"), "depth_resized")
    (tmp_path / "D4/D4/depth").mkdir()
    tifffile.imwrite(
        tmp_path / "D4/D4/depth/depth_a.tif", np.ones((HEIGHT // 2, WIDTH // 2), np.float32)
    )
    (tmp_path / "D4/D4/linearPNG/._a.png").write_bytes(b"resource fork")
    (tmp_path / "D4/D4/depth_resized/depthb.tif").unlink()
    first, second = Seathru(tmp_path).scenes()
    assert (first.name, second.name) == ("D3", "D4")
    assert [view.name for view in second] == ["a.png", "b.png"]
    assert second["a.png"].depth[39, 59] == 22, "the resized map, not the other"
    assert not second["b.png"].has_depth
    assert first.views[0].depth[39, 59] == 22
    tifffile.imwrite(
        tmp_path / "D4/D4/depth_resized/depthb.tif", np.ones((HEIGHT, WIDTH), np.float32)
    )
    assert all(view.has_depth for view in list(Seathru(tmp_path).scenes())[1]), (
        "also where every image has one"
    )


def test_half_size_and_a_focal_length_make_a_camera(tmp_path: Path) -> None:
    view = load(write_set(tmp_path), image_scale=0.5, focal_px=50.0).views[0]
    np.testing.assert_allclose(view.camera.K, [[25, 0, 15], [0, 25, 10], [0, 0, 1]])
    assert view.rgb.shape == (20, 30, 3)
    assert view.depth.shape == (20, 30)
    far = view.depth[19, 29]
    assert view.distance[19, 29] == pytest.approx(
        far * np.sqrt(1 + (14.5 / 25) ** 2 + (9.5 / 25) ** 2)
    )


def test_a_model_beside_the_images_gives_poses_in_metres(tmp_path: Path) -> None:
    write_set(tmp_path)
    # made of copies twice as large
    cameras = [f"1 PINHOLE {WIDTH * 2} {HEIGHT * 2} 100 100 62 38"]
    model = [
        ("T_S01.jpg", (1.0, 0, 0, 0, 0, 0, 0), 1),
        ("T_S02.jpg", (1.0, 0, 1.0, 0, -2.5, 0, 1.25), 1),
    ]
    write_model(tmp_path / "sparse", model, cameras)
    scene = load(tmp_path, metres_per_unit=4.0)
    assert sorted(scene.has) == ["depth", "poses"]
    pixels = []
    for view in scene:
        pixels.append(project(view.camera, (view.cam_from_world @ [1.0, 2.0, 10.0, 1.0])[:3]))
    assert pixels[0][0] == pytest.approx([50 / 10 + 31, 50 * 2 / 10 + 19])
    assert pixels[1][0] == pytest.approx([31, 50 * 2 / 4 + 19]), (
        "at (5, 0, 10), looking along -x: 4 m before it"
    )
    assert pixels[1][1] == pytest.approx(4)


def test_a_model_of_other_images_is_refused_and_one_of_copies_may_not_be_a_guess(
    tmp_path: Path,
) -> None:
    write_set(tmp_path)
    cameras = [f"1 PINHOLE {WIDTH} {HEIGHT} 50 50 30 20"]
    at, away = (1.0, 0, 0, 0, 0, 0, 0), (1.0, 0, 0, 0, 7.0, 0, 0)
    write_model(tmp_path / "sparse", [("a.png", at, 1)], cameras)
    with pytest.raises(InputError, match=r"sparse: .* a\.png .*linearPNG"):
        load(tmp_path)
    several = [
        ("T_S01.jpg", at, 1),
        ("T_S01.png", away, 1),
        ("a/T_S02.jpg", at, 1),
        ("b/T_S02.jpg", away, 1),
    ]
    write_model(tmp_path / "sparse", several, cameras)
    first, second = load(tmp_path)
    assert first.cam_from_world[0, 3] == 7, "the one of its own name"
    assert first.rgb.shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(InputError, match=r"T_S02\.png: may be a/T_S02\.jpg or b/T_S02\.jpg"):
        _ = second.rgb


# -- charts ------------------------------------------------------------------------------------------------


def test_published_charts_come_to_the_frames_read_by_hand() -> None:
    folder = DATA / "seathru_d5_charts"
    if not folder.is_dir():
        pytest.skip("no real images of D5 here")
    (scene,) = Colmap(folder).scenes()
    # as that copy was undistorted, at the photographs' size
    lens, focal = (
        np.array([-0.083, 0, 0, 0]),
        4 * 1891.0,
    )
    K = np.array([[focal, 0, 3680], [0, focal, 2456], [0, 0, 1]])
    for name, stem in (("D5_fig01_LFT_3374.png", "LFT_3374"), ("LFT_3411.png", "LFT_3411")):
        view = scene[name]
        published = published_charts()[stem]
        assert [chart.name for chart in published] == [chart.name for chart in view.charts]
        for chart, by_hand in zip(published, view.charts, strict=True):
            rays = cv2.undistortPoints(chart.corners[:, None], K, lens)[:, 0]
            corners = rays * np.diag(view.camera.K)[:2] + view.camera.K[:2, 2]
            assert np.linalg.norm(corners - by_hand.corners, axis=1).mean() < 4, (
                f"{name}, {chart.name}"
            )


def test_charts_of_d5_are_scaled_to_the_image_and_ones_own_go_first(tmp_path: Path) -> None:
    write_set(tmp_path, ("LFT_3374", "LFT_9999"))
    (chart, *others), none = (view.charts for view in load(tmp_path))
    assert (len(others), len(none), chart.kind) == (3, 0, "dgk")
    # The table's (3110.5, 2390.8) is the white patch's outer corner, at (.045, .05) of a frame about 1 / .925 as wide.
    white = np.array([3110.5, 2390.8]) * (WIDTH / 7360, HEIGHT / 4912)
    outward = chart.corners[0] - white
    assert (outward < 0).all()
    assert np.linalg.norm(outward) < 0.08 * np.linalg.norm(chart.corners[1] - chart.corners[0])
    np.testing.assert_allclose(
        load(tmp_path, image_scale=0.5).views[0].charts[0].corners, chart.corners / 2
    )
    corners = [[1, 1], [7, 1], [7, 5], [1, 5]]
    (tmp_path / "charts.json").write_text(
        json.dumps({"images": {"LFT_9999.png": {"mine": corners}}})
    )
    first, second = load(tmp_path, image_scale=0.5)
    assert first.charts == ()
    np.testing.assert_array_equal(second.charts[0].corners, np.array(corners) / 2)


# -- raw files ---------------------------------------------------------------------------------------------


@pytest.fixture
def rawpy(monkeypatch: pytest.MonkeyPatch) -> Any:
    """What rawpy makes of a file, in miniature."""
    module = MagicMock(LibRawError=type("LibRawError", (Exception,), {}))
    raw = module.imread.return_value.__enter__.return_value
    raw.sizes = SimpleNamespace(width=WIDTH, height=HEIGHT)
    raw.postprocess.return_value = picture16(5)
    monkeypatch.setitem(sys.modules, "rawpy", module)
    return module


def write_raw(place: Path) -> Path:
    write_set(place, ("T_S01", "T_S02"), "depthMaps")
    (place / "linearPNG").rename(place / "Raw")
    for stem in ("T_S01", "T_S02"):
        (place / "Raw" / f"{stem}.png").unlink()
        (place / "Raw" / f"{stem}.ARW").write_bytes(b"raw")
    return place


def test_raw_files_come_linear_and_without_white_balance(tmp_path: Path, rawpy: Any) -> None:
    scene = load(write_raw(tmp_path / "3585_3685"))
    assert (scene.name, scene.views[0].name, scene.views[0].encoding) == (
        "3585_3685",
        "T_S01.ARW",
        "linear",
    )
    np.testing.assert_array_equal(np.rint(scene.views[0].rgb * 65535), picture16(5))
    asked = rawpy.imread.return_value.__enter__.return_value.postprocess.call_args.kwargs
    assert (asked["user_wb"], asked["gamma"], asked["output_bps"]) == ([1, 1, 1, 1], (1, 1), 16)
    assert asked["output_color"] is rawpy.ColorSpace.raw
    assert (asked["no_auto_bright"], asked["adjust_maximum_thr"]) == (True, 0)
    assert scene.views[0].depth[39, 59] == 22
    half: Array = load(tmp_path, image_scale=0.5).views[0].rgb
    assert half.shape == (20, 30, 3)
    assert half[0, 0, 0] == pytest.approx(picture16(5)[:2, :2, 0].mean() / 65535, abs=1e-5)
    rawpy.imread.side_effect = rawpy.LibRawError("Unsupported file format")
    with pytest.raises(InputError, match=r"T_S02\.ARW: .*Unsupported"):
        _ = load(tmp_path).views[1].rgb


def test_without_rawpy_the_message_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rawpy", None)
    with pytest.raises(InputError, match=r"T_S01\.ARW: .*\(pip install rawpy\)"):
        load(write_raw(tmp_path))


# -- what is wrong with the files --------------------------------------------------------------------------


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    (tmp_path / "linearPNG").mkdir()
    with pytest.raises(InputError, match="linearPNG: "):
        load(tmp_path)
    write_set(tmp_path)
    for path in (tmp_path / "depth").iterdir():
        path.rename(path.with_name("x" + path.name))
    with pytest.raises(InputError, match=r"depth: .* depth_T_S01\.png"):
        load(tmp_path)
