"""A view's pixels in files, and the hash that tells whether a scene's data are the same."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
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

__all__ = ["Files", "check_scale", "data_id_of", "scaled_camera", "scaled_chart"]


@dataclass(frozen=True, eq=False)
class Files:
    """A view's pixels, in files that are decoded on demand.

    size: (width, height) in pixels to bring every plane to; read_depth: turns the depth file into planar metres
    (H, W), 0 = unknown, of any size that is the image's but for scale; lens: of image and reference as they are stored,
    which are then undistorted on the way, depth maps being of the undistorted image; faults: what is already known to
    be wrong with a plane, raised when that plane is asked for, so that other views go on.
    """

    image: Path
    size: tuple[int, int]
    depth: Path | None = None
    reference: Path | None = None
    read_depth: Callable[[Path], Array] = read_depth
    lens: Lens | None = None
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
        return read_rgb(path, self.size) if self.lens is None else self.lens.undistorted(read_rgb(path), self.size)


def check_scale(dataset: str, image_scale: float) -> None:
    """Raise InputError unless a dataset's option image_scale is above 0 up to 1."""
    if not 0 < image_scale <= 1:
        raise InputError(f"{dataset}.image_scale: {image_scale} is not above 0 up to 1; give 0.5 for half size")


def scaled_camera(camera: Camera, size: tuple[int, int], image_scale: float = 1.0) -> Camera:
    """Return a camera brought from its own size to `size` (width, height) times `image_scale`."""
    width, height = (max(1, round(side * image_scale)) for side in size)
    return Camera(np.diag([width / camera.width, height / camera.height, 1.0]) @ camera.K, width, height)


def scaled_chart(chart: Chart, size: tuple[int, int], target: tuple[int, int]) -> Chart:
    """Return a chart whose corners are in pixels of an image of another size (width, height)."""
    return Chart(chart.name, chart.kind, chart.corners * np.divide(target, size))


def data_id_of(views: Sequence[View], *more: object) -> str:
    """Return a hash of all that views hold: cameras, poses, charts, options and the files' content; and of `more`."""
    digest = hashlib.blake2b(repr(more).encode() if more else b"", digest_size=6)
    for view in track(views, "hashing"):
        assert isinstance(view.pixels, Files)
        charts = [(chart.name, kind_id(chart.kind), chart.corners.tolist()) for chart in view.charts]
        K = None if view.camera is None else view.camera.K.tolist()
        pose = None if view.cam_from_world is None else view.cam_from_world.tolist()
        lens = () if view.pixels.lens is None else (view.pixels.lens.identity,)
        digest.update(repr((view.name, view.encoding, (K, view.pixels.size, pose, *lens), charts)).encode())
        for fingerprint in _fingerprints((view.pixels.image, view.pixels.depth, view.pixels.reference)):
            digest.update(fingerprint)
    return digest.hexdigest()


def _fingerprints(paths: Iterable[Path | None]) -> Iterable[bytes]:
    return (b"none" if path is None else _fingerprint(path) for path in paths)


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
