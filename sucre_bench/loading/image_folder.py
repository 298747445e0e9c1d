"""Scenes of images without cameras: a folder, with or without references of the same names in another folder."""

import sys
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from sucre_bench.errors import InputError, is_utf8
from sucre_bench.imaging.image_files import SUFFIXES, image_size
from sucre_bench.loading.charts_file import read_charts
from sucre_bench.loading.find_folders import folders_below, only, walk
from sucre_bench.loading.named_sets import members_in
from sucre_bench.loading.passed_over import EXPORT, OTHER_FORMATS
from sucre_bench.loading.view_files import Photograph, scene_of
from sucre_bench.machine.files import VIDEOS, frames_of
from sucre_bench.machine.progress import track
from sucre_bench.machine.text_formats import natural_order
from sucre_bench.scene import Encoding, Scene


def image_names(folder: Path, subfolders: bool = False, but: Path | None = None) -> list[str]:
    """Return the images in a folder, relative to it, in natural order; hidden files and the folder `but` left out.

    Raises InputError for a name in another encoding than UTF-8.
    """
    found = []
    but = but and but.resolve()
    for place, below, names in walk(folder):
        below[:] = [
            name
            for name in below
            if subfolders and not name.startswith(".") and (place / name).resolve() != but
        ]
        images = (
            name
            for name in names
            if name.lower().endswith(SUFFIXES) and not name.startswith(".")
        )
        found += [(place / name).relative_to(folder).as_posix() for name in images]
    if wrong := [name for name in found if not is_utf8(name)]:
        raise InputError("its name is no UTF-8", folder / wrong[0], "rename it")
    return sorted(found, key=natural_order)


def no_image(
    folder: Path, fault: str = "", remedy: str = "copy the images there", place: str = ""
) -> InputError:
    """Return the error for a folder without images. It names a photograph of another format or a video there.

    place: what the user typed for the folder.
    """
    for path in sorted(folder.iterdir()):
        if path.suffix.lower() in (*OTHER_FORMATS, *VIDEOS):
            what = f"{path.name} is in a format that sucre_bench does not read"
            remedy = frames_of(path) or EXPORT
            return InputError(what, place or folder, remedy)
    return InputError(
        fault or f"holds no image ({' '.join(SUFFIXES)})", place or folder, remedy
    )


def image_folder_scene(
    name: str,
    folder: Path,
    references: Path | None = None,
    image_scale: float = 1.0,
    encoding: Encoding = "gamma",
    subfolders: bool = False,
    charts: Path | None = None,
    split: str | None = None,
) -> Scene:
    """Return the scene of a folder's images, each with the reference that has the same path below `references`.

    charts: a charts.json, see `charts_file` (may be missing); split: a named test set, whose pictures and name the
    scene then has. A reference may have another suffix. An image without a reference gets a fault. Raises InputError if
    there is no image, if `references` holds none of the images, if charts.json is wrong, or the set is not all there.
    """
    names = image_names(folder, subfolders, but=references)
    if not names:
        raise no_image(folder)
    if split:
        name = split
        names = members_in(folder, names, split)
    found = {} if references is None else _references(names, references, subfolders)
    sizes = {image: image_size(folder / image) for image in track(names, "image sizes")}
    # An image that cannot be read has no size to check corners against; decoding it will say what is wrong.
    known = {image: size or (sys.maxsize, sys.maxsize) for image, size in sizes.items()}
    seen = read_charts(charts, known) if charts else {}
    photographs = [
        Photograph(
            image,
            folder / image,
            reference=found.get(image),
            charts=seen.get(image, ()),
            charts_file=charts,
            size=sizes[image],
        )
        for image in names
    ]
    return scene_of(name, photographs, image_scale, encoding)


def _references(images: Iterable[str], folder: Path, subfolders: bool) -> dict[str, Path | str]:
    """Return the reference of each image, or why it has none. Raises InputError if no image has one."""
    by_stem = defaultdict(list)
    for name in image_names(folder, subfolders):
        by_stem[_stem(name)].append(name)
    found: dict[str, Path | str] = {}
    for image in images:
        same = by_stem.get(_stem(image), [])
        files = [folder / name for name in ([image] if image in same else same)]
        found[image] = only(files) or f"{folder / image}: no such file; copy it there"
    if not any(_stem(image) in by_stem for image in found):
        raise InputError(
            "no file is named like an image", folder, f"name them like {next(iter(found))}"
        )
    return found


@dataclass(frozen=True, kw_only=True)
class SplitOption:
    """The option of datasets of single images to take a named test set."""

    split: str | None = None
    """A named test set (`sucre-bench list sets`): only its pictures, which must all be there; null: every picture."""


def _stem(name: str) -> str:
    return PurePosixPath(name).with_suffix("").as_posix().lower()


def paired_folders(
    root: Path, inputs: Iterable[str], references: Iterable[str]
) -> Iterator[tuple[Path, Path, Path | None]]:
    """Yield each folder at or below root that holds one of the folders `inputs`: itself, that, and one of `references`.

    Case does not matter; the first name found counts. An archive that was unpacked into a folder of its own name is
    found there.
    """
    inputs, references = list(inputs), list(references)
    for place in folders_below(
        root, lambda _, below: bool({name.lower() for name in below} & set(inputs))
    ):
        there = {path.name.lower(): path for path in sorted(place.iterdir()) if path.is_dir()}
        images = next(there[name] for name in inputs if name in there)
        targets = next((there[name] for name in references if name in there), None)
        yield place, innermost(images), targets and innermost(targets)


def innermost(folder: Path) -> Path:
    """Return the innermost of folders that hold only one folder each, as archives unpack to raw-890/raw-890."""
    below = [
        path
        for path in folder.iterdir()
        if path.is_dir() and not path.name.startswith((".", "__MACOSX"))
    ]
    return folder if len(below) != 1 or image_names(folder) else innermost(below[0])
