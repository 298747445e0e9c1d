"""A people's study: its views and restored images, its page, and the key to each picture's method.

The page is one file that opens from disk, needs no network and names no method: it has pictures under random names. The
key stays in the results folder, as people/<study>.json.
"""

import base64
import io
import json
import random
import secrets
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
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
_CELLS = 96  # along the longer side of a view, in which rectangles without holes are sought
_FILLED = 0.9  # of a cell without a hole: the rest are specks
# of the views that a study shows, and of each one
_LEAST_OF_ALL = 0.25
_LEAST_OF_VIEW = 0.1
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


@dataclass(frozen=True, eq=False)
class Part:
    """What a study shows of a view with holes: the largest rectangle that all methods fill."""

    area: tuple[slice, slice]
    """Rows and columns."""

    mask: Mask
    """(H, W) of the view, the pixels that all methods fill. Specks of others in the rectangle are painted from around
    them, alike in all pictures."""

    share: float
    """Of the view's pixels that the rectangle has."""


def whole_parts(folder: Path, key: Key) -> tuple[Key, dict[ViewKey, Part], list[str]]:
    """Return a study without holes, the parts of its views that have some, and whom it leaves out.

    People judge colours, not holes. While the parts have less than a quarter of the views on average, the method that
    fills least is left out, until there are two. Views with less than a tenth are left out.
    Raises InputError if a mask is gone or damaged, if the masks of a view differ in size, or if no view is left.
    """
    rows = restorations(results.read(folder))
    rows = rows[
        (rows["dataset"] == key.dataset)
        & rows["method"].isin(key.methods)
        & (rows["coverage"] < 1)
    ]
    places = {(one.scene, one.view) for one in key.pictures.values()}
    masks: dict[ViewKey, dict[str, Mask | None]] = {}
    for row in row_objects(rows):
        where = (row.scene, row.view)
        place = layout.find(key.dataset, row.scene, row.view, folder)
        if where in places and place is not None:
            masks.setdefault(where, {})[row.method] = stored_mask(folder, place, row)
    left = [*key.methods]
    said = list[str]()
    while True:
        with_holes = {where: {m: of[m] for m in left if m in of} for where, of in masks.items()}
        parts = {where: _part(common_pixels(of).mask) for where, of in with_holes.items() if of}
        share = float(
            np.mean([parts[where].share if where in parts else 1.0 for where in places])
        )
        if share >= _LEAST_OF_ALL or len(left) == 2:
            break
        filled = {
            m: sum(1.0 if (mask := of.get(m)) is None else mask.mean() for of in masks.values())
            for m in left
        }
        least = min(left, key=filled.__getitem__)
        left.remove(least)
        said.append(
            f"{least}: it fills least, and all methods together fill a rectangle of {share:.0%};"
            " --pixels own shows each picture whole"
        )
    gone = sorted(where for where, part in parts.items() if part.share < _LEAST_OF_VIEW)
    if len(gone) == len(places):
        raise InputError(
            "all methods fill no rectangle of a tenth of it",
            gone[0][1],
            "leave one out, or use --pixels own",
        )
    said += [f"{view}: all methods fill no rectangle of a tenth of it" for _, view in gone]
    pictures = {
        n: one
        for n, one in key.pictures.items()
        if one.method in left and (one.scene, one.view) not in gone
    }
    kept = {
        where: part for where, part in parts.items() if where not in gone and part.share < 1
    }
    return replace(key, methods=tuple(left), pictures=pictures), kept, said


def _part(mask: Mask) -> Part:
    """The largest rectangle of cells that are filled but for specks."""
    side = -(-max(mask.shape) // _CELLS)
    rows, columns = (np.arange(0, length, side) for length in mask.shape)
    in_cells = np.add.reduceat(
        np.add.reduceat(np.stack([mask, np.ones_like(mask)], dtype=int), rows, 1), columns, 2
    )
    is_filled = in_cells[0] >= _FILLED * in_cells[1]
    best = 0
    area = (slice(0), slice(0))
    for top in range(len(is_filled)):
        run = is_filled[top]
        for bottom in range(top, len(is_filled)):
            run = run & is_filled[bottom]
            starts, ends = (
                np.flatnonzero(np.diff(run, prepend=False, append=False)).reshape(-1, 2).T
            )
            if not len(starts):
                break
            n = int((ends - starts).argmax())
            left, right = int(starts[n]), int(ends[n])
            if (size := (bottom + 1 - top) * (right - left)) > best:
                best = size
                area = (
                    slice(top * side, (bottom + 1) * side),
                    slice(left * side, right * side),
                )
    return Part(area, mask, mask[area].size / mask.size)


# -- the page ----------------------------------------------------------------------------------------------


def write_page(
    path: Path,
    folder: Path,
    key: Key,
    question: str,
    pairs: int,
    width: int,
    parts: Mapping[ViewKey, Part] = MappingProxyType({}),
) -> None:
    """Write the page. pairs: of a sitting; width: most pixels of a picture's width.

    parts: by scene and view, what is shown of those that are not shown whole.
    Raises InputError if a picture is gone or the pictures of a view differ in size, OutputError if the page cannot be
    written.
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
        pictures=_pictures(folder, key, width, parts),
    )
    write_atomically(path, page)


def _pictures(
    folder: Path, key: Key, width: int, parts: Mapping[ViewKey, Part]
) -> list[tuple[str, str]]:
    """The pictures by their names in the page, in the order of these names, as JPEG in base64."""
    import cv2
    from PIL import Image

    sizes: dict[ViewKey, tuple[int, ...]] = {}
    made = []
    for name, shown in progress.track(sorted(key.pictures.items()), "pictures"):
        place = layout.find(key.dataset, shown.scene, shown.view, folder)
        path = place.restored(folder, shown.method) if place else folder / "restored"
        if not path.is_file():
            raise MissingFileError(
                f"the restored image of {shown.view} is gone", path, "repeat the run's command"
            )
        image = read_bgr_8bit(path)[..., ::-1]
        if sizes.setdefault((shown.scene, shown.view), image.shape) != image.shape:
            raise InputError(
                f"{path}: is not of the size of the other methods' pictures; run this method again"
            )
        if part := parts.get((shown.scene, shown.view)):
            specks = (~part.mask[part.area]).astype(np.uint8)
            image = cv2.inpaint(
                np.ascontiguousarray(image[part.area]), specks, 3, cv2.INPAINT_TELEA
            )
        picture = Image.fromarray(np.ascontiguousarray(image))
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
