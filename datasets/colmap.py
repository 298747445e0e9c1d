"""Any COLMAP reconstruction with depth maps, in the layout SUCRe reads.

root/images/<name>          8- or 16-bit PNG, TIFF or JPEG; sub-folders and many cameras are fine
root/sparse/ or sparse/0/   cameras and images, .bin or .txt, PINHOLE or SIMPLE_PINHOLE
root/depths/                optional: depth_<stem>.png and other forms, see `sucre_bench.loading.depth`
root/reference/<name>       optional: the image without water
root/charts.json            optional: colour charts, see `sucre_bench.loading.charts_file`

With undistort=true cameras may be SIMPLE_RADIAL, RADIAL, OPENCV, FULL_OPENCV, OPENCV_FISHEYE, SIMPLE_RADIAL_FISHEYE or
RADIAL_FISHEYE as well. Images, references and the corners of charts are then those of the distorted image, as it is
stored, and are undistorted on the way; depth maps are of the undistorted image, see `sucre_bench.loading.lens`.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.errors import InputError
from sucre_bench.images import image_size, same_shape
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.depth import find_depths
from sucre_bench.loading.files import Files, check_scale, data_id_of, scaled_camera, scaled_chart
from sucre_bench.loading.folders import existing
from sucre_bench.plugins import dataset
from sucre_bench.progress import track
from sucre_bench.scene import Chart, Encoding, Plane, Scene, View

__all__ = ["Colmap"]


@dataset(requires=("cv2", "PIL", "tifffile"), has=("poses", "depth", "reference", "charts"))
@dataclass(frozen=True)
class Colmap:
    """A COLMAP reconstruction with depth maps: one scene, one view a registered image, in order of name."""

    root: Path
    """The folder that holds images/, sparse/ and, if there are any, depths/, reference/ and charts.json."""
    images: str = "images"
    """Folder of the images, in root; undistorted ones, unless `undistort` is given."""
    depths: str = "depths"
    """Folder of the depth maps, in root; need not exist."""
    sparse: str = "sparse"
    """Folder of the COLMAP model, in root; its sub-folder 0 is tried too."""
    reference: str = "reference"
    """Folder of images without water, in root, named and sized like the images; need not exist."""
    charts: str = "charts.json"
    """File of the charts' corners, in root; need not exist."""
    image_scale: float = 1.0
    """Shrink images, depth maps, cameras and chart corners by this factor, above 0 up to 1."""
    undistort: bool = False
    """Undistort images, references and chart corners on the way where the model's cameras are distorted; depth maps are
    of undistorted images."""
    encoding: Encoding = "gamma"
    """How images and references are encoded: "gamma" (sRGB-like) or "linear"."""

    def __post_init__(self) -> None:
        check_scale("colmap", self.image_scale)

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads the model and the image headers, decodes nothing.

        Raises InputError for what concerns all views: no model, a distorted camera, no image at all, a wrong
        charts.json. What is wrong with the files of one view is raised when they are loaded.
        """
        root = existing(self.root, f"{self.images}/")
        for option in ("depths", "reference", "charts"):  # they need not exist, unless they were asked for
            given = getattr(self, option)
            if given != getattr(type(self), option) and not (root / given).exists():
                raise InputError(f"{root / given}: is not there; correct or drop dataset.{option}={given}")
        images = root / self.images
        posed = read_model(root / self.sparse, images, distorted=self.undistort)
        names = [image.name for image in posed]
        missing = _missing(images, names)
        sizes = {
            image.name: image_size(images / image.name) or (image.camera.width, image.camera.height)
            for image in track(posed, "image sizes")
        }
        depths, ambiguous = find_depths(root / self.depths, names)
        references = _references(root / self.reference, names)
        charts = read_charts(root / self.charts, sizes)

        views = []
        for image in posed:
            name, size = image.name, sizes[image.name]
            faults: dict[Plane, str] = {}
            if name in missing:
                faults["rgb"] = missing[name]
            elif not same_shape(size, (image.camera.width, image.camera.height)):
                camera_size = f"{image.camera.width}x{image.camera.height}"
                fault = f"is {size[0]}x{size[1]}, its camera in the model {camera_size}"
                faults["rgb"] = f"{images / name}: {fault}; use the images that the model was made of"
            if name in ambiguous:
                faults["depth"] = ambiguous[name]
            camera = scaled_camera(image.camera, size, self.image_scale)
            target = (camera.width, camera.height)
            files = Files(images / name, target, depths.get(name), references.get(name), lens=image.lens, faults=faults)
            seen = tuple(_chart(chart, image, size, target, root / self.charts) for chart in charts.get(name, ()))
            views.append(View(name, files, camera, image.cam_from_world, seen, self.encoding))

        optional = {"depth": depths or ambiguous, "reference": references, "charts": charts}
        has = frozenset({"poses", *(what for what, there in optional.items() if there)})
        yield Scene(root.resolve().name, views, has, data_id=data_id_of(views))


def _chart(chart: Chart, image: Posed, size: tuple[int, int], target: tuple[int, int], path: Path) -> Chart:
    """Bring a chart from the stored image, of `size` (width, height), to the view, of size `target`; path: its file."""
    if image.lens is None:
        return scaled_chart(chart, size, target)
    own = image.camera.width, image.camera.height
    corners = image.lens.straightened(scaled_chart(chart, size, own).corners)
    if not np.isfinite(corners).all():
        fault = "a corner lies where the lens cannot be undone"
        raise InputError(f"{path}: {image.name}, {chart.name}: {fault}; leave this chart out")
    return scaled_chart(Chart(chart.name, chart.kind, corners), own, target)


def _missing(images: Path, names: Sequence[str]) -> dict[str, str]:
    """Return what to say of each image that is not there; InputError when none is."""
    missing = [name for name in names if not (images / name).is_file()]
    if len(missing) == len(names):
        fault = f"none of the model's {len(names)} images is there, not even {names[0]}"
        raise InputError(f"{images}: {fault}; put them there or name their folder with dataset.images=...")
    of = f"{len(missing)} of the model's {len(names)} images are missing"
    return {name: f"{images / name}: no such file ({of}); put it there" for name in missing}


def _references(folder: Path, names: Sequence[str]) -> dict[str, Path]:
    found = {name: folder / name for name in names if (folder / name).is_file()}
    if folder.is_dir() and not found:
        raise InputError(f"{folder}: no file is named like an image; name them like {names[0]}")
    return found
