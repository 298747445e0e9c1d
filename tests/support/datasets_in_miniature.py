"""Every built-in dataset in miniature, of at least two views: who writes it, and which of its files a fault can hit."""

from __future__ import annotations

import runpy
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from support.miniatures import write_images
from support.places import ROOT


def _photographs(*places: str) -> Callable[[Path], Any]:
    def write(folder: Path) -> None:
        for place in places:
            write_images(folder / place, "1.png", "2.png")

    return write


def _of_test(file: str, function: str) -> Callable[[Path], Any]:
    return lambda folder: runpy.run_path(str(ROOT / "tests" / file))[function](folder)


@dataclass(frozen=True)
class Miniature:
    """A dataset in miniature.

    write: writes it into a folder; below: that folder, below the root; image, depth, about: patterns of files below it:
    of the first view's image, of its depth map, "" for none, and of what describes the whole dataset.
    """

    write: Callable[[Path], Any]
    image: str
    depth: str = ""
    about: tuple[str, ...] = ()
    below: str = ""

    def write_into(self, root: Path) -> None:
        """Write it: the dataset's option `root` opens it."""
        (root / self.below).parent.mkdir(parents=True, exist_ok=True)
        self.write(root / self.below)

    def file(self, root: Path, pattern: str) -> Path:
        """The first file of a pattern."""
        return min((root / self.below).glob(pattern))


_SUPPORT = "support/miniatures.py"
MINIATURES = {
    "aqualoc": Miniature(
        _of_test("datasets/test_aqualoc.py", "write_site"),
        "raw_data/*/frame*.png",
        about=("harbor_calibration_files/*.yaml",),
    ),
    "colmap": Miniature(
        _of_test("support/colmap_folder.py", "write_dive"),
        "images/*",
        "depths/*",
        ("sparse/images.txt",),
    ),
    "eiffel_tower": Miniature(
        _of_test(_SUPPORT, "write_year"), "2015/images/*", about=("2015/sfm/cameras.txt",)
    ),
    "flsea": Miniature(
        _of_test("datasets/test_flsea.py", "write_dive"),
        "canyons/flatiron/flatiron/imgs/*",
        "canyons/flatiron/flatiron/depth/*",
        ("canyons/calibration/*.txt",),
    ),
    "lsui": Miniature(_photographs("input", "GT"), "input/*"),
    "metashape": Miniature(
        _of_test(_SUPPORT, "write_survey"), "images/*", "depths/*", ("cameras.xml",)
    ),
    "nerfstudio": Miniature(
        _of_test("datasets/test_nerfstudio.py", "write_scene"),
        "images/*",
        "depths/*",
        ("transforms.json",),
    ),
    "openmvs": Miniature(
        _of_test("datasets/test_openmvs.py", "write_scene"), "images/*", "*.dmap"
    ),
    "photos": Miniature(_photographs(""), "*.png"),
    "seathru": Miniature(_of_test(_SUPPORT, "write_set"), "linearPNG/*", "depth/*", below="D1"),
    "seathru_nerf": Miniature(
        _of_test(_SUPPORT, "write_reef"),
        "images_wb/*",
        about=("sparse/0/images.bin",),
        below="Panama",
    ),
    "squid": Miniature(
        _of_test("datasets/test_squid.py", "write_site"),
        "image_set_01/*.tif",
        about=("image_set_01/*.mat", "*.mat"),
        below="Katzaa",
    ),
    "u45": Miniature(_photographs("U45"), "U45/*"),
    "uieb": Miniature(_photographs("raw-890", "reference-890"), "raw-890/*"),
    "varos": Miniature(
        _of_test("datasets/test_varos.py", "write_dive"),
        "A/*",
        "D/*",
        ("camM0.yaml", "camM0_timestamps.csv", "camM0_poses/*.csv"),
        below="2021-08-17_SEQ1/vehicle0/cam0",
    ),
}
