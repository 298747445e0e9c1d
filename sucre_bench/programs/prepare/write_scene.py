"""Writes the result below OUT: the model, depth maps, the page and prepare.json."""

import importlib.metadata
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.machine.progress import track
from sucre_bench.programs.prepare.load_pycolmap import load_pycolmap
from sucre_bench.programs.prepare.make_depth_maps import DepthMaps, write_depth
from sucre_bench.programs.prepare.prepare_json import Prepared, Quality, write_record
from sucre_bench.programs.prepare.quality import quality_of, shown, thumbnails, write_page
from sucre_bench.programs.prepare.registered_photos import Shot

_PACKAGES = ("sucre-bench", "pycolmap", "opencv-python-headless", "open3d", "numpy")
_ATTEMPTS = {"usual": "first", "faint": "second"}  # as the page calls them


def write_scene(
    made: Prepared,
    pinhole: Path,
    mapped: Path,
    shots: Sequence[Shot],
    maps: DepthMaps,
    asked: Mapping[str, Any],
    aside: Path,
) -> Prepared:
    """Write the result in metres, or in units if the scale is arbitrary, and return it with its figures.

    pinhole, mapped: models of the undistorted images and of the photos; asked: photos, options and attempt; aside: a
    folder on the same disk. Model and depth maps are written there and moved together, so that a stop in between cannot
    leave them at two scales.
    """
    pycolmap, out, factor = load_pycolmap(), made.out, made.scale.metres_per_unit
    model = pycolmap.Reconstruction(pinhole)
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(), np.zeros(3)))
    for folder in ("sparse", "depths"):
        shutil.rmtree(aside / folder, ignore_errors=True)
        (aside / folder).mkdir()
    model.write_binary(aside / "sparse")

    qualities, pictures = _write_depths(aside / "depths", shots, maps, factor, out / "images")
    made = replace(made, qualities=tuple(qualities))
    (out / "quality.html").unlink(missing_ok=True)  # without this file the same command writes everything again
    for folder in ("sparse", "depths"):
        _swap(aside / folder, out / folder)

    facts = {
        "photos placed": f"{len(shots)} of {made.photos}, in the {_ATTEMPTS[asked['attempt']]} attempt",
        "sparse points": f"{model.num_points3D()}, each seen by {model.compute_mean_track_length():.1f} photos",
        **_figures(qualities),
        "surface": maps.surface,
        "scale": made.scale.note,
    }
    write_page(made, facts, pictures)
    cameras = pycolmap.Reconstruction(mapped).cameras.items()
    more = {
        "photos": asked["photos"],
        "options": {name: value for name, value in asked.items() if name not in ("photos", "attempt")},
        "facts": facts,
        "cameras": {str(number): _plain(camera) for number, camera in cameras},
        "versions": {name: importlib.metadata.version(name) for name in _PACKAGES},
    }
    write_record(made, more)
    return made


def _write_depths(
    folder: Path, shots: Sequence[Shot], maps: DepthMaps, factor: float, images: Path
) -> tuple[list[Quality], dict[str, tuple[str, str]]]:
    """Write all depth maps times a factor; return their figures, and the page's thumbnails by name."""
    on_page, pictures, qualities = shown([shot.name for shot in shots]), {}, []
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    near, far = np.quantile(depths, [0.02, 0.98])
    for shot in track(shots, "depth maps"):
        depth = maps.depth(shot)
        write_depth(folder, shot.name, depth * np.float32(factor))
        qualities.append(quality_of(shot, depth, factor))
        if shot.name in on_page:
            pictures[shot.name] = thumbnails(images / shot.name, depth, (near, far))
    return qualities, pictures


def _figures(qualities: Sequence[Quality]) -> dict[str, str]:
    """Means over the photos, as the page says them."""
    seen = [(q.reprojection_px, q.points) for q in qualities if q.points]
    error = np.average([px for px, _ in seen], weights=[count for _, count in seen])
    return {
        "reprojection error": f"{error:.2f} px",
        "pixels with depth": f"{100 * np.mean([q.coverage for q in qualities]):.0f} %",
        "depth against sparse points": f"{100 * np.nanmedian([q.depth_error for q in qualities]):.2f} % (median)",
    }


def _swap(new: Path, place: Path) -> None:
    """Replace a folder by another."""
    old = new.with_name(f"old-{new.name}")
    shutil.rmtree(old, ignore_errors=True)
    if place.exists():
        place.rename(old)
    new.rename(place)
    shutil.rmtree(old, ignore_errors=True)


def _plain(camera: Any) -> dict[str, Any]:
    """A camera of the distorted photos as plain data; `order` names its params in COLMAP's order."""
    return {
        "model": camera.model.name,
        "width": camera.width,
        "height": camera.height,
        "order": [name.strip() for name in camera.params_info.split(",")],
        "params": [float(value) for value in camera.params],
    }
