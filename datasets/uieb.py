"""UIEB: photographs of the web in all kinds of water, and of each the enhanced version that people liked best.

    raw-890/1_img_.png              the photograph (or raw/; raw-890/raw-890/ as some archives unpack)
    reference-890/1_img_.png        its reference
    challenging-60/...              photographs for which no version was found good enough: no reference

A reference is the best liked of twelve methods' results, not the scene without water: scores against it say how near a
method comes to that taste.
Source: Li et al., An underwater image enhancement benchmark dataset and beyond, IEEE TIP 2020.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.loading.find_folders import existing
from sucre_bench.loading.image_folder import image_folder_scene, paired_folders
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.decorators import dataset
from sucre_bench.scene import Scene

_RAW = ("raw-890", "raw890", "raw")
_REFERENCES = ("reference-890", "reference890", "reference")
_CHALLENGING = ("challenging-60", "challengingset-60", "challenging")


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    has=("reference",),
    cites="Li, Guo, Ren, Cong, Hou, Kwong & Tao 2020, IEEE TIP (UIEB)",
    licence="as its download page says",
    source="https://li-chongyi.github.io/proj_benchmark.html (890 pairs, 60 images without a reference)",
    signs=("raw-890", "*/raw-890"),
)
@dataclass(frozen=True)
class Uieb(ImageScaleOption):
    """The UIEB photographs, one scene: single images without depth, with references that people chose."""

    root: Path
    """The folder that holds raw-890/ and reference-890/, or a folder above it."""
    subset: Literal["paired", "challenging"] = "paired"
    """ "paired": the 890 with references; "challenging": the 60 without."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the subset's scene. Reads headers and samples of files. InputError when a folder is missing."""
        root, paired = existing(self.root), self.subset == "paired"
        names = _RAW if paired else _CHALLENGING
        found = next(paired_folders(root, names, _REFERENCES), None)
        if found is None:
            raise InputError(f"{root}: holds no folder {names[0]}; unpack it there, or give the folder that holds it")
        place, images, references = found
        if paired and references is None:
            raise MissingFileError(
                "no such folder", place / _REFERENCES[0], f"unpack the references there, beside {images}"
            )
        yield image_folder_scene(self.subset, images, references if paired else None, self.image_scale)
