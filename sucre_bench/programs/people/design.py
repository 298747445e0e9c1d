"""A people's study: its views and restored images, its page, and the key to each picture's method.

The page is one file that opens from disk, needs no network and names no method: it has pictures under random names. The
key stays in the results folder, as people/<study>.json.
"""

import base64
import io
import json
import random
import secrets
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from sucre_bench import results
from sucre_bench.arrays import Mask, evenly
from sucre_bench.errors import InputError, MissingFileError, did_you_mean
from sucre_bench.imaging.image_files import read_bgr_8bit
from sucre_bench.machine import progress
from sucre_bench.machine.files import read_json, reading, write_atomically
from sucre_bench.machine.pages import filled_in
from sucre_bench.results import layout
from sucre_bench.results.common_scores import common_pixels, filled_restorations
from sucre_bench.results.restorations import stored_mask
from sucre_bench.results.rows import restorations, row_objects

ViewKey = tuple[str, str]  # scene and name

QUESTION = "Which picture shows the scene better?"
_FORMAT = "sucre_bench people's study"
_VERSION = 1
_LEAST_COMMON = 0.1  # of a view's pixels
_HOLE = 128  # gray of pixels that are not shown
# of JPEG, without loss of colour resolution: about 0.3 MB a picture of 1200 pixels
_QUALITY = 95


@dataclass(frozen=True)
class Shown:
    """A picture of a study: whose it is, and what it was when the page was made."""

    scene: str
    view: str
    method: str

    of: tuple[str, ...]
    """The options_id, data_id and code of the restoration."""

    @classmethod
    def of_row(cls, row: Any) -> "Shown":
        """Return the picture of a restoration's row."""
        return cls(row.scene, row.view, row.method, (row.options_id, row.data_id, row.code))


@dataclass(frozen=True)
class Key:
    """Tells whose the pictures of a page are."""

    study: str
    dataset: str
    methods: tuple[str, ...]

    pictures: Mapping[str, Shown]
    """By the name that the page gives them."""


def design(folder: Path, methods: Sequence[str], dataset: str = "", views: int = 12) -> Key:
    """Choose what a study shows: at most so many views, evenly over those that all methods restored.

    A method that fills less than 1 % of a view counts as not having restored it.

    Raises InputError if a method or dataset is not in the results, or the methods share no view.
    """
    rows = filled_restorations(results.read(folder))
    if len(set(methods)) < 2:
        raise InputError(
            "--methods: fewer than two labels; give at least two, with commas between them"
        )
    for name in methods:
        if name not in set(rows["method"]):
            raise InputError(
                f"--methods: no restored images of '{name}'; {did_you_mean(name, set(rows['method']))}"
            )
    rows = rows[rows["method"].isin(methods)]
    datasets = list(rows["dataset"].unique())
    if not dataset and len(datasets) > 1:
        raise InputError(
            f"{folder}: several datasets; choose one with --dataset, of {', '.join(datasets)}"
        )
    dataset = dataset or datasets[0]
    if dataset not in datasets:
        raise InputError(
            f"--dataset: no '{dataset}' in {folder}; {did_you_mean(dataset, datasets)}"
        )
    rows = rows[rows["dataset"] == dataset]
    shared = rows.groupby(["scene", "view"])["method"].nunique() == len(methods)
    places = list(shared.index[shared])
    if not places:
        raise InputError(
            f"{folder}: no view was restored by all of {', '.join(methods)}; run them on the same views"
        )
    chosen = {places[n] for n in evenly(len(places), views)}
    wanted = [row for row in rows.itertuples() if (row.scene, row.view) in chosen]
    pictures = {secrets.token_hex(5): Shown.of_row(row) for row in wanted}
    return Key(secrets.token_hex(4), dataset, tuple(methods), pictures)


def common_masks(folder: Path, key: Key) -> dict[ViewKey, Mask]:
    """Return the pixels (H, W) that all methods fill, for each view of a study in which some fill not all.

    Raises InputError if a mask is gone or damaged, if the masks of a view differ in size, or if the methods have less
    than a tenth of a view in common.
    """
    rows = restorations(results.read(folder))
    rows = rows[(rows["dataset"] == key.dataset) & (rows["coverage"] < 1)]
    shown = set(key.pictures.values())
    masks: dict[ViewKey, dict[str, Mask | None]] = defaultdict(dict)
    for row in row_objects(rows):
        place = layout.find(key.dataset, row.scene, row.view, folder)
        if place is not None and Shown.of_row(row) in shown:
            masks[row.scene, row.view][row.method] = stored_mask(folder, place, row)
    common = {}
    for where, of_methods in masks.items():
        mask = common_pixels(of_methods).mask
        if mask.mean() < _LEAST_COMMON:
            fault = f"all methods together fill only {mask.mean():.0%} of it"
            raise InputError(fault, where[1], "leave a method out, or use --pixels own")
        common[where] = mask
    return common


# -- the page ----------------------------------------------------------------------------------------------


def write_page(
    path: Path,
    folder: Path,
    key: Key,
    question: str,
    pairs: int,
    width: int,
    masks: Mapping[ViewKey, Mask] = MappingProxyType({}),
) -> None:
    """Write the page. pairs: of a sitting; width: most pixels of a picture's width.

    masks: by scene and view, the pixels to show; the others are gray.
    Raises InputError if a picture is gone, OutputError if the page cannot be written.
    """
    from markupsafe import Markup

    rng = random.SystemRandom()
    arms = rng.sample(key.methods, len(key.methods))
    places = list({(one.scene, one.view) for one in key.pictures.values()})
    rng.shuffle(places)
    by_place = {(one.scene, one.view, one.method): name for name, one in key.pictures.items()}
    views = [[by_place[*place, arm] for arm in arms] for place in places]
    between = list(combinations(range(len(arms)), 2))
    # Every observer is shown the views of a pair of methods in one order, so that several judge the same pictures.
    orders = {f"{i},{j}": rng.sample(range(len(places)), len(places)) for i, j in between}
    sitting = {
        "study": key.study,
        "pairs": min(pairs, len(views) * len(between)),
        "views": views,
        "orders": orders,
    }
    page = filled_in(
        __package__,
        "page.html.j2",
        question=question,
        content=Markup(json.dumps(sitting)),
        pictures=_pictures(folder, key, width, masks),
    )
    write_atomically(path, page)


def _pictures(
    folder: Path, key: Key, width: int, masks: Mapping[ViewKey, Mask]
) -> list[tuple[str, str]]:
    """The pictures by their names in the page, in the order of these names, as JPEG in base64."""
    from PIL import Image

    made = []
    for name, shown in progress.track(sorted(key.pictures.items()), "pictures"):
        place = layout.find(key.dataset, shown.scene, shown.view, folder)
        path = place.restored(folder, shown.method) if place else folder / "restored"
        if not path.is_file():
            raise MissingFileError(
                f"the restored image of {shown.view} is gone", path, "repeat the run's command"
            )
        image = np.ascontiguousarray(read_bgr_8bit(path)[..., ::-1])
        mask = masks.get((shown.scene, shown.view))
        if mask is not None:
            if mask.shape != image.shape[:2]:
                fault = "is not of the size of the other methods' pictures"
                raise InputError(fault, path, f"run {shown.method} again with overwrite=always")
            image[~mask] = _HOLE
        picture = Image.fromarray(image)
        jpeg = io.BytesIO()
        picture.thumbnail((width, 10 * width), Image.Resampling.LANCZOS)
        picture.save(jpeg, "JPEG", quality=_QUALITY, subsampling=0)
        made.append((name, base64.b64encode(jpeg.getvalue()).decode()))
    return made


# -- the key as a file -------------------------------------------------------------------------------------


def write_key(folder: Path, key: Key) -> Path:
    """Write a study's key into a results folder, and return its path."""
    path = folder / "people" / f"{key.study}.json"
    told = {"format": _FORMAT, "version": _VERSION, **asdict(key)}
    write_atomically(path, (json.dumps(told, indent=1) + "\n").encode())
    return path


def keys(folder: Path) -> dict[str, Key]:
    """Return the keys of all studies of a results folder, by study. Raises InputError for a damaged one."""
    found = {}
    for path in sorted((folder / "people").glob("*.json")):
        with reading(path, "restore a copy of it"):
            told = read_json(path, "restore a copy of it", of_data=True)
            if (told.pop("format"), told.pop("version")) != (_FORMAT, _VERSION):
                raise ValueError("another format")
            pictures = {
                name: Shown(**{**one, "of": tuple(one["of"])})
                for name, one in told.pop("pictures").items()
            }
            methods = tuple(told.pop("methods"))
            found[told["study"]] = Key(**told, methods=methods, pictures=pictures)
    return found
