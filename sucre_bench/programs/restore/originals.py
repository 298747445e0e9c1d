"""The photographs of a dive: which file each view is of, and the lens that it was taken with."""

import json
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.camera import Camera
from sucre_bench.errors import DamagedFileError, InputError
from sucre_bench.loading.colmap_model import lens_of_model
from sucre_bench.loading.image_folder import image_names
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.files import check_folder, regular


@dataclass(frozen=True)
class PreparedDive:
    """What `sucre-bench prepare` noted of a dive. photographs: their folder; lenses: of its cameras."""

    photographs: Path
    lenses: tuple[Lens, ...]

    def lens_of(self, camera: Camera | None) -> Lens | None:
        """Return the lens whose pinhole image has this camera; None if the photograph has no distortion."""
        for lens in self.lenses:
            own = lens.pinhole
            is_same_size = camera is not None and (own.width, own.height) == (camera.width, camera.height)
            if camera and is_same_size and np.allclose(own.K, camera.K, rtol=1e-6) and any(lens.coefficients):
                return lens
        return None


def read_prepared(dive: Path) -> PreparedDive | None:
    """Return what a dive's prepare.json says; None without one. DamagedFileError if it cannot be read."""
    file = dive / "prepare.json"
    try:
        record = json.loads(regular(file).read_bytes())
        cameras = record["cameras"].values()
        lenses = (lens_of_model(c["model"], c["width"], c["height"], [float(p) for p in c["params"]]) for c in cameras)
        return PreparedDive(Path(record["photos"]), tuple(lens for lens in lenses if not lens.fault))
    except FileNotFoundError:
        return None
    except (OSError, InputError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as fault:
        raise DamagedFileError("is not what prepare wrote", file, "prepare the dive again") from fault


def photographs_in(folder: Path, leave_out: Path | None = None) -> dict[str, Path]:
    """Return the photographs in a folder and its sub-folders by their path in it. InputError if there is none."""
    check_folder(folder, "give the one that holds the photographs")
    found = {name: folder / name for name in image_names(folder, subfolders=True, but=leave_out)}
    if not found:
        raise InputError("holds no photographs", folder, "put .jpg, .png or .tif there")
    return found


def view_of_each(photographs: Mapping[str, Path], views: Collection[str]) -> dict[str, str]:
    """Return the name of the photograph that each view is of, as `prepare` names views; those without one left out."""
    found = {}
    for name in photographs:
        undistorted = (f"{name}.png", PurePosixPath(name).with_suffix(".png").as_posix())
        if view := next((one for one in (*undistorted, name) if one in views), ""):
            found[view] = name
    return found
