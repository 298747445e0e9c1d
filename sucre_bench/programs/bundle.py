"""Writes a results folder as one file that others can verify: a bundle, see `results.bundle_format`."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench import plugins
from sucre_bench.engine.score import needs_unrounded, scorers
from sucre_bench.errors import ANY_FAULT, InputError, PluginError
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.machine import processes, progress
from sucre_bench.machine.files import fault_of, is_file
from sucre_bench.machine.provenance import version_of
from sucre_bench.results import layout
from sucre_bench.results.bundle_format import hash_of, write_bundle
from sucre_bench.results.rows import COSTS, restorations
from sucre_bench.results.table import read_both
from sucre_bench.scene import Arrays, Restoration, View

# "restored": the restored images; "all": also the views and references, which may not be yours to publish.
Pictures = Literal["none", "restored", "all"]

_TEXTS = ("config.yaml", "environment.json")

_SIDE = 32  # pixels of the picture that metrics are tried on
_LIMIT_S = 60.0  # for a score of that picture
_HAS = frozenset({"depth", "reference", "restoration"})


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

    unverifiable: Mapping[str, int]
    """Number of scores that need the restoration as it was computed, by "metric:variant"; none where the bundle
    has no pictures."""


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
    found: dict[str, bytes | Path] = {
        name: folder / name for name in _TEXTS if is_file(folder / name)
    }
    for row in restorations(rows).itertuples():
        place = layout.find(row.dataset, row.scene, row.view, folder)
        picture = place.restored(folder, row.method) if place else folder / "restored"
        if place is None or (fault := fault_of(picture)):
            where = picture if place else f"{folder}: {row.dataset} / {row.method} / {row.view}"
            fault = fault if place and picture.exists() else "the restored image is gone"
            raise InputError(fault, where, "repeat the run's command, which makes it again")
        more = (picture.with_suffix(".json"), place.original(folder), place.reference(folder))
        found |= {
            file.relative_to(folder).as_posix(): file
            for file in (picture, *filter(is_file, more))
        }
    inside = {"none": (), "restored": ("restored/",), "all": ("",)}[pictures]
    files = {
        name: file
        for name, file in found.items()
        if name in _TEXTS or name.endswith(".json") or name.startswith(inside)
    }
    pictures_outside = progress.track(sorted(found.keys() - files.keys()), "hashing pictures")
    outside = {name: hash_of(found[name]) for name in pictures_outside}
    n_inside = len(files.keys() - set(_TEXTS))
    files |= {name: text.encode() for name, text in (texts or {}).items()}
    every = pd.concat([rows, common])
    made = write_bundle(path, every, files, outside, by, version_of("sucre-bench") or "")
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    counts = (
        scores.groupby(["metric", "variant"], sort=False, observed=True).size()
        if pictures != "none"
        else {}
    )
    lost = {
        f"{m}:{v}": int(n) for (m, v), n in counts.items() if _needs_unrounded(str(m), str(v))
    }
    options = [json.loads(text) for text in rows["options"].unique()]
    local_paths = sorted({text for text in _strings(options) if text.startswith(("/", "~"))})
    return Bundled(path, made, len(scores), n_inside, len(outside), tuple(local_paths), lost)


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _strings(inner)


def _needs_unrounded(metric: str, variant: str) -> bool:
    """Whether `needs_unrounded` says so of a small picture.

    False where that is not known: the metric is not registered here, or needs more than a view with depth and
    reference.
    """
    try:
        (scorer,) = scorers(metric_choices([f"{metric}:{variant}"]), limit_s=_LIMIT_S)
    except ANY_FAULT:
        return False
    if plugins.missing_needs(scorer.plugin, _HAS):
        return False
    rgb = np.linspace(0, 1, _SIDE * _SIDE * 3, dtype=np.float32).reshape(_SIDE, _SIDE, 3)
    view = View(
        "a.png", Arrays(rgb, depth=np.ones((_SIDE, _SIDE), np.float32), reference=rgb[::-1])
    )
    changes = partial(needs_unrounded, scorer, Restoration(rgb), view)
    try:
        return (
            processes.call(changes, "mend the metric")
            if scorer.plugin.is_foreign
            else changes()
        )
    except PluginError:
        return True
