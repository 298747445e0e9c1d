"""Any COLMAP reconstruction with depth maps, in the layout SUCRe reads.

root/images/<name>          8- or 16-bit PNG, TIFF or JPEG; sub-folders and many cameras are fine
root/sparse/ or sparse/0/   cameras and images, .bin or .txt, PINHOLE or SIMPLE_PINHOLE
root/depths/                optional: depth_<stem>.png and other forms, see `loading.depth_maps`; or COLMAP's own
                            stereo/depth_maps/<name>.geometric.bin, else .photometric.bin
root/reference/<name>       optional: the image without water
root/charts.json            optional: colour charts, see `sucre_bench.loading.charts_file`

With undistort=true cameras may be SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE or
RADIAL_FISHEYE as well. Images, references and the corners of charts are then those of the distorted image, as it is
stored, and are undistorted on the way. Depth maps are of the undistorted image, see `sucre_bench.loading.lens`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sucre_bench import InputError, dataset
from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.colmap_model import read_model, registered_scene
from sucre_bench.loading.find_folders import chosen, existing
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.scene import Encoding, Scene


@dataset(
    requires=PICTURE_READERS,
    has=("poses", "depth", "reference", "charts"),
    charts_file="charts",
    signs=("sparse/cameras.*", "sparse/0/cameras.*"),
)
@dataclass(frozen=True)
class Colmap(ImageScaleOption):
    """A COLMAP reconstruction with depth maps: one scene, one view a registered image, in order of name."""

    root: Path
    """The folder that holds images/, sparse/ and, if there are any, depths/, reference/ and charts.json."""
    images: str = "images"
    """Folder of the images, in root; undistorted ones, unless `undistort` is given."""
    depths: str = "depths"
    """Folder of the depth maps, in root; need not exist. Without it, COLMAP's stereo/depth_maps is read."""
    sparse: str = "sparse"
    """Folder of the COLMAP model, in root; its sub-folder 0 is tried too."""
    reference: str = "reference"
    """Folder of images without water, in root, named and sized like the images; need not exist."""
    charts: str = "charts.json"
    """File of the charts' corners, in root; need not exist."""
    undistort: bool = False
    """Undistort images, references and chart corners while loading, if the model's cameras are distorted. Depth maps
    must be of undistorted images."""
    encoding: Encoding = "gamma"
    """How images and references are encoded: "gamma" (sRGB-like) or "linear"."""

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads the model, headers and samples of files, no more.

        Raises InputError for what concerns all views: no model, a distorted camera, no image at all, a wrong
        charts.json. What is wrong with the files of one view is raised when they are loaded.
        """
        root = existing(self.root, f"{self.images}/")
        images, sparse, depths, references = (
            chosen(self, root, option, "folder")
            for option in ("images", "sparse", "depths", "reference")
        )
        if not depths.is_dir():
            depths = root / "stereo" / "depth_maps"
        remedy = "" if self.undistort else "add dataset.undistort=true,"
        posed = read_model(sparse, images, self.undistort, remedy)
        names = [image.name for image in posed]
        if not any((images / name).is_file() for name in names):
            fault = f"none of the model's {len(names)} images is there, not even {names[0]}"
            raise InputError(
                f"{images}: {fault}; put them there or name their folder with dataset.images=..."
            )
        found = {name: references / name for name in names if (references / name).is_file()}
        if references.is_dir() and not found:
            raise InputError(
                f"{references}: no file is named like an image; name them like {names[0]}"
            )
        yield registered_scene(
            root.resolve().name,
            posed,
            {name: images / name for name in names},
            depths,
            self.image_scale,
            self.encoding,
            references=found,
            charts=chosen(self, root, "charts", "file"),
        )
