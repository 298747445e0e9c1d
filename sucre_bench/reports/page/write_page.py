"""The results page: one static file made from the table and the pictures, which opens from disk without a network.

The page embeds values as JSON, one block for each dataset, and reads a block when the reader chooses its dataset.
Scripts and styles are copies of the files beside this one. The page allows itself no connection at all (its
Content-Security-Policy).
"""

import base64
import gzip
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Comparison
from sucre_bench.compare.model import FEWEST_VIEWS
from sucre_bench.compare.numbers import NUMBERS
from sucre_bench.jobs.words import shell
from sucre_bench.machine import provenance
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.records import masked
from sucre_bench.machine.text_formats import filled_in, policy_hash, read_yaml, source
from sucre_bench.reports.metric_roles import roles
from sucre_bench.reports.page.dataset_content import Section, cell_of, column_of, key_of
from sucre_bench.reports.page.gallery import WIDTHS, Gallery, Widths
from sucre_bench.reports.page.join_scripts import join_scripts
from sucre_bench.reports.paper.figures import style
from sucre_bench.results import layout, restoration_rows, with_remedy
from sucre_bench.results.reasons import unscored, without_view
from sucre_bench.results.rows import RESTORATION, restorations

# Later styles override earlier ones.
_STYLES = ("page", "controls", "top", "tables", "pictures", "parts", "media")
_HUGE = 1e308  # what JSON has for infinity


def write(out: Path, rows: DataFrame, comparisons: Sequence[Comparison], widths: Widths = WIDTHS) -> Path:
    """Write ``out/report/index.html`` and return its path.

    rows, comparisons: the score table of `out`, and a comparison of methods for each of its datasets. The page embeds
    thumbnails, and reads full pictures from `out`. widths: (most pictures, their width in pixels), widest first. The
    page takes the first pair that holds all pictures; of more pictures than the last pair allows it links the rest.
    """
    from markupsafe import Markup

    gallery = Gallery(out, _most_pictures(rows), widths)
    config = _read(out / "config.yaml")
    sections = [Section(out, rows[rows["dataset"] == t.title], t, gallery, _plugins(config)) for t in comparisons]
    contents = [_json(section.content()) for section in sections]
    styles = "\n".join(source(__package__, f"{name}.css") for name in _STYLES)
    scripts = join_scripts("main", lambda name: source(__package__, f"{name}.js"))
    plotly = source("plotly", "package_data/plotly.min.js") if (rows["status"] == "ok").any() else ""
    page = filled_in(
        __package__,
        "page.html.j2",
        policy=policy([scripts, plotly], [styles]),
        style=Markup(styles),
        scripts=Markup(scripts),
        summary=Markup(_json(_summary(comparisons))),
        datasets=[Markup(text) for text in contents],
        blocks=gallery.blocks(),
        plotly=_compressed(plotly) if plotly else "",
        failed=_reasons(rows, "failed"),
        skipped=_reasons(restoration_rows(rows), "skipped"),
        unscored=list(unscored(rows)),
        counts=restoration_rows(rows)["status"].value_counts().to_dict(),
        shell=lambda words: masked(shell(words)),
        environment=provenance.read(out / "environment.json"),
        config=config,
        log=layout.log_path(out).is_file(),
    )
    path = out / "report" / "index.html"
    write_atomically(path, page)
    return path


def _most_pictures(rows: DataFrame) -> int:
    """How many pictures the views and their restorations may have."""
    views = rows.loc[rows["view"] != "", ["dataset", "scene", "view"]].drop_duplicates()
    return 2 * len(views) + len(restorations(rows))


def _summary(comparisons: Sequence[Comparison]) -> dict[str, Any]:
    """What is known before a dataset is chosen: the methods and their colours, and the means on every dataset."""
    methods = list(dict.fromkeys(name for table in comparisons for name in table.methods))
    columns = {key_of(c.metric, c.variant): column_of(c) for table in comparisons for c in table.columns}
    means: dict[str, list[list[Any]]] = {key: [] for key in columns}
    for table in comparisons:
        by_key = {key_of(c.metric, c.variant): c for c in table.columns}
        for key, lines in means.items():
            lines.append([cell_of(table, name, by_key[key]) if key in by_key else None for name in methods])
    looks = style.looks(methods)
    return {
        "datasets": [table.title for table in comparisons],
        "methods": methods,
        "colours": {name: look.colour for name, look in looks.items()},
        "columns": list(columns.values()),
        "means": means,
        "numbers": asdict(NUMBERS),
        "fewest_views": FEWEST_VIEWS,
        "roles": roles(),
    }


def _reasons(rows: DataFrame, status: str) -> list[dict[str, Any]]:
    """Where and why, with the views that share a fault in one entry."""
    of_status = rows[rows["status"] == status]
    pairs = zip(of_status["reason"], of_status["view"], strict=True)
    of_status = of_status.assign(reason=[without_view(str(reason), view) for reason, view in pairs])
    faults = []
    for (dataset, method, metric, reason), same in of_status.groupby(
        ["dataset", "method", "metric", "reason"], sort=False
    ):
        views = sorted(set(same["view"].unique()) - {""})
        score = "" if metric == RESTORATION else metric
        faults.append(
            {"dataset": dataset, "method": method, "score": score, "reason": with_remedy(reason), "views": views}
        )
    return faults


def _plugins(config: str) -> tuple[str, ...]:
    """The files that a run took plugins from."""
    import yaml

    try:
        found = (read_yaml(config) or {}).get("plugins")
    except (yaml.YAMLError, AttributeError):
        return ()
    return tuple(map(str, found or ()))


def _read(path: Path) -> str:
    return masked(path.read_text(encoding="utf-8", errors="replace")) if path.is_file() else ""


def _compressed(script: str) -> str:
    """A script that the page unpacks when it needs it: when the first plot comes into view."""
    return base64.b64encode(gzip.compress(script.encode(), 6, mtime=0)).decode()


def _json(value: Any) -> str:
    """Return JSON for a script element: `<` is escaped, so that no value can end the script, and NaN is null."""
    text = json.dumps(_finite(value), ensure_ascii=False, separators=(",", ":"), default=str)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, Iterable) and not isinstance(value, str):
        return [_finite(inner) for inner in value]
    if isinstance(value, float):
        if math.isnan(value):
            return None
        return float(f"{value:.6g}") if math.isfinite(value) else math.copysign(_HUGE, value)
    return value


def policy(scripts: Iterable[str], styles: Iterable[str]) -> str:
    """Return the Content-Security-Policy of a page: no connections, its own scripts and styles by their hashes.

    scripts, styles: each the exact text of its element.
    """
    return "; ".join(
        [
            "default-src 'none'",
            "img-src 'self' file: data: blob:",
            f"style-src {_hashes(styles)} {_hashes([''])}",  # Plotly adds an empty sheet, and fills it by rules
            f"script-src {_hashes(scripts)}",
        ]
    )


def _hashes(texts: Iterable[str]) -> str:
    return " ".join(f"'{policy_hash(text)}'" for text in texts)
