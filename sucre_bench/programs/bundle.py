"""Writes a results folder as one file that others can verify: a bundle, see `results.bundle_format`."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from sucre_bench.errors import InputError
from sucre_bench.machine import progress
from sucre_bench.machine.files import is_file
from sucre_bench.machine.provenance import version_of
from sucre_bench.results import layout
from sucre_bench.results.bundle_format import hash_of, write_bundle
from sucre_bench.results.rows import COSTS, restorations
from sucre_bench.results.table import read_both

# "restored": the restored images; "all": also the views and references, which may not be yours to publish.
Pictures = Literal["none", "restored", "all"]

_TEXTS = ("config.yaml", "environment.json")


@dataclass(frozen=True)
class Bundled:
    """A bundle that was written."""

    path: Path

    id: str
    """See `Bundle`."""

    n_scores: int
    """Number of rows with a value, without seconds and memory."""

    n_inside: int
    """Number of pictures and their records in the bundle."""

    n_outside: int
    """Number of pictures of which the bundle has only the hash."""

    local_paths: tuple[str, ...]
    """Folders of this machine that options of methods or datasets name."""


def bundle_results(
    folder: Path,
    path: Path,
    pictures: Pictures = "none",
    by: str = "",
    texts: Mapping[str, str] | None = None,
) -> Bundled:
    """Write a bundle of a results folder. by: who publishes it; texts: more text files, by their names.

    Raises InputError if the folder holds no results, or a picture is gone; OutputError if the bundle cannot be written.
    """
    import pandas as pd

    rows, common = read_both(folder)
    files: dict[str, bytes | Path] = {
        name: folder / name for name in _TEXTS if is_file(folder / name)
    }
    files |= {name: text.encode() for name, text in (texts or {}).items()}
    n_texts = len(files)
    pictures_outside: dict[str, Path] = {}
    for row in restorations(rows).itertuples():
        place = layout.find(row.dataset, row.scene, row.view, folder)
        picture = place.restored(folder, row.method) if place else folder / "restored"
        if place is None or not is_file(picture):
            fault = f"the restored image of {row.dataset} / {row.method} / {row.view} is gone"
            raise InputError(fault, picture, "repeat the run's command, which makes it again")
        record = picture.with_suffix(".json")
        if is_file(record):
            files[record.relative_to(folder).as_posix()] = record
        originals = (place.original(folder), place.reference(folder))
        of_kinds = {"restored": [picture], "all": filter(is_file, originals)}
        for kind, paths in of_kinds.items():
            is_inside = pictures == "all" or kind == pictures
            found = files if is_inside else pictures_outside
            found |= {path.relative_to(folder).as_posix(): path for path in paths}
    names = progress.track(sorted(pictures_outside), "hashing pictures")
    outside = {name: hash_of(pictures_outside[name]) for name in names}
    version = version_of("sucre-bench") or ""
    made = write_bundle(path, pd.concat([rows, common]), files, outside, by, version)
    n_scores = int(((rows["status"] == "ok") & ~rows["metric"].isin(COSTS)).sum())
    options = [json.loads(text) for text in rows["options"].unique()]
    local_paths = sorted({text for text in _strings(options) if text.startswith(("/", "~"))})
    return Bundled(path, made, n_scores, len(files) - n_texts, len(outside), tuple(local_paths))


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _strings(inner)
