"""Writes the result below OUT: the model, depth maps, the page and prepare.json."""

import base64
import importlib.metadata
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at
from sucre_bench.imaging.drawing import depth_colours
from sucre_bench.imaging.image_files import decode
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.machine.text_formats import filled_in
from sucre_bench.programs.prepare.make_depth_maps import DepthMaps, write_depth
from sucre_bench.programs.prepare.mapping import Mapped
from sucre_bench.programs.prepare.prepare_json import Prepared, Quality, write_record
from sucre_bench.programs.prepare.registered_photos import Shot, load_pycolmap

_PACKAGES = ("sucre-bench", "pycolmap", "opencv-python-headless", "open3d", "numpy")
_THUMBNAIL = 420  # pixels wide
_MOST_SHOWN = 100  # images on the page
_ATTEMPTS = {"usual": "first", "faint": "second"}  # as the page calls them


def write_scene(
    made: Prepared,
    pinhole: Path,
    mapped: Mapped,
    shots: Sequence[Shot],
    maps: DepthMaps,
    surface: str,
    asked: Mapping[str, Any],
    aside: Path,
) -> Prepared:
    """Write the result in metres, or in units if the scale is arbitrary, and return it with its figures.

    pinhole: the model of the undistorted images; surface: what the depth maps are made from; asked: photos and options;
    aside: a folder on the same disk. Model and depth maps are written there and moved together, so that a stop in
    between cannot leave them at two scales.
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
        "photos placed": f"{len(shots)} of {made.photos}, in the {_ATTEMPTS[mapped.attempt]} attempt",
        "sparse points": f"{model.num_points3D()}, each seen by {model.compute_mean_track_length():.1f} photos",
        **_figures(qualities),
        "surface": surface,
        "scale": made.scale.note,
    }
    page = filled_in(
        __package__,
        "quality.html.j2",
        title=out.resolve().name,
        unit="m" if made.scale.is_metric else "no unit",
        made=made,
        facts=facts,
        pictures=pictures,
    )
    write_atomically(out / "quality.html", page)
    cameras = pycolmap.Reconstruction(mapped.model).cameras.items()
    more = {
        "photos": asked["photos"],
        "options": {name: value for name, value in asked.items() if name != "photos"},
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
    on_page = shots[:: -(-len(shots) // _MOST_SHOWN)]  # all, or evenly chosen ones of a long dive
    pictures, qualities = {}, []
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    near, far = np.quantile(depths, [0.02, 0.98])
    for shot in track(shots, "depth maps"):
        depth = maps(shot)
        write_depth(folder, shot.name, depth * np.float32(factor))
        qualities.append(quality_of(shot, depth, factor))
        if shot in on_page:
            pictures[shot.name] = _thumbnails(images / shot.name, depth, (near, far))
    return qualities, pictures


def quality_of(shot: Shot, depth: Array, metres_per_unit: float) -> Quality:
    """Return the figures of an image. depth: (H, W) in the model's unit, as the shot's points are."""
    xy, z = shot.seen_points()
    off = np.linalg.norm(xy - shot.xy, axis=1)
    off = off[np.isfinite(off)]
    there = depth_at(depth, xy)
    error = np.abs(there[there > 0] / z[there > 0] - 1)
    filled = depth[depth > 0]
    near, far = np.quantile(filled, [0.01, 0.99]) * metres_per_unit if len(filled) else (np.nan, np.nan)
    return Quality(
        shot.name,
        len(z),
        float(off.mean()) if len(off) else float("nan"),
        float((depth > 0).mean()),
        float(np.median(error)) if len(error) else float("nan"),
        float(near),
        float(far),
    )


def _thumbnails(image: Path, depth: Array, bounds: tuple[float, float]) -> tuple[str, str]:
    """Return an image and its depth map, coloured between bounds (near, far; black: none), as data URIs."""
    import cv2

    stored = decode(image, cv2.IMREAD_COLOR)
    size = (_THUMBNAIL, max(1, round(stored.shape[0] * _THUMBNAIL / stored.shape[1])))
    small = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST_EXACT)
    coloured = depth_colours(np.asarray(small), *bounds, unknown=0)[..., ::-1]
    return _uri(cv2.resize(stored, size, interpolation=cv2.INTER_AREA)), _uri(coloured)


def _uri(image: npt.NDArray[Any]) -> str:
    import cv2

    encoded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 82])[1]
    return f"data:image/jpeg;base64,{base64.b64encode(encoded.tobytes()).decode()}"


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
