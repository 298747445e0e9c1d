"""Sea-thru D1 to D5: reefs in natural light, linear images with depth maps and, in D5, four colour charts.

    D1/D1/linearPNG/T_S02951.png        16-bit, linear, 0.3 of the photograph's size
          depth/depthT_S02951.tif       float metres, 0 = unknown; of the image's size or another (nearest is taken)
    D4/D4/depth_resized/...             likewise, at the image's size
    3585_3685/Raw/*.ARW, depthMaps/     an earlier release: raw files, read with rawpy

Conventions. The images are linear in the camera's own RGB, without white balance or colour matrix: no colour space
that a screen knows. Depth is planar: z along the optical axis agrees with structure from motion to 0.22 %, distance
would to 1.57 %. Poses and cameras are not released: a COLMAP model of one's own is used where a set has one.
Source: Akkaynak & Treibitz, Sea-thru, CVPR 2019; the charts: `loading.d5_charts`.
"""

import importlib
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any, ClassVar

import numpy as np

from sucre_bench import InputError, dataset, track
from sucre_bench.arrays import Array, Size
from sucre_bench.camera import centred_camera
from sucre_bench.imaging.chart_patches import scaled_chart
from sucre_bench.imaging.image_files import (
    PICTURE_READERS,
    SUFFIXES,
    image_size,
    read_rgb,
    resized,
    same_shape,
)
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.d5_charts import FULL_SIZE, published_charts
from sucre_bench.loading.depth_maps import find_depths
from sucre_bench.loading.find_folders import (
    check_chosen,
    chosen,
    existing,
    folders_below,
    scene_name,
)
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.view_files import ImageScaleOption, Photograph, scaled_pose, scene_of
from sucre_bench.machine.files import expanded, reading
from sucre_bench.scene import Chart, Encoding, Scene

# Reads camera raw files as linear images: the sensor's values, demosaiced and otherwise unchanged.
#
# No white balance, no colour matrix, no tone curve, no brightening; black subtracted, white level to 1; each channel
# interpolated on its own (bilinear). The maximum is the camera's, not each photograph's, so that views stay
# comparable. The colours are the camera's own RGB.

RAW_SUFFIXES = (".arw", ".nef", ".dng")


def raw_size(path: Path) -> Size | None:
    """Return (width, height) of the developed image; None where the file is damaged, which decoding will explain."""
    rawpy = _rawpy(path)
    try:
        with rawpy.imread(str(path)) as raw:
            return raw.sizes.width, raw.sizes.height
    except (rawpy.LibRawError, OSError):
        return None


def read_raw(path: Path, size: Size | None = None) -> Array:
    """Return the developed image (H, W, 3) float32 in [0, 1], shrunk to `size` (width, height) by area if one is given.

    Raises InputError for a file that cannot be read, or where rawpy is not installed.
    """
    rawpy = _rawpy(path)
    with reading(path, "copy it again"), rawpy.imread(str(path)) as raw:
        counts = raw.postprocess(
            demosaic_algorithm=rawpy.DemosaicAlgorithm.LINEAR,
            output_color=rawpy.ColorSpace.raw,
            user_wb=[1.0, 1.0, 1.0, 1.0],
            gamma=(1, 1),
            no_auto_bright=True,
            adjust_maximum_thr=0.0,
            output_bps=16,
            user_flip=0,
        )
    return resized(counts.astype(np.float32) / np.float32(65535), size, path)


def _rawpy(path: Path) -> Any:
    try:
        return importlib.import_module("rawpy")
    except ImportError as fault:
        raise InputError(
            f"{path}: is a raw file; install rawpy (pip install rawpy), or use linearPNG"
        ) from fault


_SUFFIXES = (*SUFFIXES, *RAW_SUFFIXES)
# the closest to the images' size first
_DEPTH_FOLDERS = (
    "depth_resized",
    "depth",
    "depthmaps",
)


@dataset(
    requires=PICTURE_READERS,
    has=("poses", "depth", "charts"),
    cites="Akkaynak & Treibitz 2019, CVPR (Sea-thru)",
    licence="as its download page says",
    source="https://www.kaggle.com/datasets/colorlabeilat/seathru-dataset (about 1,100 images in five sets)",
    proven="has read display copies of D5, and Metashape's depth maps of other dives; no linear image of a release",
    signs=("linearPNG", "*/linearPNG", "*/*/linearPNG", "*/Raw/*.ARW"),
)
@dataclass(frozen=True)
class Seathru(ImageScaleOption):
    """The Sea-thru data: one scene for each set below root (D1 to D5), views in order of name."""

    ranges: ClassVar = {"metres_per_unit": "(0, inf)", "focal_px": "(0, inf)"}

    root: Path
    """The download, or one set of it."""
    images: tuple[str, ...] = ("linearPNG", "Raw")
    """Names of a set's image folder; the first that exists counts. Capitals do not matter."""
    encoding: Encoding = "linear"
    """How the images are encoded: "linear" as released, "gamma" for copies that were made for a screen."""
    charts: str = "charts.json"
    """File of charts' corners in a set's folder, instead of the published corners of D5. charts.json need not exist;
    another name must, in one set."""
    sparse: str = "sparse"
    """Folder of a COLMAP model of the images, in a set's folder; PINHOLE cameras; need not exist."""
    metres_per_unit: float = 1.0
    """Length in metres of one unit of that model; structure from motion does not know it."""
    focal_px: float | None = None
    """Focal length in pixels of the stored images, if there is no model."""

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each set. Reads headers and samples of files, decodes nothing.

        Raises InputError when there is no set, or its depth maps, charts or model are not as expected.
        """
        root = existing(self.root)
        found: dict[Path, list[Path]] = {}
        ranks = {name.lower(): rank for rank, name in enumerate(self.images)}
        names = " or ".join(self.images)
        lack = (
            f"holds no folder {names}; give the folder of D1 to D5, or set dataset.images=..."
        )
        for folder in folders_below(root, lambda place, _: place.name.lower() in ranks, lack):
            found.setdefault(folder.parent, []).append(folder)
        check_chosen(self, list(found), "charts", "file")
        for place, folders in found.items():
            images = min(folders, key=lambda folder: ranks[folder.name.lower()])
            yield self._scene(
                place, images, scene_name(place, root if root != images else place)
            )

    def _scene(self, place: Path, folder: Path, name: str) -> Scene:
        paths = sorted(
            p
            for p in folder.iterdir()
            if p.suffix.lower() in _SUFFIXES and not p.name.startswith(".")
        )
        if not paths:
            raise InputError(f"{folder}: holds no image; copy the set's images there")
        read = {
            p.name: (raw_size if p.suffix.lower() in RAW_SUFFIXES else image_size)(p)
            for p in track(paths, "sizes")
        }
        # if a header is damaged, only this view fails
        usual = next((size for size in read.values() if size), FULL_SIZE)
        sizes = {name: size or usual for name, size in read.items()}
        depths = _depths(place, [path.name for path in paths])
        sparse = chosen(self, place, "sparse", "folder")
        model = _model(sparse, folder, paths)
        charts = self._charts(place, sizes)

        photographs = []
        for path in paths:
            size = sizes[path.name]
            posed = model.get(path.name, ())
            f = self.focal_px
            # Of a known focal length: the axis meets the middle of the image.
            camera = centred_camera(f, *size) if f else None
            pose = None
            fault = ""
            if len(posed) == 1:
                camera = posed[0].camera
                pose = scaled_pose(posed[0].cam_from_world, self.metres_per_unit)
            elif posed:
                fault = f"{path}: may be {posed[0].name} or {posed[1].name} of the model in {sparse}; keep one there"
            photograph = Photograph(
                path.name,
                path,
                None if camera is None else Lens(camera),
                pose,
                depths.get(path.name),
                charts=charts.get(path.name, ()),
                size=size,
                read_image=read_raw if path.suffix.lower() in RAW_SUFFIXES else read_rgb,
                fault=fault,
            )
            photographs.append(photograph)
        return scene_of(name, photographs, self.image_scale, self.encoding)

    def _charts(self, place: Path, sizes: Mapping[str, Size]) -> Mapping[str, Sequence[Chart]]:
        """Return the charts of each image, corners in its pixels."""
        file = place / expanded(self.charts)
        if file.is_file():
            return read_charts(file, sizes)
        return {
            name: [
                scaled_chart(chart, FULL_SIZE, size)
                for chart in published_charts().get(PurePosixPath(name).stem, ())
            ]
            for name, size in sizes.items()
            if same_shape(size, FULL_SIZE)  # cropped or undistorted copies are other pixels
        }


def _model(sparse: Path, folder: Path, images: Sequence[Path]) -> dict[str, list[Posed]]:
    """Return which registered images each image may be: of its name, or else its stem: models are often of copies.

    Raises InputError when none of them is any of the images.
    """
    if not sparse.is_dir():
        return {}
    by_stem: dict[str, list[Posed]] = defaultdict(list)
    for posed in read_model(sparse, folder):
        by_stem[PurePosixPath(posed.name).stem].append(posed)
    found = {path.name: by_stem[path.stem] for path in images if path.stem in by_stem}
    if not found:
        example = next(iter(by_stem.values()))[0].name
        raise InputError(
            f"{sparse}: none of its images, {example} or so, is in {folder}; give the model of these"
        )
    exact = {
        name: [posed for posed in several if posed.name == name]
        for name, several in found.items()
    }
    return {name: exact[name] or several for name, several in found.items()}


def _depths(place: Path, names: Sequence[str]) -> dict[str, Path | str]:
    """Return each image's depth map of the first folder that has one, or what is wrong if it is ambiguous."""
    there = {
        folder.name.lower(): folder for folder in sorted(place.iterdir()) if folder.is_dir()
    }
    found, refused = dict[str, Path | str](), list[InputError]()
    for folder in (there[name] for name in _DEPTH_FOLDERS if name in there):
        without = [name for name in names if name not in found]
        if not without:
            break
        try:
            found |= find_depths(folder, without)
        except InputError as fault:
            # none of its maps is named after an image: those of another folder may be
            refused.append(fault)
    if refused and not found:
        raise refused[0]
    return found
