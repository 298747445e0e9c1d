"""Scenes that OpenMVS densified: its depth maps, and the undistorted images that they name.

root/depth0000.dmap ...   depth maps, one an image; their headers hold cameras and poses, so that scene.mvs is not read
root/images/<name>        the images, wherever they are below root

Source of the format: see `sucre_bench.loading.openmvs_dmap`.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.loading.find_folders import ImageFolder, existing, inner_path
from sucre_bench.loading.openmvs_dmap import Header, read_dmap_depth, read_header
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, data_id_of, scaled_pose, straight_lens, view_of
from sucre_bench.machine.progress import track
from sucre_bench.plugins.decorators import dataset
from sucre_bench.plugins.ranges import check_ranges
from sucre_bench.scene import Encoding, Plane, Scene


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    cites="Cernea 2020, OpenMVS",
    source="your own scenes: the working folder of OpenMVS's DensifyPointCloud",
    has=("poses", "depth"),
    signs=("*.dmap",),
)
@dataclass(frozen=True)
class Openmvs(ImageScaleOption):
    """A scene with depth maps of OpenMVS: one view a depth map, in order of the images' names."""

    root: Path
    """The folder that holds the depth maps and, in it or below, the images."""
    dmaps: str = "*.dmap"
    """Which depth maps, as a pattern of paths in root; one an image."""
    metres_per_unit: float = 1.0
    """Length in metres of one unit of the reconstruction; leave 1 if it is metric already, or unknown."""
    encoding: Encoding = "gamma"
    """How images are encoded: "gamma" (sRGB-like) or "linear"."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, metres_per_unit="(0, inf)")
        if Path(self.dmaps).is_absolute() or ".." in Path(self.dmaps).parts or not self.dmaps:
            raise InputError(f"openmvs.dmaps: '{self.dmaps}' is no pattern of paths in root; give '*.dmap'")

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads headers and samples of depth maps and images.

        Raises InputError for what concerns all views: no depth map, one without a readable header, two of one image, no
        image at all. Other faults are raised when the view's pixels are loaded.
        """
        root = existing(self.root, "the .dmap files")
        paths = sorted(path for path in root.glob(self.dmaps) if path.is_file())
        if not paths:
            raise InputError(f"{root / self.dmaps}: no depth map; run DensifyPointCloud there or set dataset.dmaps=...")
        images = ImageFolder(root)
        photographs: dict[str, Photograph] = {}
        for path in track(paths, "depth maps"):
            photograph = self._photograph(root, path, read_header(path), images)
            if photograph.name in photographs:
                other = photographs[photograph.name].depth
                raise InputError(f"{path}: is of {photograph.name}, as {other} is; choose with dataset.dmaps='*.dmap'")
            photographs[photograph.name] = photograph
        if all(photograph.faults for photograph in photographs.values()):
            first = next(iter(photographs))
            raise InputError(f"{root}: none of the images is there, not even {first}; put them below")
        views = [view_of(photographs[name], self.image_scale, self.encoding) for name in sorted(photographs)]
        data_id = data_id_of(views, self.metres_per_unit)
        yield Scene(root.resolve().name, views, frozenset({"poses", "depth"}), data_id=data_id)

    def _photograph(self, root: Path, path: Path, header: Header, images: ImageFolder) -> Photograph:
        fits = images.find(header.image)
        faults: dict[Plane, str] = {}
        if not fits:
            faults["rgb"] = f"{root}: holds no image {header.image}, which {path.name} is of; put it below"
        elif len(fits) > 1:
            fault = f"{fits[0]} and {fits[1]} may both be the image {header.image} of {path.name}"
            faults["rgb"] = f"{root}: {fault}; keep one of them"
        name = fits[0] if len(fits) == 1 else inner_path(header.image) or path.stem
        pose = scaled_pose(header.cam_from_world, self.metres_per_unit)
        return Photograph(name, root / name, straight_lens(header.camera), pose, path, self._metres, faults=faults)

    def _metres(self, path: Path) -> Array:
        return read_dmap_depth(path) * np.float32(self.metres_per_unit)
