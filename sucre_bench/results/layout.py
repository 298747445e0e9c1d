"""The paths in a results folder.

restored/<dataset>/<method label>/[<scene>/]<view stem>.png   the restored image (and .npz with save=full)
restored/<dataset>/<method label>/records.jsonl               what methods told of them, see `machine.cache`
views/<dataset>/[<scene>/]<view stem>.jpg                     the view, to look at
references/<dataset>/[<scene>/]<view stem>.jpg                the reference, to look at
logs/failures.log                                            tracebacks

The scene is part of the path if the dataset has several. Replicates but the first lie in a folder replicate=N. A view's
name includes its suffix if another view differs only in that.
"""

import functools
import hashlib
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path, PurePosixPath

from sucre_bench.errors import InputError
from sucre_bench.results.rows import unreplicated
from sucre_bench.scene import Scene


def file_name(text: str) -> str:
    """Return a label as a file or folder name: special characters become '_'.

    A name too long for a file system is cut and ends on a hash of the whole label.
    """
    name = re.sub(r"[^\w.,=+@-]+", "_", text).strip("_.") or "_"
    return (
        name
        if len(name.encode()) <= 120
        else f"{name[:30]}-{hashlib.blake2b(text.encode(), digest_size=6).hexdigest()}"
    )


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
        return _inside(restored_path(out, self.dataset, method), f"{self.stem}.png")

    def original(self, out: Path) -> Path:
        """The view, to look at."""
        return _inside(out / "views" / self.dataset, f"{self.stem}.jpg")

    def reference(self, out: Path) -> Path:
        """The reference, to look at."""
        return _inside(out / "references" / self.dataset, f"{self.stem}.jpg")


@functools.lru_cache(maxsize=1024)
def restored_path(out: Path, dataset: str, method: str) -> Path:
    """The folder of a method's restored images, which the thousands of views of a dive share. dataset: its folder."""
    return out / "restored" / dataset / file_name(method)


def _inside(folder: Path, name: str) -> Path:
    if ".." in name.split("/") or name.startswith("/"):
        raise InputError(f"{name}: a view's name leads out of the output folder; rename the image")
    return folder / name


def places(dataset: str, scenes: Sequence[Scene], replicate: int = 0) -> dict[tuple[str, str], Place]:
    """Return each view's place, by the names of scene and view."""
    found = {}
    for scene in scenes:
        within = PurePosixPath(file_name(scene.name)) if len(scenes) > 1 else PurePosixPath()
        within = PurePosixPath(f"replicate={replicate}") / within if replicate else within
        stems = [PurePosixPath(view.name).with_suffix("") for view in scene.views]
        times, folder = Counter(stems), file_name(dataset)
        for view, stem in zip(scene.views, stems, strict=True):
            name_alone = stem if times[stem] == 1 else PurePosixPath(view.name)
            found[scene.name, view.name] = Place(folder, within / name_alone)
    return found


def find(dataset: str, scene: str, view: str, out: Path) -> Place | None:
    """Return the place of a view, or of its restorations, from a row's names; None if no file exists."""
    candidates, folder = possible_places(dataset, scene, view), out / "restored" / file_name(dataset)
    originals = ((place, place.original(out)) for place in candidates)
    restored = (
        (place, method / f"{place.stem}.png")
        for place in candidates
        for method in (folder.iterdir() if folder.is_dir() else ())
    )
    return next((place for place, file in chain(originals, restored) if file.is_file()), None)


def possible_places(dataset: str, scene: str, view: str) -> list[Place]:
    """Return where a view's files may lie, from a row's names: see `stems_of`."""
    scene, replicate = unreplicated(scene)
    first = PurePosixPath(f"replicate={replicate}") if replicate else PurePosixPath()
    return [Place(file_name(dataset), first / stem) for stem in stems_of(scene, view)]


def stems_of(scene: str, view: str) -> tuple[PurePosixPath, ...]:
    """Return the possible paths, without suffix, of a view's files in the folder of a dataset or a method.

    The scene is part of the path if a dataset has several; the image's suffix stays if two views differ only in it.
    """
    name, within = PurePosixPath(view), PurePosixPath(file_name(scene))
    return (name, name.with_suffix(""), within / name, within / name.with_suffix(""))
