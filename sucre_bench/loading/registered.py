"""The views of a COLMAP model whose cameras may be distorted, in the folders of a published dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from sucre_bench.errors import InputError
from sucre_bench.loading.colmap_model import Posed
from sucre_bench.loading.depth import find_depths
from sucre_bench.loading.files import data_id_of
from sucre_bench.loading.lens import Lens
from sucre_bench.loading.photograph import Photograph, view_of
from sucre_bench.progress import track
from sucre_bench.scene import Encoding, Plane, Scene

__all__ = ["registered_scene"]


def registered_scene(
    name: str,
    model: Sequence[Posed],
    image_of: Callable[[str], Path],
    depths: Path,
    image_scale: float = 1.0,
    encoding: Encoding = "gamma",
    metres_per_unit: float = 1.0,
) -> Scene:
    """Return the scene of a model's registered images, undistorted on the way. Reads the image headers.

    image_of: where the image of a name in the model lies; depths: folder of depth maps in metres, of the undistorted
    images, which need not exist; metres_per_unit: what the model's lengths are multiplied with. Raises InputError when
    no image is there; what is wrong with the files of one view becomes a fault of that view.
    """
    names = [posed.name for posed in model]
    paths = {name: image_of(name) for name in names}
    missing = {name for name, path in paths.items() if not path.is_file()}
    first = paths[names[0]]
    if len(missing) == len(names):
        raise InputError(f"{first}: no such file, nor any of the model's {len(names)} images; copy the images there")
    found, ambiguous = find_depths(depths, names)

    views = []
    for posed in track(model, "image sizes"):
        path, faults = paths[posed.name], dict[Plane, str]()
        if posed.name in missing:
            faults["rgb"] = f"{path}: no such file ({len(missing)} of {len(names)} images are missing); copy it there"
        if posed.name in ambiguous:
            faults["depth"] = ambiguous[posed.name]
        lens = posed.lens or Lens(posed.camera, "perspective", ())
        pose = posed.cam_from_world.copy()
        pose[:3, 3] *= metres_per_unit
        photograph = Photograph(posed.name, path, lens, pose, found.get(posed.name), faults=faults)
        views.append(view_of(photograph, image_scale, encoding))
    has = frozenset({"poses", "depth"} if found or ambiguous else {"poses"})
    return Scene(name, views, has, data_id=data_id_of(views))
