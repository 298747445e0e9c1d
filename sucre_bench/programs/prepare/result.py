"""The result below OUT: the model, depth maps, the page, and prepare.json."""

import base64
import importlib.metadata
import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at
from sucre_bench.imaging.drawing import depth_colours
from sucre_bench.imaging.image_files import read_bgr_8bit, write_png
from sucre_bench.machine.files import reading, write_atomically
from sucre_bench.machine.pages import filled_in
from sucre_bench.machine.progress import track
from sucre_bench.programs.prepare.depth_maps import (
    INTERPOLATED,
    MEASURED,
    DepthMap,
    DepthMaps,
    nearest,
    write_depth,
)
from sucre_bench.programs.prepare.mapping import Mapped
from sucre_bench.programs.prepare.scale import Known, Scale
from sucre_bench.programs.prepare.shots import Shot, load_pycolmap, write_model

_FILE = "prepare.json"
_MODEL = ("sparse/cameras.bin", "sparse/images.bin", "sparse/points3D.bin")
_FOLDERS = ("sparse", "depths", "depth_origin")  # that go together
_PACKAGES = ("sucre-bench", "pycolmap", "opencv-python-headless", "open3d", "numpy")
_THUMBNAIL = 420  # pixels wide
_MOST_SHOWN = 100  # images on the page
_ATTEMPTS = {
    "usual": "in the first attempt",
    "faint": "in the second attempt",
    "given": "by the given model",
}
# the page marks worse values
_MILD_COVERAGE = 0.1
_MILD_ERROR = 0.02


@dataclass(frozen=True, slots=True)
class Quality:
    """The quality of one image."""

    name: str

    points: int
    """Sparse points seen."""

    reprojection_px: float
    """Mean distance of the sparse points from where they were found, in pixels of the undistorted image, NaN without
    points."""

    coverage: float
    """Share of pixels with depth."""

    depth_error: float
    """Median relative difference of the depth map from the sparse points, NaN if none has both."""

    # 1 and 99 % of depths.
    nearest_m: float
    farthest_m: float

    measured: float = 0.0
    """Share of pixels whose depth this photo measured."""

    interpolated: float = 0.0
    """Share of pixels whose place no photo measured."""

    @property
    def is_poor(self) -> bool:
        """Whether the page shows the image's line in red."""
        return self.coverage < _MILD_COVERAGE or not self.depth_error <= _MILD_ERROR


@dataclass(frozen=True, slots=True)
class Prepared:
    """The result of `prepare`."""

    out: Path
    """Its folder."""

    qualities: tuple[Quality, ...]
    """Figures of its images."""

    # Photos left out, with reason and remedy.
    damaged: dict[str, str]
    unplaced: dict[str, str]

    scale: Scale

    known: Known
    """What the scale was found from."""

    warnings: tuple[str, ...]

    keys: tuple[str, str]
    """Of the model and of the depth maps' stage, which decide whether a scale and a length are still valid."""

    is_new: bool = True
    """False if nothing had to be done."""

    is_kept: bool = False
    """Whether the scale is that of an earlier command."""

    focal: str = ""
    """See `_focal`."""

    @property
    def photos(self) -> int:
        """The number of photos."""
        return len(self.qualities) + len(self.damaged) + len(self.unplaced)

    @property
    def is_whole(self) -> bool:
        """Whether all its files exist; a depth map may have any of its formats."""
        depths = (PurePosixPath("depths", q.name) for q in self.qualities if q.coverage)
        stems = (self.out / depth.with_name(f"depth_{depth.stem}") for depth in depths)
        files = (*_MODEL, "quality.html", *(f"images/{q.name}" for q in self.qualities))
        return all((self.out / file).is_file() for file in files) and all(
            any(stem.with_name(stem.name + suffix).is_file() for suffix in (".png", ".tif"))
            for stem in stems
        )


def read_record(out: Path) -> Prepared | None:
    """Return the result that prepare.json tells of; None if there is none. Raises InputError if it cannot be read."""
    file = out / _FILE
    if not file.is_file():
        return None
    with reading(file, "remove it, and give the scale again if one was given"):
        record = json.loads(file.read_bytes())
        scale = dict(record["scale"])
        known = scale.pop("known")
        nan: Any = float("nan")
        qualities = tuple(
            Quality(**{k: nan if v is None else v for k, v in q.items()})
            for q in record["images"]
        )
        keys = record["made_of"]["model"], record["made_of"]["depths"]
        damaged, unplaced, warnings = (
            dict(record["damaged"]),
            dict(record["unplaced"]),
            tuple(record["warnings"]),
        )
        focal = _focal(record["cameras"], record["options"])
        return Prepared(
            out,
            qualities,
            damaged,
            unplaced,
            Scale(**scale),
            dict(known),
            warnings,
            keys,
            focal=focal,
        )


def write_result(
    made: Prepared,
    pinhole: Path,
    mapped: Mapped,
    shots: Sequence[Shot],
    surface: tuple[str, DepthMaps],
    asked: Mapping[str, Any],
    aside: Path,
) -> Prepared:
    """Write the result in metres, or in units if the scale is arbitrary, and return it with its figures.

    pinhole: the model of the undistorted images; surface: what the depth maps are made from, and these; asked: photos
    and options; aside: a folder on the same disk. Model and depth maps are written there and moved together, so that a
    stop in between cannot leave them at two scales.
    """
    pycolmap = load_pycolmap()
    out = made.out
    factor = made.scale.metres_per_unit
    model = pycolmap.Reconstruction(pinhole)
    model.transform(pycolmap.Sim3d(factor, pycolmap.Rotation3d(), np.zeros(3)))
    for folder in _FOLDERS:
        for old in (folder, f"old-{folder}"):
            shutil.rmtree(aside / old, ignore_errors=True)
        (aside / folder).mkdir()
    write_model(model, aside / "sparse")

    made_from, maps = surface
    near, far = np.quantile(
        np.concatenate([shot.seen_points()[1] for shot in shots]), [0.02, 0.98]
    )
    # all, or evenly chosen ones of a long dive
    on_page = shots[:: -(-len(shots) // _MOST_SHOWN)]
    pictures = {}
    qualities = []
    for shot in track(shots, "depth maps"):
        depth, origin = maps(shot)
        if write_depth(aside / "depths", shot.name, depth * np.float32(factor)):
            write_png(
                aside / "depth_origin" / PurePosixPath(shot.name).with_suffix(".png"), origin
            )
        qualities.append(quality_of(shot, DepthMap(depth, origin), factor))
        if shot in on_page:
            pictures[shot.name] = _thumbnails(out / "images" / shot.name, depth, (near, far))
    errors = [q.depth_error for q in qualities if np.isfinite(q.depth_error)]
    off = 100 * float(np.median(errors)) if errors else math.nan
    if off > 100 * _MILD_ERROR and not (asked["mesh"] or asked["depth"]):
        fault = f"depth is {off:.1f} % off the sparse points, so the lens or the camera positions are wrong"
        remedy = "add photos from other heights and directions, or hold the focal length of a calibration with --focal"
        made = replace(made, warnings=(*made.warnings, f"{fault}; {remedy}"))
    cameras = _cameras(pycolmap.Reconstruction(mapped.model))
    made = replace(made, qualities=tuple(qualities), focal=_focal(cameras, asked))
    for (
        folder
    ) in _FOLDERS:  # renamed, because deleting takes long, and a stop would leave no result
        if (out / folder).exists():
            (out / folder).rename(aside / f"old-{folder}")
    for folder in _FOLDERS:
        (aside / folder).rename(out / folder)
        shutil.rmtree(aside / f"old-{folder}", ignore_errors=True)

    facts = _facts(made, model, mapped, off, made_from)
    unit = "m" if made.scale.is_metric else "no unit"
    title = out.resolve().name
    page = {"title": title, "unit": unit, "made": made, "facts": facts, "pictures": pictures}
    write_atomically(out / "quality.html", filled_in(__package__, "quality.html.j2", **page))
    _write_record(made, asked, facts, cameras)
    return made


def _facts(
    made: Prepared, model: Any, mapped: Mapped, off: float, made_from: str
) -> dict[str, str]:
    """What the page says of a result. model: pycolmap's, of undistorted images; off: % from depth to sparse points."""
    seen = [(q.reprojection_px, q.points) for q in made.qualities if q.points]
    error = np.average([px for px, _ in seen], weights=[count for _, count in seen])
    covered, measured, between = 100 * np.mean(
        [(q.coverage, q.measured, q.interpolated) for q in made.qualities], axis=0
    )
    parts = f" ({measured:.0f} % measured in the photo itself, {between:.0f} % between measured points)"
    return {
        "photos placed": f"{len(made.qualities)} of {made.photos}, {_ATTEMPTS[mapped.attempt]}",
        "sparse points": f"{model.num_points3D()}, each seen by {model.compute_mean_track_length():.1f} photos",
        "reprojection error": f"{error:.2f} px",
        "focal length": made.focal,
        "pixels with depth": f"{covered:.0f} %" + (parts if measured else ""),
        "depth against sparse points": f"{off:.2f} % (median)"
        if math.isfinite(off)
        else "no photo has depth",
        "surface": made_from,
        "scale": made.scale.note,
    }


def _cameras(model: Any) -> dict[str, dict[str, Any]]:
    """The cameras of the distorted photos, for prepare.json; `order` names their params in COLMAP's order."""
    return {
        str(number): {
            "model": camera.model.name,
            "width": camera.width,
            "height": camera.height,
            "order": [name.strip() for name in camera.params_info.split(",")],
            "params": [float(value) for value in camera.params],
        }
        for number, camera in model.cameras.items()
    }


def _focal(cameras: Mapping[str, Any], options: Mapping[str, Any]) -> str:
    """The cameras' focal lengths, for people."""
    found = [
        camera["params"][0] / max(camera["width"], camera["height"])
        for camera in cameras.values()
    ]
    widths = " to ".join(sorted({f"{width:.2f}" for width in (min(found), max(found))}))
    return (
        f"{widths} widths (longer sides) of a photo{', held' if options.get('focal') else ''}"
    )


def _write_record(
    made: Prepared, asked: Mapping[str, Any], facts: Any, cameras: Mapping[str, Any]
) -> None:
    """Write prepare.json."""
    record = {
        "photos": asked["photos"],
        "options": {name: value for name, value in asked.items() if name != "photos"},
        "facts": facts,
        "cameras": cameras,
        "versions": {name: importlib.metadata.version(name) for name in _PACKAGES},
        "scale": {**asdict(made.scale), "known": made.known},
        "damaged": made.damaged,
        "unplaced": made.unplaced,
        "warnings": list(made.warnings),
        "images": [
            {k: None if v != v else v for k, v in asdict(q).items()} for q in made.qualities
        ],
        "made_of": dict(zip(("model", "depths"), made.keys, strict=True)),
    }
    write_atomically(
        made.out / _FILE, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode()
    )


def quality_of(shot: Shot, seen: DepthMap, metres_per_unit: float) -> Quality:
    """Return the figures of an image. seen: its depth map in the model's unit, as the shot's points are."""
    depth, origin = seen
    xy, z = shot.seen_points()
    there = depth_at(depth, xy)
    filled = depth[depth > 0]
    off = np.linalg.norm(xy - shot.xy, axis=1)
    errors = np.abs(there[there > 0] / z[there > 0] - 1)
    off = off[np.isfinite(off)]
    px, error = (
        float(middle(v)) if len(v) else np.nan
        for middle, v in ((np.mean, off), (np.median, errors))
    )
    near, far = (
        float(np.quantile(filled, q)) * metres_per_unit if len(filled) else np.nan
        for q in (0.01, 0.99)
    )
    coverage, measured, between = (
        float(m.mean()) for m in (depth > 0, origin == MEASURED, origin == INTERPOLATED)
    )
    return Quality(shot.name, len(z), px, coverage, error, near, far, measured, between)


def _thumbnails(image: Path, depth: Array, bounds: tuple[float, float]) -> list[str]:
    """Return an image and its depth map, coloured between bounds (near, far; black: none), as data URIs."""
    import cv2

    stored = read_bgr_8bit(image)
    size = (_THUMBNAIL, max(1, round(stored.shape[0] * _THUMBNAIL / stored.shape[1])))
    coloured = depth_colours(nearest(depth, size), *bounds, unknown=0)[..., ::-1]
    pictures = (cv2.resize(stored, size, interpolation=cv2.INTER_AREA), coloured)
    encoded = [
        cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 82])[1] for picture in pictures
    ]
    return [
        f"data:image/jpeg;base64,{base64.b64encode(jpeg.tobytes()).decode()}"
        for jpeg in encoded
    ]
