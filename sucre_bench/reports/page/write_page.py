"""The results page: one static file made from the table and the pictures, which opens from disk without a network.

The template has tables and plots ready; the views with their pictures are JSON, one block for each dataset. Scripts and
styles are copies of the files beside this one. The page allows itself no connection at all (its
Content-Security-Policy).
"""

import base64
import functools
import gzip
import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from sucre_bench.arrays import DataFrame
from sucre_bench.compare import Column, Comparison
from sucre_bench.compare.words import NUMBERS, number, title
from sucre_bench.jobs.job import plugin_files
from sucre_bench.jobs.word_syntax import shell
from sucre_bench.machine import provenance
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.pages import filled_in, policy_hash, source
from sucre_bench.machine.text_formats import masked
from sucre_bench.reports.page import plots
from sucre_bench.reports.page.dataset_content import Section, cells
from sucre_bench.reports.page.gallery import WIDTHS, Gallery, Widths
from sucre_bench.reports.page.plots import CHANNELS, PARAMETERS, Choice, Places
from sucre_bench.reports.paper import style
from sucre_bench.results import layout, restoration_rows, with_remedy
from sucre_bench.results.reasons import unscored, without_view
from sucre_bench.results.rows import RESTORATION, restorations

_STYLES = ("page.css", "parts.css")
# in one scope
_SCRIPTS = (
    "page.js",
    "tables.js",
    "zoom.js",
    "pictures.js",
    "detail.js",
    "plots.js",
    "start.js",
)
_CONSTANTS = {"Infinity": 1e308, "-Infinity": -1e308}  # which JSON does not know; NaN is null
_DARK = 0.3  # brightness of the colours that are lifted on a dark page


def write(
    out: Path, rows: DataFrame, comparisons: Sequence[Comparison], widths: Widths = WIDTHS
) -> Path:
    """Write ``out/report/index.html`` and return its path.

    rows, comparisons: the score table of `out`, and a comparison of methods for each of its datasets. The page embeds
    thumbnails, and reads full pictures from `out`. widths: (most pictures, their width in pixels), widest first. The
    page takes the first pair that holds all pictures; of more pictures than the last pair allows it links the rest.
    """
    views = rows.loc[rows["view"] != "", ["dataset", "scene", "view"]].drop_duplicates()
    gallery = Gallery(out, 2 * len(views) + len(restorations(rows)), widths)
    path = out / "config.yaml"
    config = (
        masked(path.read_text(encoding="utf-8", errors="replace")) if path.is_file() else ""
    )
    places = {
        name: n
        for n, name in enumerate(
            dict.fromkeys(m for table in comparisons for m in table.methods)
        )
    }
    files = plugin_files(out)
    datasets = [
        Section(out, rows[rows["dataset"] == t.title], t, gallery, files, places).content()
        for t in comparisons
    ]
    styles = "\n".join(
        [*(source(__package__, name) for name in _STYLES), _method_colours(places)]
    )
    body = "\n".join(source(__package__, name) for name in _SCRIPTS)
    scripts = f'(() => {{\n"use strict";\n{body}\n}})();'
    has_plots = any(
        dataset[part] for dataset in datasets for part in ("costs", "distances", "waters")
    )
    plotly = source("plotly", "package_data/plotly.min.js") if has_plots else ""
    # No connections, and what the page has itself. Plotly adds an empty style sheet, which it fills by rules.
    allowed = [
        " ".join(f"'{policy_hash(text)}'" for text in texts)
        for texts in ((styles, ""), (scripts, plotly))
    ]
    page = filled_in(
        __package__,
        "page.html.j2",
        policy=f"default-src 'none'; img-src 'self' file: data: blob:; style-src {allowed[0]}; script-src {allowed[1]}",
        style=Markup(styles),
        scripts=Markup(scripts),
        json=_json,
        number=number,
        summary={"datasets": [t.title for t in comparisons], "numbers": NUMBERS},
        datasets=datasets,
        places=places,
        sweep=_sweep(comparisons, datasets, places) if len(comparisons) > 1 else [],
        water_columns=[
            (f"{symbol} {channel}", unit)
            for _, symbol, _, unit in PARAMETERS
            for channel in CHANNELS
        ],
        blocks=gallery.blocks(),
        plotly=_packed(plotly),
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


@functools.cache
def _packed(script: str) -> str:
    """A script as the page has it until the first plot comes into view."""
    return (
        base64.b64encode(gzip.compress(script.encode(), 6, mtime=0)).decode() if script else ""
    )


def _sweep(
    tables: Sequence[Comparison], datasets: Sequence[Any], places: Places
) -> list[Choice]:
    """Each score over all datasets, as a plot and in numbers; those that decide first.

    datasets: as `Section.content` has them.
    """
    heads = [
        head
        for dataset in datasets
        for head in dataset["columns"]
        if head["kind"] != "describes"
    ]
    columns: dict[str, list[Column | None]] = {head["key"]: [] for head in heads}
    for table in tables:
        by_key = {column.key: column for column in table.columns}
        for key, of_tables in columns.items():
            of_tables.append(by_key.get(key))
    made = []
    for of_tables in columns.values():
        first = next(column for column in of_tables if column)
        rows = []
        for table, of_table in zip(tables, of_tables, strict=True):
            own = (
                dict(zip(table.methods, cells(table, of_table), strict=True))
                if of_table
                else {}
            )
            rows.append((table.title, [own.get(name) for name in places]))
        figures = [plots.over_datasets(tables, of_tables, places)] if len(tables) > 2 else []
        made.append(
            Choice(
                f"{title(first)} ({first.variant})",
                figures,
                {"rows": rows, "better": first.better},
            )
        )
    return made


def _method_colours(places: Places) -> str:
    """The style sheet's colours of the methods, lifted where one would not be seen on dark."""
    lines = []
    for look, place in zip(style.looks(places).values(), places.values(), strict=True):
        rgb = [int(look.colour[at : at + 2], 16) for at in (1, 3, 5)]
        is_dark = (
            sum(c * w for c, w in zip(rgb, (0.299, 0.587, 0.114), strict=True)) < 255 * _DARK
        )
        lifted = (
            "#" + "".join(f"{round(c + 0.6 * (255 - c)):02x}" for c in rgb)
            if is_dark
            else look.colour
        )
        lines.append(f":root {{ --m{place}: light-dark({look.colour}, {lifted}); }}")
        lines.append(f".m{place} {{ background: var(--m{place}); }}")
    return "\n".join(lines)


def _reasons(rows: DataFrame, status: str) -> list[dict[str, Any]]:
    """Where and why, with the views that share a fault in one entry."""
    of_status = rows[rows["status"] == status]
    pairs = zip(of_status["reason"], of_status["view"], strict=True)
    of_status = of_status.assign(
        reason=[without_view(str(reason), view) for reason, view in pairs]
    )
    faults = []
    by = ["dataset", "method", "metric", "reason"]
    for (dataset, method, metric, reason), same in of_status.groupby(by, sort=False):
        views = sorted(set(same["view"].unique()) - {""})
        score = "" if metric == RESTORATION else metric
        faults.append(
            {
                "dataset": dataset,
                "method": method,
                "score": score,
                "reason": with_remedy(reason),
                "views": views,
            }
        )
    return faults


def _json(value: Any) -> Markup:
    """Return JSON for a script element: `<` is escaped, so that no value can end the script, and NaN is null.

    Numbers have six digits.
    """
    text = json.dumps(
        value, default=lambda other: list(other) if isinstance(other, Iterable) else str(other)
    )
    short = json.loads(
        text,
        parse_float=lambda digits: float(f"{float(digits):.6g}"),
        parse_constant=_CONSTANTS.get,
    )
    text = json.dumps(short, ensure_ascii=False, separators=(",", ":"))
    return Markup(
        text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
    )
