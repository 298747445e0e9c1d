"""A view's pixels in files, decoded on demand."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import is_jpeg, read_rgb
from sucre_bench.loading.depth_maps import check_header, fitted, read_depth
from sucre_bench.loading.lens import Lens
from sucre_bench.scene import Plane


@dataclass(frozen=True, eq=False)
class Files:
    """A view's pixels, in files that are decoded on demand.

    size: (width, height) in pixels of every plane; read_depth: returns planar metres (H, W), 0 = unknown, at any scale
    of the image's size; lens: of the stored image and reference, which are then undistorted; depth maps are of the
    undistorted image; depth_lens: the lens of the depth map, if it is not the view's camera; read_image: reads the
    image, like `read_rgb`; faults: known faults of planes, raised when the plane is used, so that other views continue.
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

    @property
    def is_jpeg(self) -> bool:
        """Whether the image is a JPEG file, by its first bytes."""
        return is_jpeg(self.image)

    def load(self, plane: Plane) -> Array | None:
        """Decode a plane. Raises InputError for an unreadable file or a known fault."""
        if plane in self.faults:
            raise InputError(self.faults[plane])
        if plane == "depth":
            return None if self.depth is None else self._depth(self.depth)
        path = self.image if plane == "rgb" else self.reference
        if path is None:
            return None
        read = self.read_image if plane == "rgb" else read_rgb
        return read(path, self.size) if self.lens is None else self.lens.undistorted(read(path, None), self.size)

    def _depth(self, path: Path) -> Array:
        if self.depth_lens is None:
            check_header(path, self.size)
        return fitted(self.read_depth(path), self.size, path)


def scaled_pose(cam_from_world: Array, metres_per_unit: float) -> Array:
    """Return a pose (4, 4) in metres, from one in another unit of length."""
    metric = cam_from_world.copy()
    metric[:3, 3] *= metres_per_unit
    return metric
