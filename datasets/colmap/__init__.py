"""Any COLMAP reconstruction with depth maps, in the layout SUCRe reads.

root/images/<name>          8- or 16-bit PNG, TIFF or JPEG, undistorted; sub-folders and many cameras are fine
root/sparse/ or sparse/0/   cameras and images, .bin or .txt, PINHOLE or SIMPLE_PINHOLE
root/depths/                optional: depth_<stem>.png and other forms, see `depth`
root/reference/<name>       optional: the image without water
root/charts.json            optional: colour charts, see `charts_file`
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.datasets.colmap.charts_file import read_charts
from sucre_bench.datasets.colmap.depth import find_depths, read_depth
from sucre_bench.datasets.colmap.model import Posed, read_model
from sucre_bench.errors import InputError
from sucre_bench.images import image_size, read_rgb, same_shape
from sucre_bench.plugins import dataset
from sucre_bench.progress import track
from sucre_bench.scene import Array, Camera, Chart, Encoding, Plane, Scene, View

__all__ = ["Colmap", "Files"]


@dataclass(frozen=True, eq=False)
class Files:
    """A view's pixels, in files that are decoded on demand.

    size: (width, height) in pixels to bring every plane to; faults: what is already known to be wrong with a plane,
    raised when that plane is asked for, so that other views go on.
    """

    image: Path
    depth: Path | None
    reference: Path | None
    size: tuple[int, int]
    faults: Mapping[Plane, str]

    def load(self, plane: Plane) -> Array | None:
        if plane in self.faults:
            raise InputError(self.faults[plane])
        if plane == "depth":
            return None if self.depth is None else read_depth(self.depth, self.size)
        path = self.image if plane == "rgb" else self.reference
        return None if path is None else read_rgb(path, self.size)


@dataset(requires=("cv2", "PIL", "tifffile"))
@dataclass(frozen=True)
class Colmap:
    """A COLMAP reconstruction with depth maps: one scene, one view a registered image, in order of name."""

    root: Path
    """The folder that holds images/, sparse/ and, if there are any, depths/, reference/ and charts.json."""
    images: str = "images"
    """Folder of the undistorted images, in root."""
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
    encoding: Encoding = "gamma"
    """How images and references are encoded: "gamma" (sRGB-like) or "linear"."""

    def __post_init__(self) -> None:
        if not 0 < self.image_scale <= 1:
            raise InputError(f"colmap.image_scale: {self.image_scale} is not above 0 up to 1; give 0.5 for half size")

    def scenes(self) -> Iterator[Scene]:
        """Yield the one scene, named like its folder. Reads the model and the image headers, decodes nothing.

        Raises InputError for what concerns all views: no model, a distorted camera, no image at all, a wrong
        charts.json. What is wrong with the files of one view is raised when they are loaded.
        """
        root = self._root()
        images = root / self.images
        posed = read_model(root / self.sparse, images)
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
            camera = self._camera(image, size)
            target = (camera.width, camera.height)
            files = Files(images / name, depths.get(name), references.get(name), target, faults)
            seen = tuple(_scaled(chart, size, target) for chart in charts.get(name, ()))
            views.append(View(name, files, camera, image.cam_from_world, seen, self.encoding))

        optional = {"depth": depths or ambiguous, "reference": references, "charts": charts}
        has = frozenset({"poses", *(what for what, there in optional.items() if there)})
        yield Scene(root.resolve().name, views, has, data_id=_data_id(views))

    def _root(self) -> Path:
        root = Path(self.root).expanduser()
        if not root.is_dir():
            raise InputError(f"{root}: no such folder; give the one that holds {self.images}/ as dataset.root=DIR")
        for option in ("depths", "reference", "charts"):  # they need not exist, unless they were asked for
            given = getattr(self, option)
            if given != getattr(type(self), option) and not (root / given).exists():
                raise InputError(f"{root / given}: is not there; correct or drop dataset.{option}={given}")
        return root

    def _camera(self, image: Posed, size: tuple[int, int]) -> Camera:
        """Return the model's camera brought to the stored image's size and to image_scale."""
        width, height = (max(1, round(side * self.image_scale)) for side in size)
        scale = np.diag([width / image.camera.width, height / image.camera.height, 1.0])
        return Camera(scale @ image.camera.K, width, height)


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


def _scaled(chart: Chart, size: tuple[int, int], target: tuple[int, int]) -> Chart:
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))


def _data_id(views: Sequence[View]) -> str:
    """Return a hash of all that the views hold: cameras, poses, charts, options and the files' content."""
    digest = hashlib.blake2b(digest_size=6)
    for view in track(views, "hashing"):
        assert isinstance(view.pixels, Files)
        assert view.camera is not None
        assert view.cam_from_world is not None
        charts = [(chart.name, chart.kind, chart.corners.tolist()) for chart in view.charts]
        camera = (view.camera.K.tolist(), view.pixels.size, view.cam_from_world.tolist())
        digest.update(repr((view.name, view.encoding, camera, charts)).encode())
        for path in (view.pixels.image, view.pixels.depth, view.pixels.reference):
            digest.update(b"none" if path is None else _fingerprint(path))
    return digest.hexdigest()


def _fingerprint(path: Path) -> bytes:
    """Return a hash of a file: of its size, first and last 4 KiB for PNG, which ends on checksums, and JPEG."""
    try:
        with path.open("rb") as file:
            if path.suffix.lower() not in (".png", ".jpg", ".jpeg"):
                return hashlib.file_digest(file, "blake2b").digest()
            start, size = file.read(4096), file.seek(0, 2)
            file.seek(max(0, size - 4096))
            return hashlib.blake2b(b"%d" % size + start + file.read()).digest()
    except OSError:
        return b"unreadable"
