"""The paths in a results folder.

restored/<dataset>/<method label>/[<scene>/]<view stem>.png   the restored image (and .npz with save=full)
restored/<dataset>/<method label>/<view without suffix>.json  what the method said of it, see `machine.records`
views/<dataset>/[<scene>/]<view stem>.jpg                     the view, to look at
references/<dataset>/[<scene>/]<view stem>.jpg                the reference, to look at
logs/failures.log                                            tracebacks

The scene is part of the path if the dataset has several. Replicates but the first lie in a folder replicate=N. A view's
name includes its suffix if another view differs only in that, and ends on a hash if names differ only by capitals.
"""

import functools
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath

from sucre_bench.errors import InputError
from sucre_bench.machine.file_names import folded, portable_name
from sucre_bench.results.rows import unreplicated
from sucre_bench.scene import Scene


def file_name(label: str) -> str:
    """Return a label as a file or folder name, see `portable_name`: special characters become '_'."""
    return portable_name(re.sub(r"[^\w.,=+@-]+", "_", label).strip("_."))


def as_one_file(label: str) -> str:
    """Return what is equal for labels whose folders are one on some system."""
    return folded(file_name(label))


def log_path(out: Path) -> Path:
    """The log of a run's tracebacks."""
    return out / "logs" / "failures.log"


def pairs_path(out: Path) -> Path:
    """The folder of observations that the jobs of a sweep share while it runs."""
    return out / ".pairs"


def decoded_path(out: Path) -> Path:
    """The folder of decoded images and depth maps that the processes of a run share."""
    return out / ".decoded"


@dataclass(frozen=True)
class Place:
    """A view's paths below restored/, views/ and references/, without suffix."""

    dataset: str
    stem: PurePosixPath

    def restored(self, out: Path, method: str) -> Path:
        """The restored image by a method."""
        return restored_path(out, self.dataset, method) / f"{self.stem}.png"

    def original(self, out: Path) -> Path:
        """The view, to look at."""
        return out / "views" / self.dataset / f"{self.stem}.jpg"

    def reference(self, out: Path) -> Path:
        """The reference, to look at."""
        return out / "references" / self.dataset / f"{self.stem}.jpg"


@functools.lru_cache(maxsize=1024)
def restored_path(out: Path, dataset: str, method: str) -> Path:
    """The folder of a method's restored images, which the thousands of views of a dive share. dataset: its folder."""
    return out / "restored" / dataset / file_name(method)


def places(
    dataset: str, scenes: Sequence[Scene], replicate: int = 0
) -> dict[tuple[str, str], Place]:
    """Return each view's place, by the names of scene and view."""
    several = slice(_FORMS, None) if len(scenes) > 1 else slice(_FORMS)
    named = ((scene.name, view.name) for scene in scenes for view in scene.views)
    stems = {names: stems_of(*names)[several] for names in named}
    claims = Counter(
        chain.from_iterable({folded(stem) for stem in forms} for forms in stems.values())
    )
    found = {}
    for names, (unique, *forms) in stems.items():
        stem = next((stem for stem in reversed(forms) if claims[folded(stem)] == 1), unique)
        found[names] = Place(file_name(dataset), _first(replicate) / stem)
    return found


def _first(replicate: int) -> PurePosixPath:
    """The folder of a replicate."""
    return PurePosixPath(f"replicate={replicate}" if replicate else "")


def find(dataset: str, scene: str, view: str, out: Path) -> Place | None:
    """Return the place of a view, or of its restorations, from a row's names; None if no file exists."""
    candidates = possible_places(dataset, scene, view)
    folder = out / "restored" / file_name(dataset)
    methods = [*folder.iterdir()] if folder.is_dir() else []
    originals = ((place, place.original(out)) for place in candidates)
    restored = ((place, each / f"{place.stem}.png") for place in candidates for each in methods)
    return next((place for place, file in chain(originals, restored) if file.is_file()), None)


def possible_places(dataset: str, scene: str, view: str) -> list[Place]:
    """Return where a view's files may lie, from a row's names: see `stems_of`."""
    scene, replicate = unreplicated(scene)
    stems = stems_of(scene, view)
    return [Place(file_name(dataset), _first(replicate) / stem) for stem in stems]


_FORMS = 3  # of a view's name


def stems_of(scene: str, view: str) -> tuple[PurePosixPath, ...]:
    """Return the possible paths, without suffix, of a view's files in the folder of a dataset or a method.

    Three forms of the view's name: with a hash, with the image's suffix, and without either, which is taken if no
    other view has it, see `folded`. Then the same below the scene, which is part of the path if a dataset has several.
    Raises InputError for a name that leads out of the folder.
    """
    name = PurePosixPath(view)
    if ".." in name.parts or name.is_absolute():
        raise InputError(
            f"{view}: a view's name leads out of the output folder; rename the image"
        )
    folder = PurePosixPath(*map(portable_name, name.parts[:-1]))
    forms = (
        portable_name(name.stem, f"{scene}/{view}"),
        portable_name(name.name),
        portable_name(name.stem),
    )
    return tuple(
        within / folder / form
        for within in (PurePosixPath(), file_name(scene))
        for form in forms
    )
