"""What the colmap dataset says of bad input: one line with the file, what is wrong and what to do."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

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
from support.messages import Lines
from support.miniatures import Change, loader, one_line, scene_fault_test, view_fault_test

from sucre_bench.datasets.colmap import Colmap
from sucre_bench.machine.progress import watched_by

load = loader(Colmap)


# -- faults of the whole dataset: scenes() raises -----------------------------------------------------------


def text(name: str, content: str) -> Change:
    return lambda root: (root / name).write_text(content)


def cameras(*lines: str) -> Change:
    return lambda root: write_model(root / "sparse", [("a.png", FORWARD, 1)], lines)


def images(*rows: tuple[str, tuple[float, ...], int]) -> Change:
    return lambda root: write_model(root / "sparse", rows)


def charts(content: object) -> Change:
    return lambda root: (root / "charts.json").write_text(json.dumps(content))


def chart(entry: object) -> Change:
    return charts({"images": {"a.png": {"left": entry}}})


def misname_depths(root: Path) -> None:
    for path in (root / "depths").iterdir():
        path.rename(path.with_name("z" + path.name))


IN = [(4.0, 2.0), (20.0, 3.0), (21.0, 12.0), (5.0, 11.0)]

DATASET: dict[str, tuple[Change, list[str]]] = {
    "no images": (
        lambda root: shutil.rmtree(root / "images"),
        ["images: none of the model's 2 images", "a.png"],
    ),
    "no sparse": (
        lambda root: shutil.rmtree(root / "sparse"),
        ["sparse: no such folder", "cameras.bin"],
    ),
    "no registered image": (images(), ["images.txt: no image is registered", "mapper"]),
    "distorted": (
        cameras(f"1 OPENCV {WIDTH} {HEIGHT} 50 50 20 15 0 0 0 0"),
        [
            "cameras.txt: camera 1 is OPENCV",
            "colmap image_undistorter --image_path ",
            "--output_type COLMAP",
        ],
    ),
    "too few parameters": (
        cameras(f"1 PINHOLE {WIDTH} {HEIGHT} 50 20 15"),
        ["cameras.txt", "model_converter"],
    ),
    "no focal length": (
        cameras(f"1 PINHOLE {WIDTH} {HEIGHT} 0 50 20 15"),
        ["camera 1", "which no camera has"],
    ),
    "camera not there": (
        cameras(CAMERA.replace("1 ", "2 ", 1)),
        ["images.txt: image 'a.png' has camera 1"],
    ),
    "null quaternion": (images(("a.png", (0.0,) * 7, 1)), ["image 'a.png'", "no usable pose"]),
    "name twice": (
        images(("a.png", FORWARD, 1), ("a.png", FORWARD, 1)),
        ["image 'a.png' is there twice"],
    ),
    "name above the root": (
        images(("../../etc/x.png", FORWARD, 1)),
        ["'../../etc/x.png' is outside", "relative"],
    ),
    "absolute name": (
        images(("/etc/x.png", FORWARD, 1)),
        ["images: none of the model's 1 images", "etc/x.png"],
    ),
    "two names of one image": (
        images(("/left/a.png", FORWARD, 1), ("C:\\right\\a.png", FORWARD, 1)),
        ["images/a.png: is the image of 'C:\\right\\a.png' and of another name"],
    ),
    "name of the root": (
        images((".", FORWARD, 1)),
        ["image '.' is outside", "no file", "relative"],
    ),
    "no points lines": (
        text(
            "sparse/images.txt", f"1 1 0 0 0 0 0 0 1 a.png\n2 1 0 0 0 0 0 0 1 b.png\n{CAMERA}\n"
        ),
        ["images.txt", "after image 'a.png' stands no line of points"],
    ),
    "short image line": (
        text("sparse/images.txt", "1 1 0 0 0 a.png\n\n"),
        ["images.txt", "1 1 0 0 0 a.png"],
    ),
    "depths misnamed": (
        misname_depths,
        ["depths: no depth map is named after an image", "depth_a.png"],
    ),
    "empty reference": (
        lambda root: (root / "reference").mkdir(),
        ["reference: no file is named", "a.png"],
    ),
    "charts: not JSON": (
        text("charts.json", '{"images": '),
        ["charts.json: cannot be read", "line 1"],
    ),
    "charts: no images": (charts({"a.png": {}}), ["charts.json: no charts by image", "write"]),
    "charts: image unknown": (
        charts({"images": {"aa.png": {"left": IN}}}),
        ["charts.json: 'aa.png'", "like 'a.png'"],
    ),
    "charts: kind unknown": (
        chart({"kind": "dkg", "corners": IN}),
        ["charts.json: a.png, left", "'dkg'", "'dgk'"],
    ),
    "charts: outside": (
        chart([IN[0], (41.0, 3.0), *IN[2:]]),
        ["charts.json: a.png, left: a corner", "40x30"],
    ),
}


test_a_fault_of_the_dataset_is_one_line_with_file_and_remedy = scene_fault_test(
    write_dive, load, DATASET
)


@pytest.mark.parametrize("name", ["cameras.bin", "images.bin"])
def test_a_binary_model_cut_anywhere_is_refused(tmp_path: Path, name: str) -> None:
    write_dive(tmp_path, ["a.png", "b.png", "c.png"])
    to_binary(tmp_path / "sparse")
    path = tmp_path / "sparse" / name
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with one_line(str(path), "breaks off", "model_converter"):
            load(tmp_path)
    path.write_bytes(whole)
    assert len(load(tmp_path)) == 3


def test_a_text_model_cut_between_images_says_that_it_may_be_cut(tmp_path: Path) -> None:
    write_dive(tmp_path, ["a.png", "b.png", "c.png"])
    path = tmp_path / "sparse" / "images.txt"
    whole = f"# Number of images: 3, mean observations per image: 1\n{path.read_text()}"
    for content, n in ((whole, 3), (whole[: whole.index("3 ", whole.index("b.png"))], 2)):
        path.write_text(content)
        with watched_by(said := Lines()):
            assert len(load(tmp_path)) == n
        assert any("2 of the 3 images" in line for line in said.lines) == (n == 2)


# -- faults of one view: its pixels raise, the other view goes on --------------------------------------------


def replaced(name: str, write: Callable[[Path], Any]) -> Change:
    """Take away the depth map of a.png and write another file."""

    def change(root: Path) -> None:
        (root / "depths/depth_a.png").unlink()
        write(root / name)

    return change


def image(values: np.ndarray) -> Change:
    return lambda root: write_image(root / "images/a.png", values)


def depth_png(values: np.ndarray) -> Change:
    return replaced("depths/depth_a.png", lambda path: write_image(path, values))


def depth_npy(values: np.ndarray) -> Change:
    return replaced("depths/depth_a.npy", lambda path: np.save(path, values))


METRES = np.full((HEIGHT, WIDTH), 2.5)

VIEW: dict[str, tuple[str, Change, list[str]]] = {
    "depth 8-bit": (
        "depth",
        depth_png(np.ones((HEIGHT, WIDTH), np.uint8)),
        ["uint8", "16-bit millimetres"],
    ),
    "depth in colour": (
        "depth",
        depth_png(np.dstack([depth_mm()] * 3)),
        ["30x40x3", "one channel"],
    ),
    "depth all 0": ("depth", depth_png(0 * depth_mm()), ["depth_a.png: no pixel has a depth"]),
    "depth all NaN": (
        "depth",
        depth_npy(np.nan * METRES),
        ["depth_a.npy: no pixel has a depth"],
    ),
    "depth negative": (
        "depth",
        depth_npy(-METRES),
        ["depth_a.npy: depth -2.5 m is negative", "write 0"],
    ),
    "depth in mm": (
        "depth",
        depth_npy(1000 * METRES),
        ["depth_a.npy: depth up to 2500 m", "divide by 1000"],
    ),
}


test_a_fault_of_one_view_is_raised_with_its_pixels_and_other_views_go_on = view_fault_test(
    write_dive, load, VIEW
)


@pytest.mark.parametrize(("missing", "views"), [(4, 6), (101, 3)])
def test_of_very_many_missing_images_one_is_a_view_that_says_how_many_are(
    tmp_path: Path, missing: int, views: int
):
    """A model of 100,000 images of which 4 were copied is no reason for 99,996 failed views."""
    names = ["a.png", *(f"b{n:03}.png" for n in range(missing)), "c.png"]
    root = write_dive(tmp_path, names)
    for name in names[1:-1]:
        (root / f"images/{name}").unlink()
    scene = load(root)
    assert len(scene) == views
    assert [scene[n].name for n in (0, 1, -1)] == ["a.png", "b000.png", "c.png"]
    with one_line(
        "images/b000.png: no such file",
        f"{missing} of the model's {missing + 2}",
        "b000.png, b001.png",
    ):
        _ = scene["b000.png"].rgb


def test_an_image_of_floats_is_refused(tmp_path: Path) -> None:
    """Its range is anybody's guess."""
    root = write_dive(tmp_path, ["a.tif"])
    tifffile.imwrite(root / "images/a.tif", picture(0).astype(np.float32), photometric="rgb")
    with one_line("images/a.tif: is float32", "8 or 16 bits"):
        _ = load(root)["a.tif"].rgb


def test_a_cut_file_is_refused_wherever_it_is_cut(tmp_path: Path) -> None:
    """Decoders that fill up the rest with gray would hand a wrong image on."""
    root = write_dive(tmp_path, ["a.png", "a.jpg"])
    shutil.rmtree(root / "depths")
    for name in ("a.png", "a.jpg"):
        path = root / "images" / name
        whole = path.read_bytes()
        for length in np.linspace(0, len(whole) - 20, 25).astype(int):
            path.write_bytes(whole[:length])
            with one_line(name, "copy"):
                _ = load(root)[name].rgb
        path.write_bytes(whole)
        assert load(root)[name].rgb.shape == (HEIGHT, WIDTH, 3)
