"""Pixels from a store are those of the files, to the last bit."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from sucre_bench import View
from sucre_bench.degrade import degraded
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import OF_JPEG, write_png
from sucre_bench.loading.view_files import Files, with_shared_pixels
from sucre_bench.machine.cache import ArrayStore, storing
from sucre_bench.scene import Scene

W = 400
H = 300


@pytest.fixture(params=[np.uint8, np.uint16])
def files(request: pytest.FixtureRequest, tmp_path: Path) -> Files:
    rng = np.random.default_rng(0)
    most = np.iinfo(request.param).max
    cv2.imwrite(
        str(tmp_path / "a.png"),
        rng.integers(0, most, (H, W, 3), endpoint=True, dtype=request.param),
    )
    cv2.imwrite(str(tmp_path / "depth.png"), rng.integers(0, 5000, (H, W), dtype=np.uint16))
    return Files(tmp_path / "a.png", (W, H), depth=tmp_path / "depth.png")


def _shared(files: Files) -> View:
    return with_shared_pixels(
        Scene("reef", [View("a.png", files)], frozenset(), data_id="1")
    ).views[0]


def test_stored_planes_equal_decoded_ones_bit_by_bit(files: Files, tmp_path: Path):
    plain, stored = View("a.png", files), _shared(files)
    with storing(ArrayStore(tmp_path / "store", 1e9)):
        for _ in range(2):  # made, then found
            assert np.array_equal(plain.rgb, stored.rgb)
            assert np.array_equal(plain.depth, stored.depth)
            assert stored.rgb.dtype == stored.depth.dtype == np.float32
            assert stored.reference is None
            stored = _shared(files)
        levels = stored.levels
        if cv2.imread(str(files.image), cv2.IMREAD_UNCHANGED).dtype == np.uint8:
            assert levels is not None
            assert np.array_equal(levels, cv2.imread(str(files.image))[..., ::-1])
        else:
            assert levels is None
    assert _shared(files).levels is None
    assert np.array_equal(_shared(files).rgb, plain.rgb)


def test_faults_of_files_are_raised_each_time(tmp_path: Path):
    view = _shared(Files(tmp_path / "none.png", (W, H)))
    with storing(ArrayStore(tmp_path / "store", 1e9)):
        for _ in range(2):
            with pytest.raises(InputError, match=r"none\.png"):
                _ = view.rgb


@pytest.mark.parametrize(
    ("name", "suffix", "is_jpeg"),
    [("a.png", ".jpg", True), ("a.jpg", ".png", False), ("b.png", "", True)],
)
def test_a_jpeg_is_known_by_its_content_and_a_png_that_was_made_of_one(
    tmp_path: Path, name: str, suffix: str, is_jpeg: bool
):
    if suffix:
        content = cv2.imencode(suffix, np.zeros((H, W, 3), np.uint8))[1]
        (tmp_path / name).write_bytes(bytes(content))
    else:
        write_png(tmp_path / name, np.full((H, W, 3), 7, np.uint8), chunk=OF_JPEG)
        assert (
            np.asarray(Image.open(tmp_path / name)).tolist() == np.full((H, W, 3), 7).tolist()
        )
    view = _shared(Files(tmp_path / name, (W, H)))
    assert view.is_jpeg is is_jpeg
    assert degraded(Scene("reef", [view], frozenset()), jpeg_quality=50)[0].is_jpeg
