"""Depth maps in OpenEXR files."""

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.miniatures import check_message

from sucre_bench.errors import DamagedFileError, InputError
from sucre_bench.loading.depth_maps import read_depth

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
    depth = read_depth(write(tmp_path / "a.exr", {"A": 0 * METRES, "R": METRES + 1, "Z": METRES}))
    np.testing.assert_array_equal(depth, METRES)


def test_a_file_cut_anywhere_is_refused(tmp_path: Path) -> None:
    path = write(tmp_path / "a.exr", {"Z": METRES})
    whole = path.read_bytes()
    for length in (0, 3, 50, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(DamagedFileError) as fault:
            read_depth(path)
        check_message(str(fault.value), "a.exr: ", "copy")


def test_channels_without_a_depth_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"a\.exr: has channels A, G; write"):
        read_depth(write(tmp_path / "a.exr", {"A": METRES, "G": METRES}))


def test_without_the_package_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(InputError, match="pip install OpenEXR"):
        read_depth(tmp_path / "a.exr")
