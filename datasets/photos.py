"""Any folder of images, without depth or camera; optional references and colour charts.

root/a.png                8- or 16-bit PNG, TIFF or JPEG
root/reference/a.png      optional: the same view without water; of the image's size or larger, of any suffix
root/charts.json          optional: colour charts, see `sucre_bench.loading.charts_file`

And three published sets of single images. Where they have references, these are the best liked of many methods'
results, not the scene without water. Scores against them say how near a method comes to that taste.

LSUI   input/1.jpg                  the photograph
       GT/1.jpg                     its reference
       train/input ...              or one such pair of folders for each part of one's own split
       Peng, Zhu & Bian, U-shape Transformer for underwater image enhancement, IEEE TIP 2023
U45    upload/U45/U45/1.png         256x256; or any folder that holds the images
       Li, Li & Wang, A fusion adversarial underwater image enhancement network with a public test dataset, 2019
UIEB   raw-890/1_img_.png           the photograph (or raw/; raw-890/raw-890/ as some archives unpack)
       reference-890/1_img_.png     its reference
       challenging-60/...           photographs for which no version was found good enough: no reference
       Li et al., An underwater image enhancement benchmark dataset and beyond, IEEE TIP 2020
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.imaging.image_files import PICTURE_READERS, SUFFIXES
from sucre_bench.loading.find_folders import chosen, existing, folders_below, scene_name
from sucre_bench.loading.image_folder import (
    SplitOption,
    image_folder_scene,
    image_names,
    paired_folders,
)
from sucre_bench.loading.named_sets import IncompleteSetError
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.plugin import dataset
from sucre_bench.scene import Encoding, Scene


@dataset(
    requires=PICTURE_READERS,
    has=("reference",),
    cites="Peng, Zhu & Bian 2023, IEEE TIP (U-shape Transformer)",
    licence="as its download page says",
    source="https://lintaopeng.github.io/_pages/UIE%20Project%20Page.html (4,279 pairs)",
    proven="has read 400 released pairs",
    signs=("GT", "*/GT"),
)
@dataclass(frozen=True)
class Lsui(ImageScaleOption, SplitOption):
    """The LSUI photographs: one scene for each folder that holds input/ and GT/, single images with references."""

    root: Path
    """The folder that holds input/ and GT/, or a folder above it; of a split, the part to take or all of it."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each part; with split, for each that has the whole set.

        Reads headers and samples of files. InputError when a folder is missing, or no part has the whole set.
        """
        root = existing(self.root)
        found = False
        lacking = list[InputError]()
        for place, images, references in paired_folders(root, ("input",), ("gt", "reference")):
            try:
                if references is None:
                    remedy = f"unpack the references there, beside {images}"
                    raise MissingFileError("no such folder", place / "GT", remedy)
                scene = image_folder_scene(
                    scene_name(place, root),
                    images,
                    references,
                    self.image_scale,
                    split=self.split,
                )
            except (IncompleteSetError, MissingFileError) as fault:
                if not self.split:
                    raise
                lacking.append(fault)
                continue
            found = True
            yield scene
        if lacking and not found:
            raise max(lacking, key=lambda fault: getattr(fault, "found", -1))
        if not found:
            raise InputError(
                f"{root}: holds no folder input; unpack it there, or give the folder that holds it"
            )


@dataset(
    requires=PICTURE_READERS,
    cites="Li, Li & Wang 2019, arXiv:1906.06819",
    licence="as its download page says",
    source="https://github.com/IPNUISTlegal/underwater-test-dataset-U45- (45 images of 256x256)",
    proven="has read all 45 released images",
    signs=("U45", "*/U45"),
)
@dataclass(frozen=True)
class U45(ImageScaleOption, SplitOption):
    """The U45 test images, one scene: single images without depth or reference."""

    root: Path
    """The download, or the folder of the images itself."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene. Reads headers and samples of files. InputError when there is no image."""
        root = existing(self.root)
        named = folders_below(
            root, lambda place, _: place.name.lower() == "u45" and bool(image_names(place))
        )
        folder = next(named, root)  # the download holds results of other methods beside it
        if not image_names(folder):
            raise InputError(
                f"{root}: holds no image, nor a folder U45 of images; give the folder of 1.png to 45.png"
            )
        yield image_folder_scene("U45", folder, image_scale=self.image_scale, split=self.split)


_RAW = ("raw-890", "raw890", "raw")
_REFERENCES = ("reference-890", "reference890", "reference")
_CHALLENGING = ("challenging-60", "challengingset-60", "challenging")


@dataset(
    requires=PICTURE_READERS,
    has=("reference",),
    cites="Li, Guo, Ren, Cong, Hou, Kwong & Tao 2020, IEEE TIP (UIEB)",
    licence="as its download page says",
    source="https://li-chongyi.github.io/proj_benchmark.html (890 pairs, 60 images without a reference)",
    proven="has read 90 released pairs, under other names",
    signs=("raw-890", "*/raw-890"),
)
@dataclass(frozen=True)
class Uieb(ImageScaleOption, SplitOption):
    """The UIEB photographs, one scene: single images without depth, with references that people chose."""

    root: Path
    """The folder that holds raw-890/ and reference-890/, or a folder above it."""
    subset: Literal["paired", "challenging"] = "paired"
    """ "paired": the 890 with references; "challenging": the 60 without."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the subset's scene. Reads headers and samples of files. InputError when a folder is missing."""
        root = existing(self.root)
        paired = self.subset == "paired"
        names = _RAW if paired else _CHALLENGING
        found = next(paired_folders(root, names, _REFERENCES), None)
        if found is None:
            raise InputError(
                f"{root}: holds no folder {names[0]}; unpack it there, or give the folder that holds it"
            )
        place, images, references = found
        if paired and references is None:
            raise MissingFileError(
                "no such folder", place / _REFERENCES[0], f"unpack it there, beside {images}"
            )
        targets = references if paired else None
        yield image_folder_scene(
            self.subset, images, targets, self.image_scale, split=self.split
        )


@dataset(
    requires=PICTURE_READERS,
    has=("reference", "charts"),
    source="your own images",
    charts_file="charts",
    signs=tuple(f"*{suffix}" for small in SUFFIXES for suffix in (small, small.upper())),
)
@dataclass(frozen=True)
class Photos(ImageScaleOption, SplitOption):
    """The images in a folder, one scene, in order of name, for methods that need no depth.

    References and colour charts are optional; metrics that need them are skipped without them.
    """

    root: Path
    """The folder of the images."""
    reference: str = "reference"
    """Folder of images without water, named like the images: in root, or a path of its own; need not exist."""
    charts: str = "charts.json"
    """File of the charts' corners: in root, or a path of its own; need not exist."""
    subfolders: bool = False
    """Also read the images in sub-folders."""
    encoding: Encoding = "gamma"
    """How images and references are encoded: "gamma" (sRGB-like) or "linear"."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads headers and samples of files, decodes nothing.

        Raises InputError when there is no image, when the references are not these images', and when the file of charts
        is wrong.
        """
        root = existing(self.root)
        references = chosen(self, root, "reference", "folder")
        yield image_folder_scene(
            root.resolve().name,
            root,
            references if references.is_dir() else None,
            self.image_scale,
            self.encoding,
            self.subfolders,
            chosen(self, root, "charts", "file"),
            self.split,
        )
