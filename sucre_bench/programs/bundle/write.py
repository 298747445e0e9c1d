"""Collects the files of a bundle from a results folder, and writes the bundle."""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.score import Scored, Scorer, scorers, variant_rows
from sucre_bench.errors import ANY_FAULT, InputError, PluginError
from sucre_bench.jobs.metric_words import metric_choices
from sucre_bench.machine import forked, progress
from sucre_bench.machine.files import fault_of, is_file
from sucre_bench.machine.provenance import version_of
from sucre_bench.results import layout
from sucre_bench.results.bundle_format import COMMON, hash_of, write_bundle
from sucre_bench.results.common_scores import read_common
from sucre_bench.results.rows import COSTS, Row, csv_text, restorations
from sucre_bench.scene import Arrays, Restoration, View

# "restored": the restored images; "all": also the views and references, which may not be yours to publish.
Pictures = Literal["none", "restored", "all"]

_TEXTS = ("config.yaml", "environment.json")

_SIDE = 32  # pixels of the picture that metrics are tried on
_LIMIT_S = 60.0  # for a score of that picture
_HAS = frozenset({"depth", "reference", "restoration"})


@dataclass(frozen=True)
class Bundled:
    """A bundle that was written.

    id: see `Bundle`; n_scores: number of rows with a value, without seconds and memory; n_inside, n_outside: number of
    pictures in the bundle, and of pictures of which it has only the hash; local_paths: folders of this machine that
    options of methods or datasets name; unverifiable: number of scores that need the restoration before it was rounded
    to 8 bits, by "metric:variant"; none where the bundle has no pictures.
    """

    path: Path
    id: str
    n_scores: int
    n_inside: int
    n_outside: int
    local_paths: tuple[str, ...]
    unverifiable: Mapping[str, int]


def bundle_results(
    folder: Path, path: Path, pictures: Pictures = "none", by: str = "", texts: Mapping[str, str] | None = None
) -> Bundled:
    """Write a bundle of a results folder. by: who publishes it; texts: more text files, by their names.

    Raises InputError if the folder holds no results, a picture is gone, or a link leads out of the folder; OutputError
    if the bundle cannot be written.
    """
    rows = results.read(folder)
    files: dict[str, bytes | Path] = {n: _own(folder / n, folder) for n in _TEXTS if is_file(folder / n)}
    common = read_common(folder)
    files |= {COMMON: csv_text(common).encode()} if len(common) else {}
    files |= {name: text.encode() for name, text in (texts or {}).items()}
    found = {file.relative_to(folder).as_posix(): _own(file, folder) for file in _files(folder, rows)}
    is_inside = {"none": (), "restored": ("restored/",), "all": ("restored/", "views/", "references/")}[pictures]
    files |= {n: file for n, file in found.items() if n.endswith(".json") or n.startswith(is_inside)}
    left = {name: file for name, file in found.items() if name not in files}
    outside = {name: hash_of(file) for name, file in progress.track(left.items(), "hashing pictures")}
    made = write_bundle(path, rows, files, outside, by, version_of("sucre-bench") or "")
    n_scores = int(((rows["status"] == "ok") & ~rows["metric"].isin(COSTS)).sum())
    lost = unverifiable(rows) if pictures != "none" else {}
    return Bundled(path, made, n_scores, len(found.keys() & files.keys()), len(outside), _local_paths(rows), lost)


def _files(folder: Path, rows: DataFrame) -> Iterator[Path]:
    """The pictures and records of every restoration that ended well. InputError for a picture that is gone."""
    for row in restorations(rows).itertuples():
        place = layout.find(row.dataset, row.scene, row.view, folder)
        picture = place.restored(folder, row.method) if place else None
        if place is None or picture is None or (fault := fault_of(picture)):
            where = picture or f"{folder}: {row.dataset} / {row.method} / {row.view}"
            fault = "the restored image is gone" if picture is None or not picture.exists() else fault
            raise InputError(f"{where}: {fault}; repeat the run's command, which makes it again")
        more = (picture.with_suffix(".json"), place.original(folder), place.reference(folder))
        yield from (picture, *(file for file in more if is_file(file)))


def _own(file: Path, folder: Path) -> Path:
    """A file of a results folder. Raises InputError for a link to a file elsewhere, which may be anyone's secret."""
    if not file.resolve().is_relative_to(folder.resolve()):
        raise InputError("leads out of the results folder", file, "put the file itself there, or remove the link")
    return file


def _local_paths(rows: DataFrame) -> tuple[str, ...]:
    """Absolute paths among the options of methods and datasets."""
    texts = {text for options in rows["options"].unique() for text in _strings(json.loads(options))}
    return tuple(sorted(text for text in texts if text.startswith(("/", "~"))))


def _strings(value: Any) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, (dict, list)):
        for inner in value.values() if isinstance(value, dict) else value:
            yield from _strings(inner)


def unverifiable(rows: DataFrame) -> Mapping[str, int]:
    """Return how many scores of each metric need more than the restored image, by "metric:variant"."""
    scores = rows[(rows["status"] == "ok") & ~rows["metric"].isin(COSTS)]
    counts = scores.groupby(["metric", "variant"], sort=False, observed=True).size()
    return {f"{m}:{v}": int(n) for (m, v), n in counts.items() if _rests_on_unrounded(str(m), str(v))}


def _rests_on_unrounded(metric: str, variant: str) -> bool:
    """Whether a score changes with the restoration while the restored image stays, or the metric fails.

    False where that is not known: the metric is not registered here, or needs more than a view with depth and
    reference.
    """
    try:
        (scorer,) = scorers(metric_choices([f"{metric}:{variant}"]))
    except ANY_FAULT:
        return False
    if plugins.missing_needs(scorer.plugin, _HAS):
        return False
    if not scorer.plugin.is_foreign:
        return _changes(scorer, variant)
    try:
        return forked.call(lambda: _changes(scorer, variant), "mend the metric")
    except PluginError:
        return True


def _changes(scorer: Scorer, variant: str) -> bool:
    """Whether a metric's scores of two restorations with the same restored image differ, or it fails."""
    one = _tried(scorer, variant, 0.0)
    other = one if _has_failed(one) else _tried(scorer, variant, 0.5)
    if _has_failed(other):
        return True
    return not np.array_equal([row.value for row in one], [row.value for row in other], equal_nan=True)


def _has_failed(rows: list[Row]) -> bool:
    return any(row.status == "failed" for row in rows)


def _tried(scorer: Scorer, variant: str, darker: float) -> list[Row]:
    """The rows of one restored image, with a restoration that is darker by so much than it."""
    rgb = np.linspace(0, 1, _SIDE * _SIDE * 3, dtype=np.float32).reshape(_SIDE, _SIDE, 3)
    view = View("a.png", Arrays(rgb, depth=np.ones((_SIDE, _SIDE), np.float32), reference=rgb[::-1]))
    scored = Scored(Restoration(rgb - np.float32(darker)), rgb, view)
    base = Row("trial", "", view.name, "trial", metric=scorer.plugin.name, variant=variant)
    return variant_rows(scorer.metric, scored, base, None, _LIMIT_S)
