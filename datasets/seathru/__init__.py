"""Sea-thru D1 to D5: reefs in natural light, linear images with depth maps and, in D5, four colour charts.

    D1/D1/linearPNG/T_S02951.png        16-bit, linear, 0.3 of the photograph's size
          depth/depthT_S02951.tif       float metres, 0 = unknown; of the image's size or another (nearest is taken)
    D4/D4/depth_resized/...             likewise, at the image's size
    3585_3685/Raw/*.ARW, depthMaps/     an earlier release: raw files, read with rawpy

Conventions. The images are linear in the camera's own RGB, without white balance or colour matrix: no colour space
that a screen knows. Depth is planar: z along the optical axis agrees with structure from motion to 0.22 %, distance
would to 1.57 %. Poses and cameras are not released: a COLMAP model of one's own is used where a set has one.
Source: Akkaynak & Treibitz, Sea-thru, CVPR 2019; the charts: `published_charts`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.datasets.seathru.published_charts import FULL_SIZE, published_charts
from sucre_bench.datasets.seathru.raw_files import RAW_SUFFIXES, RawFiles, raw_size
from sucre_bench.errors import InputError
from sucre_bench.images import image_size, same_shape
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.files import Files, check_scale, data_id_of, scaled_camera, scaled_chart
from sucre_bench.loading.folders import existing, folders_below, scene_name
from sucre_bench.plugins import dataset
from sucre_bench.progress import track
from sucre_bench.scene import Array, Camera, Chart, Encoding, Plane, Scene, View

__all__ = ["Seathru"]

_SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", *RAW_SUFFIXES)
_DEPTH_FOLDERS = ("depth_resized", "depth", "depthmaps")  # the closest to the images' size first


@dataset(
    requires=("cv2", "PIL", "tifffile"),
    has=("poses", "depth", "charts"),
    cites="Akkaynak & Treibitz 2019, CVPR (Sea-thru)",
    licence="as its download page says",
    source="https://www.kaggle.com/datasets/colorlabeilat/seathru-dataset (about 1,100 images in five sets)",
)
@dataclass(frozen=True)
class Seathru:
    """The Sea-thru data: one scene for each set below root (D1 to D5), views in order of name."""

    root: Path
    """The download, or one set of it."""
    images: tuple[str, ...] = ("linearPNG", "Raw")
    """Names of a set's image folder, the first that is there is taken; capitals do not matter."""
    image_scale: float = 1.0
    """Shrink images, depth maps, cameras and chart corners by this factor, above 0 up to 1."""
    encoding: Encoding = "linear"
    """How the images are encoded: "linear" as released, "gamma" for copies that were made for a screen."""
    charts: str = "charts.json"
    """File of charts' corners in a set's folder, taken in place of the published ones of D5; need not exist."""
    sparse: str = "sparse"
    """Folder of a COLMAP model of the images, in a set's folder; PINHOLE cameras; need not exist."""
    metres_per_unit: float = 1.0
    """Length in metres of one unit of that model, which structure from motion leaves open."""
    focal_px: float | None = None
    """Focal length in pixels of the images as stored, for a camera where there is no model."""

    def __post_init__(self) -> None:
        check_scale("seathru", self.image_scale)
        for option in ("metres_per_unit", "focal_px"):
            if (value := getattr(self, option)) is not None and not value > 0:
                raise InputError(f"seathru.{option}: {value} is not above 0; give it as measured, or leave it out")

    def scenes(self) -> Iterator[Scene]:
        """Yield a scene for each set. Reads the image headers, decodes nothing.

        Raises InputError when there is no set, or its depth maps, charts or model are not as expected.
        """
        root = existing(self.root)
        found: dict[Path, list[Path]] = {}
        ranks = {name.lower(): rank for rank, name in enumerate(self.images)}
        for folder in folders_below(root, lambda place, _: place.name.lower() in ranks):
            found.setdefault(folder.parent, []).append(folder)
        if not found:
            names = " or ".join(self.images)
            raise InputError(f"{root}: holds no folder {names}; give the folder of D1 to D5, or set dataset.images=...")
        for place, folders in found.items():
            images = min(folders, key=lambda folder: ranks[folder.name.lower()])
            yield self._scene(place, images, scene_name(place, root if root != images else place))

    def _scene(self, place: Path, folder: Path, name: str) -> Scene:
        paths = sorted(p for p in folder.iterdir() if p.suffix.lower() in _SUFFIXES and not p.name.startswith("."))
        if not paths:
            raise InputError(f"{folder}: holds no image; copy the set's images there")
        sizes = _sizes(paths)
        depths = _depths(place, paths)
        model = self._model(place, folder)
        charts = self._charts(place, sizes)

        views = []
        for path in paths:
            size, posed = sizes[path.name], model.get(path.stem)
            target = (max(1, round(size[0] * self.image_scale)), max(1, round(size[1] * self.image_scale)))
            camera, pose, faults = _centred(size, self.focal_px), None, dict[Plane, str]()
            if posed is not None:
                camera, pose = posed.camera, _metric(posed.cam_from_world, self.metres_per_unit)
                if not same_shape(size, (camera.width, camera.height)):
                    fault = f"is {size[0]}x{size[1]}, its camera in the model {camera.width}x{camera.height}"
                    faults["rgb"] = f"{path}: {fault}; make the model of these images"
            kind = RawFiles if path.suffix.lower() in RAW_SUFFIXES else Files
            files = kind(path, target, depths.get(path.stem), faults=faults)
            own = None if camera is None else scaled_camera(camera, size, self.image_scale)
            seen = tuple(scaled_chart(chart, at, target) for chart, at in charts.get(path.name, ()))
            views.append(View(path.name, files, own, pose, seen, self.encoding))
        has = {"depth": depths, "charts": charts, "poses": model}
        return Scene(name, views, frozenset(what for what, there in has.items() if there), data_id=data_id_of(views))

    def _model(self, place: Path, folder: Path) -> dict[str, Posed]:
        """Return the registered images by name without suffix: models are often made of JPEG copies."""
        if not (place / self.sparse).is_dir():
            if self.sparse != type(self).sparse:
                raise InputError(f"{place / self.sparse}: is not there; correct or drop dataset.sparse={self.sparse}")
            return {}
        return {PurePosixPath(posed.name).stem: posed for posed in read_model(place / self.sparse, folder)}

    def _charts(
        self, place: Path, sizes: Mapping[str, tuple[int, int]]
    ) -> dict[str, list[tuple[Chart, tuple[int, int]]]]:
        """Return the charts of each image, each with the size (width, height) that its corners are pixels of."""
        file = place / self.charts
        if file.is_file():
            return {name: [(c, sizes[name]) for c in charts] for name, charts in read_charts(file, sizes).items()}
        if self.charts != type(self).charts:
            raise InputError(f"{file}: is not there; correct or drop dataset.charts={self.charts}")
        found = {}
        for name, size in sizes.items():
            charts = published_charts().get(PurePosixPath(name).stem, ())
            if charts and same_shape(size, FULL_SIZE):  # cropped or undistorted copies are other pixels
                found[name] = [(chart, FULL_SIZE) for chart in charts]
        return found


def _sizes(paths: list[Path]) -> dict[str, tuple[int, int]]:
    """Return the size of each image; where its header is damaged, of another, so that only this view fails."""
    read = {p.name: (raw_size if p.suffix.lower() in RAW_SUFFIXES else image_size)(p) for p in track(paths, "sizes")}
    usual = next((size for size in read.values() if size), FULL_SIZE)
    return {name: size or usual for name, size in read.items()}


def _depths(place: Path, images: list[Path]) -> dict[str, Path]:
    """Return the depth map of each image that has one, by the image's name without suffix."""
    there = {folder.name.lower(): folder for folder in sorted(place.iterdir()) if folder.is_dir()}
    folders = [there[name] for name in _DEPTH_FOLDERS if name in there]
    found: dict[str, Path] = {}
    for folder in folders:
        for path in sorted(folder.iterdir()):
            if path.suffix.lower() in (".tif", ".tiff") and not path.name.startswith("."):
                found.setdefault(re.sub(r"^depth[_-]?", "", path.stem, flags=re.IGNORECASE), path)
    own = {path.stem: found[path.stem] for path in images if path.stem in found}
    if folders and not own:
        expected = f"depth{images[0].stem}.tif"
        raise InputError(f"{folders[0]}: no depth map is named after an image; expected names like {expected}")
    return own


def _centred(size: tuple[int, int], focal_px: float | None) -> Camera | None:
    """Return a camera whose axis meets the middle of the image; None where the focal length is not known."""
    if focal_px is None:
        return None
    width, height = size
    return Camera(np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1]]), width, height)


def _metric(cam_from_world: Array, metres_per_unit: float) -> Array:
    metric = cam_from_world.copy()
    metric[:3, 3] *= metres_per_unit
    return metric
