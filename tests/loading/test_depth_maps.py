"""Depth maps in the formats of other programs."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from support.miniatures import check_message

from sucre_bench.errors import DamagedFileError, InputError
from sucre_bench.loading.depth_maps import find_depths, read_depth

METRES = np.random.default_rng(0).uniform(0.5, 9, (30, 40)).astype(np.float32)


def write(path: Path, channels: dict[str, np.ndarray]) -> Path:
    exr = pytest.importorskip("OpenEXR", reason="OpenEXR is not installed")
    header = {"compression": exr.ZIP_COMPRESSION, "type": exr.scanlineimage}
    with exr.File(header, channels) as file:
        file.write(str(path))
    return path


@pytest.mark.parametrize("dtype", [np.float32, np.float16])
def test_the_only_channel_is_the_depth(tmp_path: Path, dtype: Any) -> None:
    depth = read_depth(write(tmp_path / "a.exr", {"whatever": METRES.astype(dtype)}))
    assert depth.dtype == np.float32
    np.testing.assert_array_equal(depth, METRES.astype(dtype))


def test_of_several_channels_it_is_z(tmp_path: Path) -> None:
    depth = read_depth(
        write(tmp_path / "a.exr", {"A": 0 * METRES, "R": METRES + 1, "Z": METRES})
    )
    np.testing.assert_array_equal(depth, METRES)


def test_channels_without_a_depth_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.exr: has channels A, G; write"):
        read_depth(write(tmp_path / "a.exr", {"A": METRES, "G": METRES}))


def test_without_the_package_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(InputError, match="pip install OpenEXR"):
        read_depth(tmp_path / "a.exr")


MILLIMETRES = np.rint(1000 * METRES).astype(np.uint16)
FORMS: dict[str, Callable[[Path], object]] = {
    # rows from the bottom
    "a.pfm": lambda path: path.write_bytes(b"Pf\n40 30\n-1.0\n" + METRES[::-1].tobytes()),
    # Middlebury's scale is 1 / the largest value, and nobody applies it
    "depth_a.pfm": lambda path: path.write_bytes(
        b"Pf\n40 30\n0.25\n" + METRES[::-1].astype(">f4").tobytes()
    ),
    "a.exr": lambda path: write(path, {"Z": METRES}),
    "a.jpg.geometric.bin": lambda path: path.write_bytes(b"40&30&1&" + METRES.tobytes()),
    "a.jpg.photometric.bin": lambda path: path.write_bytes(b"40&30&1&" + METRES.tobytes()),
    "a.npy": lambda path: np.save(path, METRES[None]),
    "a.npz": lambda path: np.savez(path, depth=METRES[..., None]),
    "depth_a.npy": lambda path: np.save(path, MILLIMETRES.astype(np.int32)),
    "deptha.png": lambda path: cv2.imwrite(str(path), MILLIMETRES),
}


@pytest.mark.parametrize(("name", "write_it"), FORMS.items(), ids=list(FORMS))
def test_a_map_is_found_and_read_in_metres(
    tmp_path: Path, name: str, write_it: Callable[[Path], object]
) -> None:
    write_it(tmp_path / name)
    path = find_depths(tmp_path, ["a.jpg"])["a.jpg"]
    assert isinstance(path, Path)
    np.testing.assert_allclose(read_depth(path), METRES, atol=0.0005)


def test_of_two_maps_by_colmap_the_filtered_one_is_taken(tmp_path: Path) -> None:
    for kind in ("photometric", "geometric"):
        FORMS["a.jpg.geometric.bin"](tmp_path / f"a.jpg.{kind}.bin")
    assert find_depths(tmp_path, ["a.jpg"]) == {"a.jpg": tmp_path / "a.jpg.geometric.bin"}


@pytest.mark.parametrize("name", ["a.exr", "a.jpg.geometric.bin"])
def test_a_file_cut_anywhere_is_refused(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    FORMS[name](path)
    whole = path.read_bytes()
    for length in (0, 3, 50, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DamagedFileError) as fault:
            read_depth(path)
        check_message(str(fault.value), f"{name}: ", "copy")


@pytest.mark.parametrize(
    ("values", "none"),
    [(MILLIMETRES, 65535), (METRES, 99999), (METRES, 1000), (METRES, np.inf), (METRES, 100)],
)
def test_a_value_that_means_none_is_no_depth(
    tmp_path: Path, values: np.ndarray, none: float
) -> None:
    values = values.copy()
    values[:10] = none
    np.save(tmp_path / "a.npy", values)
    depth = read_depth(tmp_path / "a.npy")
    assert not (np.isfinite(depth[:10]) & (depth[:10] > 0)).any()
    np.testing.assert_allclose(depth[10:], METRES[10:], atol=0.0005)


def test_a_far_wall_and_a_single_far_pixel_stay(tmp_path: Path) -> None:
    wall, pixel = METRES.copy(), METRES.copy()
    wall[:10], pixel[3, 3] = 40, 900
    for values in (wall, pixel, np.full((30, 40), 3, np.float32)):
        np.save(tmp_path / "a.npy", values)
        np.testing.assert_array_equal(read_depth(tmp_path / "a.npy"), values)
