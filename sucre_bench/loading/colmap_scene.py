"""Makes a scene of a COLMAP model, whose cameras may be distorted, and of the files of its images."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from sucre_bench.errors import MissingFileError
from sucre_bench.imaging.image_files import image_size
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.colmap_model import Posed
from sucre_bench.loading.depth_maps import find_depths
from sucre_bench.loading.view_files import Photograph, data_id_of, scaled_pose, straight_lens, view_of
from sucre_bench.machine.files import fault_of
from sucre_bench.machine.progress import track
from sucre_bench.scene import Encoding, Plane, Scene


def registered_scene(
    name: str,
    model: Sequence[Posed],
    image_of: Callable[[str], Path],
    depths: Path,
    image_scale: float = 1.0,
    encoding: Encoding = "gamma",
    metres_per_unit: float = 1.0,
    references: Mapping[str, Path] | None = None,
    charts: Path | None = None,
) -> Scene:
    """Return the scene of a model's registered images, undistorted when they are decoded. Reads headers only.

    image_of: the file of each image name of the model; depths: folder of depth maps in metres, of the undistorted
    images (may be missing); metres_per_unit: factor for the model's lengths; references: the image without water of
    each image that has one, distorted like it; charts: see `charts_file` (may be missing).
    Raises MissingFileError if no image exists. A fault in the files of one view becomes a fault of that view.
    """
    paths = {posed.name: image_of(posed.name) for posed in model}
    missing = _missing(paths)
    sizes = {
        posed.name: image_size(paths[posed.name]) or (posed.camera.width, posed.camera.height)
        for posed in track(model, "image sizes")
    }
    found, ambiguous = find_depths(depths, list(paths))
    seen = {} if charts is None else read_charts(charts, sizes)
    faults: dict[Plane, Mapping[str, str]] = {"rgb": missing, "depth": ambiguous}

    def photograph(posed: Posed) -> Photograph:
        name = posed.name
        return Photograph(
            name,
            paths[name],
            posed.lens or straight_lens(posed.camera),
            scaled_pose(posed.cam_from_world, metres_per_unit),
            found.get(name),
            reference=(references or {}).get(name),
            charts=seen.get(name, ()),
            charts_file=charts,
            size=sizes[name],
            faults={plane: of_plane[name] for plane, of_plane in faults.items() if name in of_plane},
        )

    views = [view_of(photograph(posed), image_scale, encoding) for posed in model]
    optional = {"depth": found or ambiguous, "reference": references, "charts": seen}
    has = frozenset({"poses", *(what for what, there in optional.items() if there)})
    return Scene(name, views, has, data_id=data_id_of(views))


def _missing(paths: Mapping[str, Path]) -> dict[str, str]:
    """Return the fault of each image that is not there, by name. Raises MissingFileError if none is."""
    faults = {name: fault for name, path in paths.items() if (fault := fault_of(path))}
    if len(faults) == len(paths):
        first = next(iter(paths.values()))
        raise MissingFileError(f"none of the model's {len(paths)} images is there", first, "copy them there")
    of = f"{len(faults)} of the model's {len(paths)} images are missing"
    return {name: f"{paths[name]}: {fault} ({of}); copy it there" for name, fault in faults.items()}
