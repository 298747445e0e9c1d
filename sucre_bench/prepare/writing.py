"""What is written below OUT once everything is known: the model, depth maps, the page of figures and the record."""

from __future__ import annotations

import importlib.metadata
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.prepare.colmap import load_pycolmap
from sucre_bench.prepare.depthmaps import Dense, DepthMaps, write_depth
from sucre_bench.prepare.quality import quality_of, shown, thumbnails, write_page
from sucre_bench.prepare.record import Prepared, write_record
from sucre_bench.prepare.shots import Shot
from sucre_bench.progress import track

__all__ = ["write"]

_PACKAGES = ("sucre-bench", "pycolmap", "opencv-python-headless", "open3d", "numpy")


def write(
    made: Prepared, pinhole: Path, mapped: Path, shots: Sequence[Shot], maps: DepthMaps, asked: Mapping[str, Any]
) -> Prepared:
    """Write all of it in metres, or in units where the scale is arbitrary; return what was made, with its figures.

    pinhole, mapped: models of the undistorted images and of the photos; asked: photos, options, and which attempt.
    """
    pycolmap, out, factor = load_pycolmap(), made.out, made.scale.metres_per_unit
    model = pycolmap.Reconstruction(pinhole)
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(), np.zeros(3)))
    (out / "sparse").mkdir(exist_ok=True)
    model.write_binary(out / "sparse")

    on_page, pictures, qualities = shown([shot.name for shot in shots]), {}, []
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    near, far = np.quantile(depths, [0.02, 0.98])
    for shot in track(shots, "depth maps"):
        depth = maps.depth(shot)
        write_depth(out / "depths", shot.name, depth * np.float32(factor))
        qualities.append(quality_of(shot, depth, factor))
        if shot.name in on_page:
            pictures[shot.name] = thumbnails(out / "images" / shot.name, depth, (near, far))
    made = replace(made, qualities=tuple(qualities))

    error = np.average([q.reprojection_px for q in qualities], weights=[q.points for q in qualities])
    surface = "plane sweep, confirmed by other photos" if isinstance(maps, Dense) else "relief of the sparse points"
    facts = {
        "photos placed": f"{len(shots)} of {made.photos}, at the {asked['attempt']} attempt",
        "sparse points": f"{model.num_points3D()}, each seen by {model.compute_mean_track_length():.1f} photos",
        "reprojection error": f"{error:.2f} px",
        "pixels with depth": f"{100 * np.mean([q.coverage for q in qualities]):.0f} %",
        "depth against sparse points": f"{100 * np.nanmedian([q.depth_error for q in qualities]):.2f} % (median)",
        "surface": surface,
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


def _plain(camera: Any) -> dict[str, Any]:
    """A camera of the photos as they are; params in COLMAP's order, which `order` names."""
    return {
        "model": camera.model.name,
        "width": camera.width,
        "height": camera.height,
        "order": [name.strip() for name in camera.params_info.split(",")],
        "params": [float(value) for value in camera.params],
    }
