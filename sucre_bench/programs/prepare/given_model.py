"""Cameras and poses that another program found: COLMAP, hloc, Metashape or nerfstudio.

A COLMAP model keeps its sparse points. Of other models the points are made anew, at the given poses.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from sucre_bench.camera import scaled_camera
from sucre_bench.engine.python_api import load_scenes
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import same_shape
from sucre_bench.jobs.catalogue import recognised
from sucre_bench.loading.colmap_model import Posed, read_model
from sucre_bench.loading.find_folders import ImageFolder
from sucre_bench.loading.lens import Lens
from sucre_bench.programs.prepare.mapping import Mapped, Rules, adopted, map_photos
from sucre_bench.programs.prepare.photos import Photo

_FEWEST_POINTS = 20  # a photo, on average, of a COLMAP model whose points are kept
_UNDISTORTED = "undistort the photos in that program, and give these with their model"


def given_model(model: Path, photos: Sequence[Photo], folder: Path, work: Path, rules: Rules) -> Mapped:
    """Return the model with the photos' names, sizes and features; its poses and its unit stay.

    model: a folder or file of COLMAP, Metashape or nerfstudio; folder: that of the photos; work: to write into.
    Raises InputError if it cannot be read, or if none of its images is among the photos.
    """
    places = (model / "0", model / "sparse", model / "sparse" / "0")
    sparse = next((place for place in (model, *places) if any(place.glob("cameras.[bt]*"))), None)
    posed = read_model(sparse, folder, distorted=True) if sparse else _posed(model, folder)
    files, by_name = ImageFolder(folder), {photo.name: photo for photo in photos}
    found: dict[str, tuple[Posed, Photo]] = {}
    faults: dict[str, str] = {}
    for one in posed:
        photo = next((by_name[name] for name in files.find(one.name) if name in by_name), None)
        if photo is None:
            continue
        size = one.camera.width, one.camera.height
        if same_shape(photo.size, size):
            found[one.name] = one, photo
        else:
            fault = f"is {photo.size[0]}x{photo.size[1]}, its camera in the model {size[0]}x{size[1]}"
            faults[photo.name] = f"{fault}; give the photo that the model was made of"
    if not found:
        why = next(iter(faults.values()), "").partition(";")[0] or f"not even {posed[0].name}"
        fault = f"none of its {len(posed)} images is among the photos in {folder} ({why})"
        raise InputError(fault, model, "give the folder of the photos that it was made of")
    if sparse and (kept := adopted(sparse, {name: photo for name, (_, photo) in found.items()}, work, _FEWEST_POINTS)):
        return replace(kept, damaged=faults)
    given = {photo.key: _at_size(one, photo.size, model) for one, photo in found.values()}
    rules = rules._replace(cameras="image")  # each photo has the camera of the model
    mapped = map_photos([photo for _, photo in found.values()], work, rules, given)
    return replace(mapped, attempt="given", damaged=mapped.damaged | faults)


def _posed(model: Path, folder: Path) -> list[Posed]:
    """Read the model as a dataset: the largest of its scenes."""
    if model.is_file():
        is_json = model.suffix.lower() == ".json"
        kind, named = ("nerfstudio", {"transforms": model.name}) if is_json else ("metashape", {"document": model.name})
        root = model.parent
    else:
        kind, named, root = recognised(model), {}, model
    if kind not in ("nerfstudio", "metashape"):
        raise InputError(f"is dataset={kind}, which has no poses to keep here", model, "give a model with poses")
    if kind == "metashape":
        named["images"] = str(folder.resolve())
    views = max(load_scenes(kind, root=root, **named), key=len)
    return [
        Posed(view.name, view.camera, view.cam_from_world, getattr(view.pixels, "lens", None))
        for view in views
        if view.camera is not None and view.cam_from_world is not None
    ]


def _at_size(one: Posed, size: tuple[int, int], model: Path) -> Posed:
    """Return the image with its distorted camera at a size (width, height). Raises InputError for a lens of others."""
    lens = one.lens or Lens(one.camera, "perspective", ())
    if type(lens) is not Lens:
        fault = f"the lens of {one.name} has terms that COLMAP's models lack (b2, k4, p3 or p4)"
        raise InputError(fault, model, _UNDISTORTED)
    return replace(one, camera=scaled_camera(lens.camera, size), lens=lens)
