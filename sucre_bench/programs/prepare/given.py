"""What other programs found: cameras and poses of a model; depth as a mesh in its frame, or as a network's maps.

A network gives depth or disparity, often up to scale and shift. The sparse points of each photo tell these. What the
values are is decided for all photos together, because one network made them.

Models are those of COLMAP, hloc, Metashape or nerfstudio. A COLMAP model keeps its sparse points. Of other models the
points are made anew, at the given poses.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at, scaled_camera
from sucre_bench.engine.python_api import load_scenes
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import same_shape
from sucre_bench.jobs.catalogue import recognised
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.depth_maps import find_depths, stored_map
from sucre_bench.loading.find_folders import ImageFolder
from sucre_bench.loading.lens import Lens
from sucre_bench.machine.progress import say, track
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.depth_maps import (
    GIVEN,
    DepthMap,
    DepthMaps,
    nearest,
    of_surface,
)
from sucre_bench.programs.prepare.mapping import Mapped, adopted, map_photos
from sucre_bench.programs.prepare.photos import Photo
from sucre_bench.programs.prepare.plane_sweep import least_absolute
from sucre_bench.programs.prepare.shots import Shot
from sucre_bench.programs.prepare.surface import read_mesh

_UNITS = {
    1.0: "",
    0.001: "millimetres",
    0.01: "centimetres",
    0.0254: "inches",
    0.3048: "feet",
    1000.0: "kilometres",
}
# relative: a mesh is at a point, for most points
_NEAR = 0.05
# relative: two units fit a mesh alike
_SAME = 1e-3
_MOST_CHECKED = 12  # photos
_FEWEST_POINTS = 12  # of a photo, to fit its map
_WORST = 0.05  # median relative difference of a fitted map from the sparse points
# a map must be so much better than one constant depth, unless that is this good already
_BETTER = 0.7
_FLAT = 0.02
_SIMPLER = 1.1  # a fit with one more parameter must be better than this


def mesh_maps(path: Path, shots: Sequence[Shot]) -> DepthMaps:
    """Return the depth maps of a mesh in the model's frame. Raises InputError if it is in another one.

    A mesh in millimetres, centimetres, inches or feet, in a model in metres, is converted. One in .glb may be turned so
    that y is up, as glTF has it: from z, or from what is up in the photos.
    """
    from scipy.spatial.transform import Rotation

    mesh = read_mesh(path)
    turns = [np.eye(3)]
    if path.suffix.lower() == ".glb":
        ups = (
            np.array([0.0, 0, 1]),
            -np.sum([shot.cam_from_world[1, :3] for shot in shots], axis=0),
        )
        turns += [
            Rotation.align_vectors(np.array([[0.0, 1, 0]]), up[None])[0].as_matrix()
            for up in ups
        ]
    checked = [shot for shot in shots if len(shot.points)][:: -(-len(shots) // _MOST_CHECKED)]
    cast = mesh.caster()

    def off(turn: Array, unit: float) -> Array:
        """How far each sparse point is off the mesh, relative, 1 where the mesh is not."""
        found = []
        for shot in checked:
            pose, (xy, z) = shot.cam_from_world.copy(), shot.seen_points()
            # from the mesh's frame
            pose[:3] = np.column_stack([pose[:3, :3] @ turn.T, pose[:3, 3] / unit])
            found.append(
                np.abs(cast(replace(shot, cam_from_world=pose), xy)[0][0] * unit / z - 1)
            )
        return np.concatenate(found)

    choices = list(itertools.product(turns, _UNITS))
    offs = [float(np.median(off(*choice))) for choice in choices]
    if min(offs) > _NEAR:
        share = np.mean(off(*choices[0]) < _NEAR)
        fault = f"is in another frame than the model: {100 * share:.0f} % of the sparse points lie on it"
        raise InputError(
            fault,
            path,
            "export it from the program that made the model, in the same coordinates",
        )
    # A seabed through the origin fits in many units, one of them better than all.
    turn, unit = next(
        choice
        for choice, median in zip(choices, offs, strict=True)
        if median <= min(offs) + _SAME
    )
    if _UNITS[unit]:
        say(
            f"{path} fits the model when multiplied by {unit:g}; it seems to be in {_UNITS[unit]}"
        )
    return of_surface(replace(mesh, vertices=mesh.vertices @ turn * unit), GIVEN)


class _Form(NamedTuple):
    """What the values d of a map are: z = a d + b, or 1 / z = a d + b if inverse; b = 0 unless shifted."""

    inverse: bool
    shifted: bool

    def __str__(self) -> str:
        return f"{'disparity' if self.inverse else 'depth'} up to scale{' and shift' if self.shifted else ''}"

    def fit(self, values: Array, z: Array) -> Array:
        """Return (a, b) of least absolute relative differences from the depths z."""
        column = np.stack([values, np.full_like(values, self.shifted)], axis=1)
        design = column * z[:, None] if self.inverse else column / z[:, None]
        return least_absolute(design, np.ones(len(z)), 1e-4)

    def error(self, values: Array, z: Array) -> float:
        """Return the median relative difference of fitted values from depths; infinite if they are inverted."""
        fitted = self.fit(values, z)
        return (
            float(np.median(np.abs(self.depth(values, fitted) / z - 1)))
            if fitted[0] > 0
            else np.inf
        )

    def depth(self, values: Array, fitted: Array) -> Array:
        """Return the depths of values; 0 where the values or the depths are not above 0."""
        line = np.where(values > 0, fitted[0] * values + fitted[1] * self.shifted, 0)
        with np.errstate(divide="ignore"):
            return np.where(line > 0, 1 / line if self.inverse else line, 0).astype(np.float32)


_FORMS = tuple(
    _Form(inverse, shifted) for shifted in (False, True) for inverse in (False, True)
)


def network_maps(
    folder: Path,
    shots: Sequence[Shot],
    photo_of: Mapping[str, str],
    lens_of: Mapping[str, Lens | None],
) -> tuple[str, DepthMaps, dict[str, str]]:
    """Return what the maps are, for people, the fitted depth maps, and the fault of each photo without one.

    photo_of: the name of each shot's photo, after which its map is named; lens_of: by shot, the lens of that photo.
    Raises InputError if no map can be used.
    """
    maps = find_depths(folder, [photo_of[shot.name] for shot in shots])
    found = {name: file for name, file in maps.items() if isinstance(file, Path)}
    faults = {
        name: str(maps.get(name, f"{folder} has no map of it"))
        for name in photo_of.values()
        if name not in found
    }
    seen: dict[
        str, tuple[Callable[[], Array], Array, Array]
    ] = {}  # reader, values at sparse points, their depths
    for shot in track(
        [shot for shot in shots if photo_of[shot.name] in found], "reading depth maps"
    ):
        name = photo_of[shot.name]
        try:
            read = partial(_read_map, found[name], shot, lens_of[shot.name])
            xy, z = shot.seen_points()
            values = read()
            height, width = values.shape
            at = depth_at(values, xy * (width / shot.camera.width, height / shot.camera.height))
            known = at > 0
            if known.sum() < _FEWEST_POINTS:
                raise InputError(
                    f"{known.sum()} sparse points have a value",
                    found[name],
                    "it cannot be fitted",
                )
            seen[shot.name] = read, at[known], z[known]
        except InputError as fault:
            faults[name] = str(fault)
    if not seen:
        raise InputError(
            "no depth map can be used", folder, f"first fault: {next(iter(faults.values()))}"
        )
    errors = {
        form: [form.error(values, z) for _, values, z in seen.values()] for form in _FORMS
    }
    form = min(
        _FORMS, key=lambda form: np.median(errors[form]) * (_SIMPLER if form.shifted else 1)
    )
    fitted: dict[str, Array] = {}
    for (name, (_, values, z)), error in zip(seen.items(), errors[form], strict=True):
        constant = float(np.median(np.abs(np.median(z) / z - 1)))
        if error > _WORST or (error > _BETTER * constant and constant > _FLAT):
            faults[photo_of[name]] = (
                f"its depth map {_misfit(error)}; make it as the others, of this photo"
            )
        else:
            fitted[name] = form.fit(values, z)
    if not fitted:
        best = f"none of {len(seen)} depth maps fits; the best {_misfit(min(errors[form]))}"
        raise InputError(best, folder, "give maps of these photos, as depth or disparity")

    def depth(shot: Shot) -> DepthMap:
        size = shot.camera.size
        if shot.name not in fitted:
            return DepthMap(np.zeros(size[::-1], np.float32), np.zeros(size[::-1], np.uint8))
        z = form.depth(seen[shot.name][0](), fitted[shot.name])
        z = z if z.shape[::-1] == size else nearest(z, size)
        return DepthMap(z, ((z > 0) * GIVEN).astype(np.uint8))

    return f"given maps, {form}", depth, faults


def _misfit(error: float) -> str:
    return (
        f"is {100 * error:.1f} % off the sparse points (median)"
        if error < np.inf
        else "is inverted"
    )


def _read_map(path: Path, shot: Shot, lens: Lens | None) -> Array:
    """Read a map (h, w) float32 of the undistorted photo, 0 = unknown, at its own size."""
    values = stored_map(path).astype(np.float32)
    if values.ndim == 3 and (values == values[..., :1]).all():
        values = values[..., 0]
    size = shot.camera.size
    if values.ndim != 2 or not same_shape(values.shape[::-1], size):
        fault = f"is {'x'.join(map(str, values.shape[::-1]))}, its photo {size[0]}x{size[1]}"
        raise InputError(fault, path, "make the map of the whole photo, with one channel")
    values = np.where(np.isfinite(values), values, 0)
    if lens is None:
        return values
    return lens.resampled(values, scaled_camera(shot.camera, values.shape[::-1]), nearest=True)


# -- models ------------------------------------------------------------------------------------------------

_FEWEST_ON_AVERAGE = 20  # a photo, on average, of a COLMAP model whose points are kept


def given_model(
    model: Path, photos: Sequence[Photo], folder: Path, work: Path, options: Options
) -> Mapped:
    """Return the model with the photos' names, sizes and features; its poses and its unit stay.

    model: a folder or file of COLMAP, Metashape or nerfstudio; folder: that of the photos; work: to write into.
    Raises InputError if it cannot be read, or if none of its images is among the photos.
    """
    places = (model / "0", model / "sparse", model / "sparse" / "0")
    sparse = next(
        (place for place in (model, *places) if any(place.glob("images.[bt]*"))), None
    )
    posed = (
        read_model(sparse, folder, distorted=True, keep_names=True)
        if sparse
        else _posed(model, folder)
    )
    files = ImageFolder(folder)
    by_name = {photo.name: photo for photo in photos}
    found: dict[str, tuple[Posed, Photo]] = {}
    faults: dict[str, str] = {}
    for one in posed:
        photo = next((by_name[name] for name in files.find(one.name) if name in by_name), None)
        if photo is None:
            continue
        size = one.camera.size
        if same_shape(photo.size, size):
            found[one.name] = one, photo
        else:
            fault = f"is {photo.size[0]}x{photo.size[1]}, its camera in the model {size[0]}x{size[1]}"
            faults[photo.name] = f"{fault}; give the photo that the model was made of"
    if not found:
        why = next(iter(faults.values()), "").partition(";")[0] or f"not even {posed[0].name}"
        fault = f"none of its {len(posed)} images is among the photos in {folder} ({why})"
        raise InputError(fault, model, "give the folder of the photos that it was made of")
    if sparse and (
        kept := adopted(
            sparse,
            {name: photo for name, (_, photo) in found.items()},
            work,
            _FEWEST_ON_AVERAGE,
        )
    ):
        return replace(kept, damaged=faults)
    given: dict[str, Posed] = {}
    for one, photo in found.values():
        lens = one.lens or Lens(one.camera)
        if type(lens) is not Lens:
            fault = (
                f"the lens of {one.name} has terms that COLMAP's models lack (b2, k4, p3 or p4)"
            )
            raise InputError(
                fault,
                model,
                "undistort the photos in that program, and give these with their model",
            )
        given[photo.key] = replace(
            one, camera=scaled_camera(lens.camera, photo.size), lens=lens
        )
    options = replace(options, cameras="image")  # each photo has the camera of the model
    mapped = map_photos([photo for _, photo in found.values()], work, options, given)
    return replace(mapped, attempt="given", damaged=mapped.damaged | faults)


def _posed(model: Path, folder: Path) -> list[Posed]:
    """Read the model as a dataset: the largest of its scenes."""
    kind = ""
    named = dict[str, str]()
    root = model
    if model.is_file():
        is_json = model.suffix.lower() == ".json"
        kind, named = (
            ("nerfstudio", {"transforms": model.name})
            if is_json
            else ("metashape", {"document": model.name})
        )
        root = model.parent
    else:
        with suppress(InputError):
            kind = recognised(model)
    if kind not in ("nerfstudio", "metashape"):
        remedy = "give the folder of cameras.bin and images.bin, cameras.xml or transforms.json"
        raise InputError(
            "holds no model of COLMAP, hloc, Metashape or nerfstudio", model, remedy
        )
    if kind == "metashape":
        named["images"] = str(folder.resolve())
    views = max(load_scenes(kind, root=root, **named), key=len)
    return [
        Posed(view.name, view.camera, view.cam_from_world, getattr(view.pixels, "lens", None))
        for view in views
        if view.camera is not None and view.cam_from_world is not None
    ]
