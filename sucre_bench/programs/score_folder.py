"""Score any folder of images, with no dataset and no method: `sucre-bench score`."""

import re
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arrays import Array, DataFrame, locked
from sucre_bench.engine.python_api import score
from sucre_bench.engine.score import row_without_value
from sucre_bench.errors import InputError, MissingFileError, PluginError
from sucre_bench.imaging.colour_profiles import read_srgb
from sucre_bench.imaging.image_files import image_size, is_jpeg
from sucre_bench.imaging.orientation import lying_as
from sucre_bench.imaging.reference_images import NEARER, outline, say_if_black
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.loading.find_folders import ImageFolder, bare_stems, only
from sucre_bench.loading.image_folder import image_names, no_image
from sucre_bench.loading.named_sets import Found, Picture, picture_of, recognised_sets
from sucre_bench.loading.passed_over import folders_in, say_passed_over
from sucre_bench.machine import processes, progress
from sucre_bench.machine.files import check_folder, fault_of
from sucre_bench.results.rows import restorations
from sucre_bench.scene import Plane, Restoration, View

_HOLES = "if it has none, `sucre-bench run dataset=photos method=precomputed precomputed.holes=black` leaves it out"


@dataclass(frozen=True, eq=False)
class _Pictures:
    """An image, its file, and that of its reference, of perhaps another size. A large one is read when it is needed."""

    rgb: Array
    path: Path
    reference: Path | None

    def load(self, plane: Plane) -> Array | None:
        if plane == "reference" and self.reference:
            return lying_as(
                read_srgb(self.reference)[0], self.reference, lambda: self.rgb, self.path
            )
        return self.rgb if plane == "rgb" else None


@dataclass(frozen=True, eq=False)
class FolderScores:
    """Scores of a folder."""

    rows: DataFrame
    """The long table's columns."""

    sets: Sequence[Found]
    """The named test sets of its references, or else of its images."""


def _fitting(
    path: Path, size: tuple[int, ...], reference: tuple[int, ...], metrics: Sequence[str]
) -> Sequence[str]:
    """The metrics that score an image against a reference of this size: of a square one of another size, those that
    resize both. Raises InputError if there are none.
    """
    if size == reference:
        return metrics
    at_a_size = [name for name in metrics if re.search(r"@\d", name)]
    if size[0] != size[1] or not at_a_size:
        sizes = [f"{shape[1]}x{shape[0]}" for shape in (size, reference)]
        raise InputError(
            f"{path}: {sizes[0]}, but its reference is {sizes[1]}; give one of the same size"
        )
    return at_a_size


def score_folder(
    images: Path, reference: Path | None, metrics: Sequence[str], is_known: bool = False
) -> FolderScores:
    """Score every image under a folder (or one file), the folder's name as the method, a whole named set as the scene.

    reference: a folder with the same names, or one file; metrics: names as `sucre_bench.score` takes them, none for
    every metric that applies, in all its variants. An image that cannot be read, or has no reference of its name, is a
    failed row. A line says when PNG or TIFF images are compared with JPEG references. is_known: that was said, and sets
    were looked for. Raises InputError when there is no image, no folder of references, or no reference of any image.
    """
    import pandas as pd

    has = frozenset({"reference"} if reference else ())
    applicable = [
        f"{name}:all"
        for name, plugin in plugins.usable("metric").items()
        if plugin.needs <= has
    ]
    names = list(metrics) or applicable
    chosen = metric_choices(names)  # raises for a mistyped name, before any image is read
    is_foreign = any(choice.plugin.is_foreign for choice in chosen)
    files = images_in(images)
    reference_of = (
        _references(images, files, reference) if reference else dict[str, Path | str]()
    )
    read = [
        *files.values(),
        *(path for path in reference_of.values() if isinstance(path, Path)),
    ]
    for folder in (images, reference):
        if folder is not None and folder.is_dir():
            say_passed_over(folder, folders_in(folder), read)
    label = images.resolve().name
    tables = []
    lossy = list[Path]()
    pictures = dict[str, Picture]()
    outlines = dict[str, tuple[Array, Array]]()  # of an image and of its reference
    for name, path in progress.track(files.items(), f"scoring {label}"):
        try:
            compared_with = reference_of.get(name)
            if isinstance(compared_with, str):
                raise InputError(compared_with)
            if compared_with and not is_known and is_jpeg(compared_with) and not is_jpeg(path):
                lossy.append(compared_with)
            rgb = locked(read_srgb(path)[0])
            view = View(name, _Pictures(rgb, path, compared_with))
            target = view.reference
            target = rgb if target is None else target
            if not is_known:
                pictures[str(compared_with or name)] = picture_of(target)
            fitting = _fitting(path, rgb.shape, target.shape, names)
            if compared_with:
                outlines[name] = outline(rgb), outline(target)
                say_if_black(path, rgb, partial(np.asarray, target), _HOLES)
                say_if_black(compared_with, target, partial(np.asarray, rgb))
            del target  # it may have 1 GB
            picture = Restoration(rgb, info={"method": label})
            work = partial(score, picture, view, fitting)
            tables.append(
                processes.call(work, "mend the metric, or leave it out")
                if is_foreign
                else work()
            )
        except (InputError, PluginError) as fault:
            failed = row_without_value(
                results.Row(method=label, view=name), "failed", str(fault)
            )
            tables.append(results.frame([failed]))
    if lossy:
        progress.say(
            f"{lossy[0]}: a JPEG file, which has lost detail, so scores are not exact; for exact ones give"
            " the dataset's own references"
        )
    _say_if_of_other_reference(images, outlines)
    rows = pd.concat(tables, ignore_index=True)
    sets = recognised_sets(pictures)
    rows = rows.assign(scene=next((found.of.name for found in sets if found.is_whole), ""))
    return FolderScores(
        rows[~rows["metric"].isin(["peak_mb"]) & ~rows.index.isin(restorations(rows).index)],
        sets,
    )


def _say_if_of_other_reference(
    images: Path, outlines: Mapping[str, tuple[Array, Array]]
) -> None:
    """Say how many images are more like another image's reference than like their own. outlines: of both, by name."""
    if len(outlines) < 2:
        return
    names = list(outlines)
    of_images, of_references = (
        np.array(list(kind)) for kind in zip(*outlines.values(), strict=True)
    )
    alike = of_images @ of_references.T
    nearest = alike.argmax(axis=1)
    wrong = np.flatnonzero(alike.max(axis=1) > alike.diagonal() + NEARER)
    if len(wrong):
        first = wrong[0]
        example = f"{names[first]} like that of {names[nearest[first]]}"
        progress.say(
            f"{images}: {len(wrong)} of {len(names)} images are more like another image's reference than like their"
            f" own, {example}; see whether names of files agree"
        )


def images_in(folder: Path) -> dict[str, Path]:
    """Return the images under a folder, or the one image, by their path below it. InputError if there is none."""
    if folder.is_file():
        return {folder.name: folder}
    check_folder(folder, "give a folder of images, or one image")
    names = image_names(folder, subfolders=True)
    if not names:
        raise no_image(folder)
    return {name: folder / name for name in names}


def _references(images: Path, names: Iterable[str], place: Path) -> dict[str, Path | str]:
    """Return the file that each image is compared with, or why there is none: one for all, or that of a folder.

    A file fits that has the image's path, or else its stem. It lies in a folder of the same name as the image, or one
    of both lies in no folder. Raises InputError if there is no such image or folder, or no file fits any image.
    """
    if not place.is_dir():
        remedy = "give the references as a folder or one image"
        if not place.exists():
            raise MissingFileError("no such folder", place, remedy)
        if (fault := fault_of(place)) or image_size(place) is None:
            raise InputError(fault or "is no image", place, remedy)
        return dict.fromkeys(names, place)
    folder, found = ImageFolder(place), dict[str, list[Path]]()
    for name in names:
        wanted = PurePosixPath(name).parent.parts
        files = [name]
        if not (place / name).is_file():
            folders = {file: PurePosixPath(file).parent.parts for file in folder.find(name)}
            files = [
                file
                for file, of in folders.items()
                if not of or of[len(of) - len(wanted) :] == wanted
            ]
        found[name] = [place / file for file in files]
    if not any(found.values()):  # as 1_ours.png and 1.png: without what all names share
        of_bare: dict[str, list[Path]] = defaultdict(list)
        for file, stem in bare_stems(images_in(place)).items():
            of_bare[stem].append(place / file)
        found = {name: of_bare[stem] for name, stem in bare_stems(found).items()}
    if not any(found.values()):
        example = PurePosixPath(next(iter(found))).stem
        fault_text = f"no image has the name of one in {images}, for example {example}"
        raise InputError(fault_text, place, "rename the references")
    compared_with = {}
    for name, paths in found.items():
        stem = PurePosixPath(name).stem
        lack = f"{place / name}: no such reference; give a folder with an image named {stem}"
        compared_with[name] = (
            only(paths, "give the folder of one of them as --reference") or lack
        )
    return compared_with
