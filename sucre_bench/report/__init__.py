"""The results page: one static file made from the table and the pictures, which opens from disk without a network."""

from __future__ import annotations

import base64
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from sucre_bench import compare, layout, provenance, results
from sucre_bench.compare import Comparison
from sucre_bench.tables import ARROW, left_out, number, title

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["write"]

_THUMBNAIL = 420  # pixels wide
_QUALITY = 82
_MOST_VIEWS = 100  # of a dataset; a page of more would be slow to open


def write(out: Path, rows: pd.DataFrame) -> Path:
    """Write ``out/report/index.html`` and return its path.

    Thumbnails are embedded; a click opens the full picture under `out`.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages = Environment(loader=PackageLoader("sucre_bench", "report"), autoescape=True, undefined=StrictUndefined)
    pages.filters |= {"number": number, "title": title, "shell": shlex.join}
    ok = rows[rows["status"] == "ok"]
    page = pages.get_template("page.html.j2").render(
        datasets=[_Section.of(out, rows, table) for table in (compare.compare(rows) if len(ok) else [])],
        failed=_reasons(rows, "failed"),
        skipped=_reasons(rows[rows["metric"] == "seconds"], "skipped"),
        environment=provenance.read(out / "environment.json"),
        costs=compare.COSTS,
        counts=rows.loc[rows["metric"] == "seconds", "status"].value_counts().to_dict(),
    )
    path = out / "report" / "index.html"
    results.write_atomically(path, page.encode())
    return path


@dataclass(frozen=True)
class _Picture:
    """A thumbnail as a data URI, and the path of the full picture from the page."""

    thumbnail: str
    link: str


@dataclass(frozen=True)
class _Shown:
    """A view: the picture of it, of its reference, and by method; or why a method has none."""

    name: str
    original: _Picture | None
    reference: _Picture | None
    restored: dict[str, _Picture | str]


@dataclass(frozen=True)
class _Section:
    """A dataset on the page. not_shown: how many of its views have no pictures on the page, for there are too many."""

    table: Comparison
    notes: Sequence[str]
    views: Sequence[_Shown]
    not_shown: int
    charts: Sequence[tuple[str, list[list[Any]]]]

    @classmethod
    def of(cls, out: Path, rows: pd.DataFrame, table: Comparison) -> _Section:
        own = rows[rows["dataset"] == table.title]
        names = own.loc[own["view"] != "", ["scene", "view"]].drop_duplicates().sort_values(["scene", "view"])
        shown = names.iloc[:: -(-len(names) // _MOST_VIEWS)] if len(names) else names
        views = [_shown(out, own, table, scene, view) for scene, view in shown.itertuples(index=False)]
        return cls(table, left_out(table), views, len(names) - len(shown), _charts(own, table.methods))


def _shown(out: Path, rows: pd.DataFrame, table: Comparison, scene: str, view: str) -> _Shown:
    whole = rows[(rows["metric"] == "seconds") & (rows["scene"] == scene) & (rows["view"] == view)]
    state = {r.method: (r.status, r.reason) for r in whole.itertuples()}
    place = layout.find(table.title, scene, view, out)
    restored: dict[str, _Picture | str] = {}
    for method in table.methods:
        status, reason = state.get(method, ("not run", ""))
        picture = _picture(out, place.restored(out, method)) if place and status == "ok" else None
        restored[method] = picture or f"{status}: {reason}".rstrip(": ")
    original = _picture(out, place.original(out)) if place else None
    reference = _picture(out, place.reference(out)) if place else None
    return _Shown(_name(rows, scene, view), original, reference, restored)


def _name(rows: pd.DataFrame, scene: str, view: str) -> str:
    """A view's name, with its scene where there are several."""
    return f"{scene} · {view}" if len(set(rows["scene"]) - {""}) > 1 else view


def _picture(out: Path, path: Path) -> _Picture | None:
    import cv2

    image = cv2.imread(str(path)) if path.is_file() else None
    if image is None:
        return None
    height = max(1, round(image.shape[0] * _THUMBNAIL / image.shape[1]))
    small = cv2.resize(image, (_THUMBNAIL, height), interpolation=cv2.INTER_AREA)
    _, encoded = cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    data = base64.b64encode(encoded.tobytes()).decode()
    link = "../" + quote("/".join(path.relative_to(out).parts))
    return _Picture(f"data:image/jpeg;base64,{data}", link)


def _charts(rows: pd.DataFrame, methods: Sequence[str]) -> list[tuple[str, list[list[Any]]]]:
    """For every metric that scores charts: its title, and a line a chart with a value a method (None: a hole)."""
    charts = rows[
        (rows["status"] == "ok") & (rows["region"] != "image") & ~rows["region"].str.contains("/", regex=False)
    ]
    tables = []
    for (metric, variant), own in charts.groupby(["metric", "variant"], sort=False):
        wide = own.pivot_table(index=["scene", "view", "region"], columns="method", values="value", aggfunc="first")
        wide = wide.reindex(columns=list(methods))
        unit = own["unit"].iloc[0]
        lines = [
            [f"{_name(rows, scene, view)} · {region}", *(None if value != value else value for value in line)]
            for (scene, view, region), line in zip(wide.index, wide.to_numpy().tolist(), strict=True)
        ]
        tables.append((f"{metric} ({variant}) {ARROW[own['better'].iloc[0]]} {unit}", lines))
    return tables


def _reasons(rows: pd.DataFrame, status: str) -> list[tuple[str, str]]:
    """Where and why, the same fault of one method said once with its views counted."""
    own = rows[rows["status"] == status]
    said = []
    for (dataset, method, metric, reason), same in own.groupby(["dataset", "method", "metric", "reason"], sort=False):
        views = sorted(set(same["view"]) - {""})
        which = views[0] if len(views) == 1 else f"{len(views)} views" if views else "every view"
        score = "" if metric == "seconds" else f" · {metric}"
        said.append((f"{dataset} · {method} · {which}{score}", str(reason)))
    return said
