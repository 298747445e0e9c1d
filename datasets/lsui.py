"""LSUI: underwater photographs, and of each the enhanced version that people liked best.

    input/1.jpg       the photograph
    GT/1.jpg          its reference
    train/input ...   or one such pair of folders for each part of one's own split

A reference is the best liked of many methods' results, not the scene without water.
Source: Peng, Zhu & Bian, U-shape Transformer for underwater image enhancement, IEEE TIP 2023.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.loading.find_folders import existing, scene_name
from sucre_bench.loading.image_folder import image_folder_scene, paired_folders
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.decorators import dataset
from sucre_bench.scene import Scene


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    has=("reference",),
    cites="Peng, Zhu & Bian 2023, IEEE TIP (U-shape Transformer)",
    licence="as its download page says",
    source="https://lintaopeng.github.io/_pages/UIE%20Project%20Page.html (4,279 pairs)",
    signs=("GT", "*/GT"),
)
@dataclass(frozen=True)
class Lsui(ImageScaleOption):
    """The LSUI photographs: one scene for each folder that holds input/ and GT/, single images with references."""

    root: Path
    """The folder that holds input/ and GT/, or a folder above it; of a split, the part to take or all of it."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each part. Reads headers and samples of files. InputError when a folder is missing."""
        root, found = existing(self.root), False
        for place, images, references in paired_folders(root, ("input",), ("gt", "reference")):
            found = True
            if references is None:
                raise MissingFileError("no such folder", place / "GT", f"unpack the references there, beside {images}")
            yield image_folder_scene(scene_name(place, root), images, references, self.image_scale)
        if not found:
            raise InputError(f"{root}: holds no folder input; unpack it there, or give the folder that holds it")
