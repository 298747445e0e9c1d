"""SeaThru-NeRF: four reefs, each seen from about twenty places before it, with camera poses.

    Panama/images_wb/MTN_1090.png     1,400x900 or so; Images_wb/ in IUI3-RedSea
           sparse/0/*.bin             COLMAP model, distorted cameras (colmap/sparse/0/ in copies of others)
           depths/                    optional, one's own: of the undistorted images, see `loading.depth_maps`

Conventions. The images are linear: demosaiced raw files, each channel divided by its 99.8th percentile over the scene,
which its authors call white balance. They are undistorted on the way. The models' scale is arbitrary.
Source: Levy et al., SeaThru-NeRF: neural radiance fields in scattering media, CVPR 2023.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from sucre_bench.imaging.image_files import PICTURE_READERS
from sucre_bench.loading.colmap_model import read_model, registered_scene
from sucre_bench.loading.find_folders import (
    chosen,
    existing,
    folders_below,
    scene_name,
)
from sucre_bench.loading.view_files import ImageScaleOption
from sucre_bench.plugins.plugin import dataset
from sucre_bench.scene import Encoding, Scene

# every eighth image by name, from the first, tests what was learned of the others
_HELD_OUT = 8


@dataset(
    requires=PICTURE_READERS,
    has=("poses", "depth"),
    cites="Levy, Peleg, Pearl, Rosenbaum, Akkaynak, Treibitz & Korman 2023, CVPR (SeaThru-NeRF)",
    licence="as its download page says",
    source="https://sea-thru-nerf.github.io (four scenes of 18 to 29 images)",
    proven="has read no released file yet: written from the authors' descriptions, tried on miniatures of them",
    signs=("images_wb", "Images_wb", "*/images_wb", "*/Images_wb"),
)
@dataclass(frozen=True)
class SeathruNerf(ImageScaleOption):
    """The SeaThru-NeRF reefs: one scene for each, views in order of name, undistorted on the way."""

    ranges: ClassVar = {"metres_per_unit": "(0, inf)"}

    root: Path
    """The download, or one scene of it."""
    images: tuple[str, ...] = ("images_wb", "images")
    """Names of a scene's image folder; the first that exists counts. Capitals do not matter."""
    split: Literal["all", "train", "test"] = "all"
    """ "test": every eighth image by name, from the first; "train": the others."""
    depths: str = "depths"
    """Folder of depth maps of the undistorted images, in a scene's folder; need not exist."""
    metres_per_unit: float = 1.0
    """Length in metres of one unit of the model; structure from motion does not know it."""
    encoding: Encoding = "linear"
    """How the images are encoded: "linear" as released, "gamma" for copies that were made for a screen."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each reef. Reads models, headers and samples of files, decodes nothing.

        Raises InputError when there is no reef, or its model or all of its images are missing.
        """
        root = existing(self.root)
        names = [name.lower() for name in self.images]
        lack = f"holds no folder {' or '.join(self.images)}; give the folder of the four scenes"
        for place in folders_below(
            root, lambda _, below: bool({name.lower() for name in below} & set(names)), lack
        ):
            there = {
                path.name.lower(): path for path in sorted(place.iterdir()) if path.is_dir()
            }
            images = next(there[name] for name in names if name in there)
            depths = chosen(self, place, "depths", "folder")
            sparse = next(
                (
                    path
                    for path in (place / "sparse", place / "colmap" / "sparse")
                    if path.is_dir()
                ),
                None,
            )
            model = read_model(sparse or place / "sparse", images, distorted=True)
            if self.split != "all":
                model = [
                    posed
                    for i, posed in enumerate(model)
                    if (i % _HELD_OUT == 0) == (self.split == "test")
                ]
            paths = {posed.name: images / posed.name for posed in model}
            scale = self.image_scale
            unit = self.metres_per_unit
            yield registered_scene(
                scene_name(place, root), model, paths, depths, scale, self.encoding, unit
            )
