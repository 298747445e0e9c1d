"""Score any folder of images, with no dataset and no method: `sucre-bench score`."""

import functools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from sucre_bench import plugins, results
from sucre_bench.arrays import Array, DataFrame
from sucre_bench.engine.python_api import score
from sucre_bench.engine.score import row_without_value
from sucre_bench.errors import InputError, MissingFileError, PluginError
from sucre_bench.imaging.image_files import SUFFIXES, image_size, is_jpeg, read_rgb
from sucre_bench.jobs.metric_words import metric_choices
from sucre_bench.loading.find_folders import ImageFolder
from sucre_bench.machine import forked, progress
from sucre_bench.machine.files import check_folder, fault_of
from sucre_bench.results.rows import restorations
from sucre_bench.scene import Plane, Restoration, View


@dataclass(frozen=True)
class _Files:
    """An image file, and the file it is compared with."""

    image: Path
    compared_with: Path | None

    def load(self, plane: Plane) -> Array | None:
        if plane == "rgb":
            return read_rgb(self.image)
        return read_rgb(self.compared_with) if plane == "reference" and self.compared_with else None


def score_folder(images: Path, reference: Path | None, metrics: Sequence[str]) -> DataFrame:
    """Score every image under a folder (or one file): the long table's columns, the folder's name as the method.

    reference: a folder with the same names, or one file; metrics: names as `sucre_bench.score` takes them, none for
    every metric that applies, in all its variants. An image that cannot be read, or has no reference of its name, is a
    failed row. A line says when PNG or TIFF images are compared with JPEG references. Raises InputError when there is
    no image, no folder of references, or no reference of any image.
    """
    import pandas as pd

    names = list(metrics) or _applicable(reference is not None)
    chosen = metric_choices(names)  # raises for a mistyped name, before any image is read
    is_foreign = any(choice.plugin.is_foreign for choice in chosen)
    files = images_in(images)
    references = None if reference is None else _References(reference)
    if references is not None and not any(map(references.has, files)):
        stem = PurePosixPath(next(iter(files))).stem
        raise InputError(
            f"{reference}: no image has the name of one in {images}, for example {stem}; rename the references"
        )
    label, tables, pairs = images.resolve().name, [], list[_Files]()
    for name, path in progress.track(files.items(), f"scoring {label}"):
        try:
            pairs.append(_Files(path, None if references is None else references.of(name)))
            view = View(name, pairs[-1])
            if view.reference is not None and view.reference.shape != view.rgb.shape:
                sizes = [f"{w}x{h}" for h, w, _ in (view.rgb.shape, view.reference.shape)]
                raise InputError(f"{path}: {sizes[0]}, but its reference is {sizes[1]}; give one of the same size")
            picture = Restoration(view.rgb, info={"method": label})
            work = functools.partial(score, picture, view, names)
            tables.append(forked.call(work, "mend the metric, or leave it out") if is_foreign else work())
        except (InputError, PluginError) as fault:
            failed = row_without_value(results.Row(method=label, view=name), "failed", str(fault))
            tables.append(results.frame([failed]))
    _say_lossy(pairs)
    rows = pd.concat(tables, ignore_index=True)
    return rows[~rows["metric"].isin(["peak_mb"]) & ~rows.index.isin(restorations(rows).index)]


def images_in(folder: Path) -> dict[str, Path]:
    """Return the images under a folder, or the one image, by their path below it. InputError if there is none."""
    if folder.is_file():
        return {folder.name: folder}
    check_folder(folder, "give a folder of images, or one image")
    found = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    if not found:
        raise InputError(f"{folder}: holds no image ({', '.join(sorted(SUFFIXES))}); give a folder of images")
    return {str(p.relative_to(folder)): p for p in found}


class _References:
    """The images that others are compared with: one file, or a folder with the same names, with any image's suffix."""

    def __init__(self, place: Path) -> None:
        """Raises InputError where there is no such image or folder."""
        if not place.is_dir():
            remedy = "give the references as a folder or one image"
            if not place.exists():
                raise MissingFileError("no such folder", place, remedy)
            if (fault := fault_of(place)) or image_size(place) is None:
                raise InputError(fault or "is no image", place, remedy)
        self._place, self._folder = place, None if place.is_file() else ImageFolder(place)

    def of(self, name: str) -> Path:
        """Return the reference of an image, given by its path below its folder. InputError if none or several fit.

        A file fits that has the image's name, or else its stem. It lies in a folder of the same name as the image, or
        one of both lies in no folder.
        """
        if self._folder is None:
            return self._place
        if (self._place / name).is_file():
            return self._place / name
        found = self._fitting(name)
        if not found:
            stem = PurePosixPath(name).stem
            raise MissingFileError("no such reference", self._place / name, f"give a folder with an image named {stem}")
        if len(found) > 1:
            raise InputError(
                f"{self._place}: {name} may be {' or '.join(found[:2])}; give the folder of one of them as --reference"
            )
        return self._place / found[0]

    def has(self, name: str) -> bool:
        """Whether some file fits an image."""
        return self._folder is None or (self._place / name).is_file() or bool(self._fitting(name))

    def _fitting(self, name: str) -> list[str]:
        assert self._folder is not None
        return [file for file in self._folder.find(name) if _is_in_folder_of(PurePosixPath(file), PurePosixPath(name))]


def _is_in_folder_of(file: PurePosixPath, image: PurePosixPath) -> bool:
    folders, wanted = file.parent.parts, image.parent.parts
    return not folders or folders[len(folders) - len(wanted) :] == wanted


def _say_lossy(files: Iterable[_Files]) -> None:
    """Say in one line that images without loss are compared with JPEG files."""
    references = (one.compared_with for one in files if one.compared_with and not is_jpeg(one.image))
    if lossy := next(filter(is_jpeg, references), None):
        progress.say(
            f"{lossy}: a JPEG file, which has lost detail, so scores are not exact; "
            "for exact ones give the dataset's own references"
        )


def _applicable(with_reference: bool) -> list[str]:
    """Every variant of every metric that needs no more than there is."""
    has = frozenset({"reference"} if with_reference else ())
    return [f"{name}:all" for name, plugin in plugins.usable("metric").items() if plugin.needs <= has]
