"""FLSea-VI: twelve dives along canyons of the Mediterranean and reefs of the Red Sea, with depth maps, without poses.

    canyons/flatiron/flatiron/imgs/16233051861828957.tiff                         8-bit, 968x608
                              seaErra/16233051861828957_SeaErra.tiff              enhanced by a commercial program
                              depth/16233051861828957_SeaErra_abs_depth.tif       float metres, 0 = unknown
    canyons/calibration/*-kalibr-results-imucam.txt                               the camera

Conventions. Depth is taken as planar; its pixels are those of the photograph as it was taken. Where the calibration is
there, photographs and depth maps are undistorted on the way (depth by the nearest value) and have a camera. The
enhanced images are nobody's truth: they can be restored in place of the photographs, but are no reference.
Source: Randall & Treibitz, FLSea: underwater visual-inertial and stereo-vision forward-looking datasets, 2023.
"""

import re
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench import InputError, dataset
from sucre_bench.arrays import Size
from sucre_bench.imaging.image_files import PICTURE_READERS, first_size
from sucre_bench.loading.find_folders import existing, folders_below, only, scene_name
from sucre_bench.loading.image_folder import image_names
from sucre_bench.loading.lens import Lens, read_kalibr
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scene_of
from sucre_bench.machine.files import expanded
from sucre_bench.machine.progress import say
from sucre_bench.scene import Scene

_SIZE = (968, 608)
_CALIBRATIONS = ("*camchain*.yaml", "*results-imucam*.txt")


@dataset(
    requires=(*PICTURE_READERS, "yaml"),
    has=("depth",),
    cites="Randall & Treibitz 2023, arXiv:2302.12772 (FLSea)",
    licence="as its download page says",
    source="https://www.kaggle.com/datasets/viseaonlab/flsea-vi (22,451 frames of 968x608, three files each)",
    proven="has read 12 released frames with depth maps",
    signs=("seaErra", "*/seaErra", "*/*/seaErra", "*/*/*/seaErra"),
)
@dataclass(frozen=True)
class Flsea(ImageScaleOption):
    """The FLSea-VI dives: one scene for each, views in order of time, with depth maps."""

    root: Path
    """The download, or a folder in it from canyons or red_sea down to one dive."""
    images: Literal["imgs", "seaErra"] = "imgs"
    """Which images to restore: "imgs", the photographs, or "seaErra", the images that another program enhanced."""
    undistort: bool = True
    """Undistort images and depth maps if there is a calibration; false: views are as stored and have no camera."""
    calibration: Path | None = None
    """File of a calibration by Kalibr, instead of the one in a folder calibration/ of the dive or above it, up to
    root."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each dive. Reads calibrations, headers and samples of files, decodes nothing.

        Raises InputError when there is no dive, or its calibration or depth maps are not as expected.
        """
        root = existing(self.root)
        lack = f"holds no folder {self.images} of images; give the folder of canyons or red_sea"
        for dive in folders_below(root, lambda _, below: self.images in below, lack):
            folder = dive / self.images
            names = image_names(folder)
            if not names:
                raise InputError(f"{folder}: holds no image; copy the dive's .tiff files there")
            depths: dict[str, list[Path]] = defaultdict(list)
            for name in image_names(dive / "depth"):
                if name.lower().endswith((".tif", ".tiff")):
                    depths[_frame(name)].append(dive / "depth" / name)
            if depths and not any(_frame(name) in depths for name in names):
                expected = f"expected names like {_frame(names[0])}_SeaErra_abs_depth.tif"
                raise InputError(
                    f"{dive / 'depth'}: no depth map is named after an image; {expected}"
                )
            lens = (
                self._lens(dive, root, first_size(folder / name for name in names) or _SIZE)
                if self.undistort
                else None
            )
            photographs = [
                Photograph(
                    name,
                    folder / name,
                    lens,
                    None,
                    only(depths.get(_frame(name), ())),
                    depth_lens=lens,
                )
                for name in names
            ]
            yield scene_of(scene_name(dive, root), photographs, self.image_scale)

    def _lens(self, dive: Path, root: Path, size: Size) -> Lens | None:
        if self.calibration is not None:
            return read_kalibr(expanded(self.calibration), size)
        places = [
            place for place in (dive, *dive.parents) if place == root or root in place.parents
        ]
        for place in places:  # the nearest counts, of several in a place the camchain
            for path in (
                path
                for pattern in _CALIBRATIONS
                for path in sorted(place.glob(f"calibration/{pattern}"))
            ):
                return read_kalibr(path, size)
        remedy = "give the site's folder as dataset.root, dataset.calibration=FILE or dataset.undistort=false"
        say(
            f"{dive}: no calibration/ in it or above, up to {root}, so views stay distorted, without a camera; {remedy}"
        )
        return None


def _frame(name: str) -> str:
    """Return the time stamp that an image's and its depth map's names start with."""
    return re.sub(r"(_SeaErra)?(_abs_depth)?$", "", Path(name).stem, flags=re.IGNORECASE)
