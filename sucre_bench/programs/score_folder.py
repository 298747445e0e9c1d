"""Score any folder of images, with no dataset and no method: `sucre-bench score`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arrays import Array
from sucre_bench.compare.text import ARROW, number
from sucre_bench.engine.one_view import score
from sucre_bench.engine.score import row_without_value
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import SUFFIXES, read_rgb
from sucre_bench.jobs.job import metric_choices
from sucre_bench.machine import progress
from sucre_bench.scene import Plane, Restoration, View

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table

__all__ = ["images_in", "score_folder", "summary"]


@dataclass(frozen=True)
class _Files:
    """An image file, and the file it is compared with."""

    image: Path
    compared_with: Path | None

    def load(self, plane: Plane) -> Array | None:
        if plane == "rgb":
            return read_rgb(self.image)
        return read_rgb(self.compared_with) if plane == "reference" and self.compared_with else None


def score_folder(images: Path, reference: Path | None, metrics: Sequence[str]) -> pd.DataFrame:
    """Score every image under a folder (or one file): the long table's columns, the folder's name as the method.

    reference: a folder with the same names, or one file; metrics: names as `sucre_bench.score` takes them, none for
    every metric that applies, in all its variants. An image that cannot be read, or has no reference of its name, is a
    failed row. Raises InputError when there is no image, or no folder of references.
    """
    import pandas as pd

    names = list(metrics) or _applicable(reference is not None)
    metric_choices(names)  # a typo is told before anything is read
    files = images_in(images)
    if reference is not None and not reference.exists():
        raise InputError(f"{reference}: no such folder; give the references as a folder or one image")
    label, tables = images.resolve().name, []
    for name, path in progress.track(files.items(), f"scoring {label}"):
        try:
            view = View(name, _Files(path, _partner(name, reference)))
            if view.reference is not None and view.reference.shape != view.rgb.shape:
                sizes = [f"{w}x{h}" for h, w, _ in (view.rgb.shape, view.reference.shape)]
                raise InputError(f"{path}: {sizes[0]}, but its reference is {sizes[1]}; give one of the same size")
            tables.append(score(Restoration(view.rgb, info={"method": label}), view, names))
        except InputError as fault:
            failed = row_without_value(results.Row(method=label, view=name), "failed", str(fault))
            tables.append(results.frame([failed]))
    rows = pd.concat(tables, ignore_index=True)
    return rows[~rows["metric"].isin(["peak_mb"]) & ~((rows["metric"] == "seconds") & (rows["status"] == "ok"))]


def images_in(folder: Path) -> dict[str, Path]:
    """Return the images under a folder, or the one image, by their path below it. InputError if there is none."""
    if folder.is_file():
        return {folder.name: folder}
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder; give a folder of images, or one image")
    found = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES and p.is_file())
    if not found:
        raise InputError(f"{folder}: holds no image ({', '.join(sorted(SUFFIXES))}); give a folder of images")
    return {str(p.relative_to(folder)): p for p in found}


def _partner(name: str, reference: Path | None) -> Path | None:
    """The reference of an image: the same name, any suffix, in the same folder or in that of the references itself."""
    if reference is None:
        return None
    if reference.is_file():
        return reference
    for wanted in (reference / name, reference / Path(name).name):
        near = [p for p in sorted(wanted.parent.glob("*")) if p.stem == wanted.stem and p.suffix.lower() in SUFFIXES]
        if wanted.is_file() or near:
            return wanted if wanted.is_file() else near[0]
    raise InputError(f"{reference / name}: no such reference; it needs the same names as the images")


def _applicable(with_reference: bool) -> list[str]:
    """Every variant of every metric that needs no more than there is."""
    has = frozenset({"reference"} if with_reference else ())
    known = [p for p in plugins.discover("metric").values() if isinstance(p, plugins.Plugin)]
    return [f"{p.name}:all" for p in known if p.needs <= has]


def summary(rows: pd.DataFrame) -> Table:
    """A line a metric and variant, for the terminal: mean, spread and extremes over the images."""
    from rich.table import Table

    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, 2, 0, 0))
    for name in ("metric", "variant", "mean", "std", "lowest", "highest", "images"):
        table.add_column(name, justify="left" if name in ("metric", "variant") else "right", no_wrap=True)
    ok = rows[rows["status"] == "ok"]
    for (metric, variant), scores in ok.groupby(["metric", "variant"], sort=False):
        values = scores["value"]
        title = f"{metric} {ARROW[scores['better'].iloc[0]]}"
        finite = values[np.isfinite(values)]
        spread = finite.std(ddof=0) if len(finite) == len(values) else np.nan
        figures = (values.mean(), spread, values.min(), values.max())
        table.add_row(title, variant, *(number(x) for x in figures), str(len(values)))
    return table
