"""The colmap dataset against miniatures of its layout, with geometry worked out by hand and poses read by pycolmap."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from support.colmap_folder import (
    CAMERA,
    FORWARD,
    HEIGHT,
    WIDTH,
    depth_mm,
    picture,
    to_binary,
    write_dive,
    write_image,
    write_model,
)
from support.miniatures import loader

from sucre_bench.arrays import Array
from sucre_bench.camera import project
from sucre_bench.datasets.colmap import Colmap
from sucre_bench.errors import InputError
from sucre_bench.scene import View

# At (5, 0, 10), looking along the world's -x, y down: x is the world's z. A turn of +90 degrees about y, written with
# a quaternion that is not of unit length.
SIDEWAYS = (1.0, 0.0, 1.0, 0.0, -10.0, 0.0, 5.0)


load = loader(Colmap)


def pixel_of(view: View, world: list[float]) -> Array:
    return project(view.camera, (view.cam_from_world @ [*world, 1.0])[:3])[0]


# -- the model ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "written",
    ["/mnt/disk/dive/images/{}.png", "C:\\dive\\images\\{}.png", "cam0/{}.png", "{}.JPG"],
    ids=["absolute", "Windows", "moved", "converted"],
)
def test_images_of_another_computer_are_found_by_the_end_of_their_paths(
    tmp_path: Path, written: str
) -> None:
    write_dive(tmp_path)
    there = load(tmp_path)
    write_model(
        tmp_path / "sparse",
        [(written.format("b"), SIDEWAYS, 1), (written.format("a"), FORWARD, 1)],
    )
    scene = load(tmp_path)
    assert [view.name for view in scene] == ["a.png", "b.png"]
    np.testing.assert_array_equal(scene["a.png"].depth, there["a.png"].depth)
    assert pixel_of(scene["a.png"], [1, 2, 10]) == pytest.approx([25.5, 26.5])


@pytest.mark.parametrize("binary", [False, True], ids=["text", "binary"])
@pytest.mark.parametrize("sparse", ["sparse", "sparse/0"])
def test_poses_and_cameras_are_those_that_pycolmap_reads(
    tmp_path: Path, sparse: str, binary: bool
) -> None:
    import pycolmap

    rng = np.random.default_rng(0)
    quaternions = rng.normal(size=(9, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    poses = np.hstack([quaternions, rng.normal(size=(9, 3))])
    names = [f"run{i % 3}/é_{i}.png" for i in range(9)]
    cameras = [
        CAMERA,
        f"7 SIMPLE_PINHOLE {WIDTH} {HEIGHT} 33.25 19 16",
        f"3 PINHOLE {WIDTH} {HEIGHT} 51 52 18 13",
    ]
    write_dive(tmp_path, names)
    shutil.rmtree(tmp_path / "sparse")
    write_model(
        tmp_path / sparse,
        [
            (name, tuple(pose.tolist()), (1, 7, 3)[i % 3])
            for i, (name, pose) in enumerate(zip(names, poses, strict=True))
        ],
        cameras,
    )
    if binary:
        to_binary(tmp_path / sparse)
    expected = {
        image.name: (image.cam_from_world().matrix(), image.camera.calibration_matrix())
        for image in pycolmap.Reconstruction(tmp_path / sparse).images.values()
    }
    scene = load(tmp_path)
    assert [view.name for view in scene] == sorted(names)
    for view in scene:
        pose, K = expected[view.name]
        np.testing.assert_allclose(view.cam_from_world, [*pose, [0, 0, 0, 1]], atol=1e-12)
        np.testing.assert_allclose(view.camera.K, K)
        assert (view.camera.width, view.camera.height) == (WIDTH, HEIGHT)


def test_images_on_disk_of_another_size_than_the_camera_scale_it(tmp_path: Path) -> None:
    write_dive(tmp_path)
    whole = load(tmp_path)["a.png"]
    write_image(tmp_path / "images" / "a.png", picture(0, WIDTH // 2, HEIGHT // 2))
    half = load(tmp_path)["a.png"]
    assert half.rgb.shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert half.depth.shape == (HEIGHT // 2, WIDTH // 2)
    assert pixel_of(half, [1, 2, 10]) == pytest.approx(pixel_of(whole, [1, 2, 10]) / 2)


# -- images ------------------------------------------------------------------------------------------------


def test_references_and_the_encoding_are_handed_on(tmp_path: Path) -> None:
    write_dive(tmp_path)
    write_image(tmp_path / "reference" / "b.png", picture(9))
    scene = load(tmp_path, encoding="linear")
    assert scene.has == {"poses", "depth", "reference"}
    assert scene["a.png"].reference is None
    assert scene["b.png"].encoding == "linear"
    np.testing.assert_allclose(scene["b.png"].reference, picture(9) / 255, atol=1e-6)


# -- depth -------------------------------------------------------------------------------------------------


def save_depth(path: Path, metres: Array, millimetres: np.ndarray) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    if path.suffix == ".png":
        write_image(path, millimetres)
    elif path.suffix == ".npy":
        np.save(path, metres)
    else:
        tifffile.imwrite(path, metres)


@pytest.mark.parametrize("kind", ["half precision", "double precision", "lzw"])
def test_float_tiffs_of_other_programs_are_read(tmp_path: Path, kind: str) -> None:
    write_dive(tmp_path)
    (tmp_path / "depths" / "depth_a.png").unlink()
    path, metres = tmp_path / "depths" / "depth_a.tif", depth_mm() / 1000
    if kind == "lzw":
        cv2.imwrite(str(path), metres.astype(np.float32), [cv2.IMWRITE_TIFF_COMPRESSION, 5])
    else:
        tifffile.imwrite(
            path, metres.astype(np.float16 if kind == "half precision" else np.float64)
        )
    tolerance = 2**-11 if kind == "half precision" else 1e-6
    np.testing.assert_allclose(load(tmp_path)["a.png"].depth, metres, rtol=tolerance)


def test_the_folder_of_colmaps_dense_step_is_read_as_it_is(tmp_path: Path) -> None:
    wanted = load(write_dive(tmp_path))["a.png"].depth
    shutil.rmtree(tmp_path / "depths")
    (tmp_path / "stereo/depth_maps").mkdir(parents=True)
    maps = tmp_path / "stereo/depth_maps/a.png.geometric.bin"
    maps.write_bytes(f"{WIDTH}&{HEIGHT}&1&".encode() + wanted.astype("<f4").tobytes())
    np.testing.assert_array_equal(load(tmp_path)["a.png"].depth, wanted)


# Depth files, what each image then has: the file's number, None for no map, or "ambiguous".
BOTH = ["a.png", "sub/a.png"]
PORT_STARBOARD = ["port/a.png", "starboard/a.png"]
NAMING: list[tuple[list[str], list[str], list[int | str | None]]] = [
    (["port/depth_a.png", "starboard/depth_a.png"], PORT_STARBOARD, [0, 1]),
    (["port/a.png", "starboard/depth_a.npy"], PORT_STARBOARD, [0, 1]),
    (["depth_a.png"], PORT_STARBOARD, ["ambiguous", "ambiguous"]),
    (["port/depth_a.png", "depth_a.png"], PORT_STARBOARD, [0, "ambiguous"]),
    (["depth_a.png", "depth_b.png"], ["port/a.png", "starboard/b.png"], [0, 1]),
    (["depth_a.png"], BOTH, [0, None]),
    (["depth_a.png"], ["a.png", "depth_a.png"], [0, None]),
    (["depth_a.png", "a.png"], ["a.png", "b.png"], [0, None]),
    (["a.png"], ["a.png", "b.png"], [0, None]),
    (["depth_a.png", "depth_a.tif"], ["a.png", "b.png"], ["ambiguous", None]),
    (["depth_a.png"], ["a.jpg", "a.png"], ["ambiguous", "ambiguous"]),
    (["depth_a.b.0.png"], ["a.b.0.png", "a.b.1.png"], [0, None]),
]


@pytest.mark.parametrize(
    ("files", "names", "expected"), NAMING, ids=lambda x: " ".join(map(str, x))
)
def test_each_image_gets_its_own_depth_map_or_none(
    tmp_path: Path, files: list[str], names: list[str], expected: list[int | str | None]
) -> None:
    write_dive(tmp_path, names)
    shutil.rmtree(tmp_path / "depths")
    for number, file in enumerate(files):
        metres = np.full((HEIGHT, WIDTH), number + 1.0, np.float32)
        save_depth(tmp_path / "depths" / file, metres, (1000 * metres).astype(np.uint16))
    scene = load(tmp_path)
    assert "depth" in scene.has
    for name, wanted in zip(names, expected, strict=True):
        if wanted == "ambiguous":
            with pytest.raises(InputError) as fault:
                _ = scene[name].depth
            said = str(fault.value).replace(f"{tmp_path}/depths/", "")
            named = set(re.findall(r"[\w/.]+\.(?:png|jpg|tif|npy)", said))
            assert named in ({files[-1], *names}, set(files)), (
                "a file, and the images or the other file it vies with"
            )
        elif wanted is None:
            assert not scene[name].has_depth
        else:
            assert scene[name].depth.mean() == int(wanted) + 1


# -- charts, scale, identity -------------------------------------------------------------------------------

SQUARE = [[4.0, 2.0], [20.0, 3.0], [21.0, 12.0], [5.0, 11.0]]


def test_charts_have_their_own_kind_or_that_of_the_file(tmp_path: Path) -> None:
    write_dive(tmp_path)
    charts = {"near": SQUARE, "far": {"kind": "dgk", "corners": SQUARE}}
    content = {
        "kind": "colorchecker24",
        "note": "by hand",
        "images": {"b.png": charts, "a.png": {}},
    }
    (tmp_path / "charts.json").write_text(json.dumps(content))
    scene = load(tmp_path)
    assert scene.has == {"poses", "depth", "charts"}
    assert list(scene["a.png"].charts) == []
    assert [(chart.name, chart.kind) for chart in scene["b.png"].charts] == [
        ("near", "colorchecker24"),
        ("far", "dgk"),
    ]
    np.testing.assert_array_equal(scene["b.png"].charts[1].corners, SQUARE)


def test_image_scale_shrinks_pixels_depth_camera_and_charts_alike(tmp_path: Path) -> None:
    write_dive(tmp_path)
    write_image(tmp_path / "reference" / "a.png", picture(0))
    (tmp_path / "charts.json").write_text(json.dumps({"images": {"a.png": {"chart": SQUARE}}}))
    whole, half = load(tmp_path)["a.png"], load(tmp_path, image_scale=0.5)["a.png"]
    assert (half.camera.width, half.camera.height) == (WIDTH // 2, HEIGHT // 2)
    blocks = whole.rgb.reshape(HEIGHT // 2, 2, WIDTH // 2, 2, 3).mean(axis=(1, 3))
    np.testing.assert_allclose(half.rgb, blocks, atol=1e-6)
    np.testing.assert_array_equal(half.reference, half.rgb)
    assert pixel_of(half, [1, 2, 10]) == pytest.approx(pixel_of(whole, [1, 2, 10]) / 2)
    np.testing.assert_allclose(half.charts[0].corners, np.array(SQUARE) / 2)
    assert np.isin(half.depth, whole.depth).all(), "nearest: no depth that was not measured"
    assert np.abs(half.depth[:, 1:] - whole.depth[::2, 2::2]).max() < 0.0015, (
        "within a pixel of its place"
    )


def test_an_uneven_image_scale_keeps_the_fields_of_view(tmp_path: Path) -> None:
    write_dive(tmp_path)
    camera = load(tmp_path, image_scale=0.33)["a.png"].camera
    assert (camera.width, camera.height) == (13, 10)
    assert camera.K[0, 0] / camera.width == pytest.approx(50 / WIDTH)
    assert camera.K[1, 1] / camera.height == pytest.approx(60 / HEIGHT)


def test_data_id_is_the_same_for_a_copy_and_for_either_form_of_the_model(
    tmp_path: Path,
) -> None:
    one = load(write_dive(tmp_path / "one"))
    shutil.copytree(tmp_path / "one", tmp_path / "two words")
    to_binary(tmp_path / "two words" / "sparse")
    two = load(tmp_path / "two words")
    assert (one.name, two.name) == ("one", "two words")
    assert one.data_id == two.data_id
    assert len(one.data_id) == 12


def test_data_id_changes_with_the_data(tmp_path: Path) -> None:
    """With an image, a pose, a depth, and with whether a depth map is there."""
    root = write_dive(tmp_path)
    changes: list[Callable[[], object]] = [
        lambda: write_image(root / "images/a.png", picture(7)),
        lambda: write_model(root / "sparse", [("a.png", FORWARD, 1), ("b.png", SIDEWAYS, 1)]),
        lambda: write_image(root / "depths/depth_b.png", depth_mm() + 1),
        (root / "depths/depth_b.png").unlink,
    ]
    ids = {load(root).data_id}
    for change in changes:
        change()
        ids.add(load(root).data_id)
    assert len(ids) == 5


def test_a_text_model_with_a_byte_order_mark_is_read(tmp_path: Path):
    """As editors of Windows save text."""
    write_dive(tmp_path)
    for name in ("cameras.txt", "images.txt"):
        path = tmp_path / "sparse" / name
        path.write_text(path.read_text().removeprefix("# a comment\n"), encoding="utf-8-sig")
    (scene,) = Colmap(root=tmp_path).scenes()
    assert [view.name for view in scene.views] == ["a.png", "b.png"]
