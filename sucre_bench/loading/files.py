"""A view's pixels in files, and the hash that tells whether a scene's data are the same."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from sucre_bench.charts import kind_id
from sucre_bench.errors import InputError
from sucre_bench.images import read_rgb
from sucre_bench.loading.depth import fitted, read_depth
from sucre_bench.loading.lens import Lens
from sucre_bench.progress import track
from sucre_bench.scene import Array, Camera, Chart, Plane, View

__all__ = [
    "Files",
    "check_length",
    "check_scale",
    "data_id_of",
    "fingerprint",
    "scaled_camera",
    "scaled_chart",
    "scaled_pose",
]

_WHOLE = 1 << 20  # bytes of a file up to which all of it is hashed, else so many blocks of so many bytes
_BLOCKS, _BLOCK = 16, 4096


@dataclass(frozen=True, eq=False)
class Files:
    """A view's pixels, in files that are decoded on demand.

    size: (width, height) in pixels to bring every plane to; read_depth: turns the depth file into planar metres
    (H, W), 0 = unknown, of any size that is the image's but for scale; lens: of image and reference as they are stored,
    which are then undistorted on the way, depth maps being of the undistorted image; depth_lens: whose depth map
    read_depth brings to the view's camera, where it is another's; read_image: reads the image alone, as `read_rgb`;
    faults: what is already known to be wrong with a plane, raised when that plane is asked for, so that other views go
    on.
    """

    image: Path
    size: tuple[int, int]
    depth: Path | None = None
    reference: Path | None = None
    read_depth: Callable[[Path], Array] = read_depth
    lens: Lens | None = None
    depth_lens: Lens | None = None
    read_image: Callable[[Path, tuple[int, int] | None], Array] = read_rgb
    faults: Mapping[Plane, str] = field(default_factory=dict)

    def load(self, plane: Plane) -> Array | None:
        """Decode a plane. InputError for a file that cannot be read, or a fault that is known."""
        if plane in self.faults:
            raise InputError(self.faults[plane])
        if plane == "depth":
            return None if self.depth is None else fitted(self.read_depth(self.depth), self.size, self.depth)
        path = self.image if plane == "rgb" else self.reference
        if path is None:
            return None
        read = self.read_image if plane == "rgb" else read_rgb
        return read(path, self.size) if self.lens is None else self.lens.undistorted(read(path, None), self.size)


def check_scale(dataset: str, image_scale: float) -> None:
    """Raise InputError unless a dataset's option image_scale is above 0 up to 1."""
    if not 0 < image_scale <= 1:
        raise InputError(f"{dataset}.image_scale: {image_scale} is not above 0 up to 1; give 0.5 for half size")


def check_length(dataset: str, option: str, length: float) -> None:
    """Raise InputError unless a dataset's option of that name is a length: above 0 and finite."""
    if not 0 < length < math.inf:
        raise InputError(f"{dataset}.{option}: {length} is no length above 0; give it as measured, or leave it out")


def scaled_camera(camera: Camera, size: tuple[int, int], image_scale: float = 1.0) -> Camera:
    """Return a camera brought from its own size to `size` (width, height) times `image_scale`."""
    width, height = (max(1, round(side * image_scale)) for side in size)
    return Camera(np.diag([width / camera.width, height / camera.height, 1.0]) @ camera.K, width, height)


def scaled_chart(chart: Chart, size: tuple[int, int], target: tuple[int, int]) -> Chart:
    """Return a chart whose corners are in pixels of an image of another size (width, height)."""
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))


def scaled_pose(cam_from_world: Array, metres_per_unit: float) -> Array:
    """Return a pose (4, 4) in metres, of one whose lengths are in another unit."""
    metric = cam_from_world.copy()
    metric[:3, 3] *= metres_per_unit
    return metric


def data_id_of(views: Sequence[View], *more: object) -> str:
    """Return a hash of all that views hold: cameras, poses, charts, options and their files; and of `more`.

    Of the files it takes `fingerprint`s, whose limit is its own.
    """
    digest = hashlib.blake2b(repr(more).encode() if more else b"", digest_size=6)
    for view in track(views, "hashing"):
        assert isinstance(view.pixels, Files)
        charts = [(chart.name, kind_id(chart.kind), chart.corners.tolist()) for chart in view.charts]
        K = None if view.camera is None else view.camera.K.tolist()
        pose = None if view.cam_from_world is None else view.cam_from_world.tolist()
        lenses: list[object] = [] if view.pixels.lens is None else [view.pixels.lens.identity]
        lenses += [] if view.pixels.depth_lens is None else [("depth", view.pixels.depth_lens.identity)]
        digest.update(repr((view.name, view.encoding, (K, view.pixels.size, pose, *lenses), charts)).encode())
        for path in (view.pixels.image, view.pixels.depth, view.pixels.reference):
            digest.update(b"none" if path is None else fingerprint(path))
    return digest.hexdigest()


def fingerprint(path: Path) -> bytes:
    """Return a hash of a file's size and content, whatever its date.

    All of the content up to 1 MiB. Of larger files 16 blocks of 4 KiB at even distances, the first and the last among
    them: all of them would be 90 GB of a large dataset at every start. A change between the blocks that keeps the size
    is then not seen. Of PNG and JPEG the first and last block: both are compressed, and PNG ends on a checksum, so that
    their size or their end tells.
    """
    try:
        with path.open("rb") as file:
            size = file.seek(0, 2)
            compressed = path.suffix.lower() in (".png", ".jpg", ".jpeg")
            blocks = 2 if compressed else _BLOCKS
            if size <= (blocks * _BLOCK if compressed else _WHOLE):
                file.seek(0)
                return hashlib.blake2b(b"%d" % size + file.read()).digest()
            digest = hashlib.blake2b(b"%d" % size)
            for i in range(blocks):
                file.seek((size - _BLOCK) * i // (blocks - 1))
                digest.update(file.read(_BLOCK))
            return digest.digest()
    except OSError:
        return b"unreadable"
