"""Any folder of images, without depth or camera; optional references and colour charts.

root/a.png                8- or 16-bit PNG, TIFF or JPEG
root/reference/a.png      optional: the same view without water; of the image's size or larger, of any suffix
root/charts.json          optional: colour charts, see `sucre_bench.loading.charts_file`
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sucre_bench.imaging.image_files import SUFFIXES
from sucre_bench.loading.find_folders import chosen, existing
from sucre_bench.loading.image_folder import image_folder_scene
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.decorators import dataset
from sucre_bench.scene import Encoding, Scene


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    has=("reference", "charts"),
    source="your own images",
    charts_file="charts",
    signs=tuple(f"*{suffix}" for small in SUFFIXES for suffix in (small, small.upper())),
)
@dataclass(frozen=True)
class Photos(ImageScaleOption):
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
        )
