"""The page's plots, as JSON for Plotly, which the page's script draws, and what it shows of colour charts.

A colour is a name of the style sheet, for example "--ink", or "--m0" for the first method. The script resolves it for
light and dark.
"""

import html
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.compare import Cell, Column, Comparison
from sucre_bench.compare.words import number, title
from sucre_bench.imaging.chart_kinds import read_label
from sucre_bench.reports.metric_roles import metrics_of, roles
from sucre_bench.results.rows import values_of

Figure = dict[str, Any]
Places = Mapping[str, int]  # of every method, its place among all of the page

CHANNELS = {"red": "#d1495b", "green": "#3a9d5d", "blue": "#3d7dd8"}
# Of a water: its parameter, the symbol that tables show, the title of its plot, its unit.
PARAMETERS = (
    ("B", "B", "B, veiling light", ""),
    ("beta", "β", "β, attenuation", "1/m"),
    ("gamma", "γ", "γ, backscatter", "1/m"),
)

_SYMBOLS = ("circle", "square", "diamond", "triangle-up", "cross", "x", "star", "hexagon")
_MOST_NAMED = 6  # names beside points: more would cover each other
_TALL = 400


@dataclass(frozen=True)
class Choice:
    """What a list on the page offers to show."""

    name: str
    """In the list."""

    figures: Sequence[Figure] = ()
    """What it shows."""

    table: Any = None
    """What it shows in numbers, below the figures."""


def figure(
    traces: Sequence[Figure], x: Figure, y: Figure, height: int = _TALL, **layout: Any
) -> Figure:
    """Return a figure with the look of the page. x, y: its axes, as Plotly has them; height: in pixels."""
    axis = {
        "gridcolor": "--line",
        "linecolor": "--line",
        "tickcolor": "--line",
        "zeroline": False,
        "automargin": True,
    }
    axis |= {"ticks": "outside", "ticklen": 4}
    plain = {
        "paper_bgcolor": "transparent",
        "plot_bgcolor": "transparent",
        "height": height,
        "font": {"color": "--ink", "size": 12.5},
        "margin": {"l": 58, "r": 16, "t": 14, "b": 56},
        "hovermode": "closest",
        "hoverlabel": {
            "bgcolor": "--raised",
            "bordercolor": "--line",
            "font": {"color": "--ink"},
        },
        "showlegend": False,
    }
    return {
        "data": list(traces),
        "layout": plain | {"xaxis": axis | x, "yaxis": axis | y} | layout,
    }


def text(words: str) -> str:
    """Return words that Plotly shows as they are: it reads some markup."""
    return html.escape(words, quote=False)


def look(place: int) -> Figure:
    """Return the marker of a method. place: the method's among all of the page."""
    return {"color": f"--m{place}", "symbol": _SYMBOLS[place % len(_SYMBOLS)], "size": 8}


def line(
    name: str, place: int, x: Sequence[Any], y: Sequence[Any], hover: str, **more: Any
) -> Figure:
    """Return a method's line with markers. hover: what Plotly shows of a point, after the method's name."""
    drawn = {
        "mode": "lines+markers",
        "line": {"color": f"--m{place}", "width": 1.3},
        "marker": look(place),
    }
    shown = f"{text(name)}<br>{hover}<extra></extra>"
    return (
        {"name": text(name), "x": list(x), "y": list(y), "hovertemplate": shown} | drawn | more
    )


def legend(names: Sequence[str]) -> Figure:
    """Return the part of a layout that names a plot's methods below it, where there are several."""
    below = {
        "orientation": "h",
        "yref": "container",
        "y": 0,
        "yanchor": "bottom",
        "x": 0,
        "xref": "container",
    }
    rows = 1 + sum(len(name) + 8 for name in names) // 90
    margin = {"l": 58, "r": 16, "t": 14, "b": 56 + 22 * rows}
    return {"showlegend": True, "legend": below, "margin": margin, "height": _TALL + 22 * rows}


def cost(table: Comparison, column: Column, seconds: Column, places: Places) -> Figure | None:
    """Return a score against the seconds a view; None where no method has both. places: see `look`."""
    known = []
    for name in table.methods:
        cell = table.cells.get((name, column))
        took = table.cells.get((name, seconds))
        if not cell or not took:
            continue
        if math.isfinite(cell.mean) and took.mean > 0:
            known.append((name, cell, took))
    if not known:
        return None
    is_named = len(known) <= _MOST_NAMED
    traces = [
        {
            "name": text(name),
            "x": [took.mean],
            "y": [cell.mean],
            "error_y": _interval([cell], width=0),
            "mode": "markers+text" if is_named else "markers",
            "text": [f"  {text(name)}"],
            "textposition": "middle right",
            "cliponaxis": False,
            "textfont": {"color": "--dim"},
            "marker": look(places[name]) | {"size": 11},
            "hovertemplate": f"{text(name)}<br>%{{x:.3g}} s, %{{y:.3g}} {text(column.unit)}<extra></extra>",
        }
        for name, cell, took in known
    ]
    decades = [math.log10(took.mean) for *_, took in known]
    x = {
        "type": "log",
        "title": {"text": "seconds a view"},
        "range": [min(decades) - 0.35, max(decades) + 0.35],
    }
    y = {
        "title": {"text": text(title(column))},
        "autorange": "reversed" if column.better == "lower" else True,
    }
    names = (
        {"margin": {"l": 58, "r": 110, "t": 14, "b": 56}}
        if is_named
        else legend([name for name, *_ in known])
    )
    return figure(traces, x | {"dtick": 1}, y, **names)


def over_datasets(
    tables: Sequence[Comparison], columns: Sequence[Column | None], names: Places
) -> Figure:
    """Return a score over datasets, a line a method. columns: the score's in each table; names: see `look`."""
    lines = []
    titles = [text(table.title) for table in tables]
    for name, place in names.items():
        cells = [
            table.cells.get((name, column)) if column else None
            for table, column in zip(tables, columns, strict=True)
        ]
        means = [cell.mean if cell and math.isfinite(cell.mean) else None for cell in cells]
        lines.append(
            line(
                name, place, titles, means, "%{x}, %{y:.3g}", error_y=_interval(cells, width=3)
            )
        )
    first = next(column for column in columns if column)
    return figure(
        lines,
        {"type": "category"},
        {"title": {"text": text(title(first))}},
        **legend(list(names)),
    )


def _interval(cells: Iterable[Cell | None], width: int) -> Figure:
    """The bars of 95 % intervals, none where there is no interval."""
    ends = [(cell.low, cell.mean, cell.high) if cell else (math.nan,) * 3 for cell in cells]
    known = [
        (high - mean, mean - low) if math.isfinite(low + high) else (0, 0)
        for low, mean, high in ends
    ]
    above, below = zip(*known, strict=True)
    bars = {"array": above, "arrayminus": below, "thickness": 1.2, "width": width}
    return {"type": "data", "symmetric": False} | bars


def waters(views: Sequence[Mapping[str, Any]], method: int) -> list[Figure]:
    """Return a plot for each parameter of the water, a line a channel over the views, the truth dotted.

    views: as the page has them; method: whose water, by its place.
    """
    names = [text(view["name"]) for view in views]
    estimates = [view["results"][method].get("water") or {} for view in views]
    above = {"x": 0, "xref": "paper", "y": 1, "yref": "container", "yanchor": "top"}
    above["font"] = {"size": 13}
    made = []
    for key, _, words, unit in PARAMETERS:
        traces: list[Figure] = []
        for c, (channel, colour) in enumerate(CHANNELS.items()):
            errors = [
                of_water(water.get("standard_error") or {}, key, c) for water in estimates
            ]
            bars = {
                "type": "data",
                "array": [error or 0 for error in errors],
                "thickness": 1,
                "width": 2,
            }
            traces.append(
                {
                    "name": channel,
                    "x": names,
                    "y": [of_water(water, key, c) for water in estimates],
                    "mode": "lines+markers",
                    "line": {"color": colour, "width": 1.5},
                    "hovertemplate": f"%{{x}}<br>{channel} %{{y:.3g}} {unit}<extra></extra>",
                }
                | ({"error_y": bars} if any(errors) else {})
            )
            truth = [of_water(view["truth"] or {}, key, c) for view in views]
            if any(value is not None for value in truth):
                dotted = {"color": colour, "width": 1.7, "dash": "dot"}
                traces.append(
                    {"name": "true", "x": names, "y": truth, "mode": "lines", "line": dotted}
                )
        x = {
            "type": "category",
            "showticklabels": False,
            "title": {"text": "views in order", "standoff": 6},
        }
        heading = above | {"text": f"{words}, {unit}" if unit else words}
        margin = {"l": 46, "r": 12, "t": 30, "b": 40}
        made.append(
            figure(traces, x, {"rangemode": "tozero"}, 280, title=heading, margin=margin)
        )
    return made


def of_water(water: Mapping[str, Any], key: str, channel: int) -> Any:
    """Return a channel of a water's parameter; None where it is not known."""
    values = water.get(key)
    return values[channel] if isinstance(values, list) and len(values) > channel else None


# -- colour charts: each patch as measured and expected, and errors over distance --------------------------

# by "metric:variant" and method; None: infinite
Scores = Mapping[str, Mapping[str, float | None]]

_MOST_SWATCHES = 40  # charts whose patches the page shows


@dataclass(frozen=True)
class Chart:
    """A chart of a view."""

    view: str
    """As the page calls it."""

    name: str

    distance: float | None
    """In metres, the same for every method."""

    whole: Scores
    """Scores of the chart itself."""

    patches: Mapping[str, Scores]
    """Scores of each patch, by name, in order of number."""


def chart_content(
    rows: DataFrame,
    columns: Sequence[Column],
    methods: Places,
    names: Mapping[tuple[str, str], str],
) -> dict[str, list[Choice]]:
    """Return the lists of swatches and of errors over distance that the page offers of a dataset.

    methods: labels, each with its place among all of the page; names: what the page calls each view, by scene and view.
    """
    ok = rows[(rows["status"] == "ok") & rows["method"].isin(list(methods))]
    ok = ok[(ok["region"] != "image") & ~ok["region"].str.startswith("image/")]
    scores: dict[Any, Any] = defaultdict(lambda: defaultdict(lambda: defaultdict(dict)))
    for *of_view, region, metric, variant, method, value in values_of(
        ok, "scene", "view", "region", "metric", "variant", "method", "value"
    ):
        name, _, patch = region.partition("/")
        scores[*of_view, name][patch][f"{metric}:{variant}"][method] = (
            value if math.isfinite(value) else None
        )
    order = {view: n for n, view in enumerate(names)}
    known = roles()
    charts = []
    for scene, view, name in sorted(scores, key=lambda key: order[key[:2]]):
        patches = scores[scene, view, name]
        whole = patches.pop("", {})
        away = [key for key in whole if known.get(key.partition(":")[0]) == "chart-distance"]
        distance = _first(value for key in away for value in whole[key].values())
        by_number = {
            patch: patches[patch]
            for patch in sorted(patches, key=lambda label: read_label(label)[0])
        }
        charts.append(Chart(names[scene, view], name, distance, whole, by_number))
    keys = {key for chart in charts for key in chart.whole}
    measures = [c for c in columns if c.of == "chart" and c.directed and c.key in keys]
    near_first = sorted(
        (chart for chart in charts if chart.distance is not None),
        key=lambda one: one.distance or 0,
    )
    return {
        "swatches": _swatches(charts, measures, list(methods)),
        "distances": [_distances(charts, near_first, column, methods) for column in measures],
    }


def _swatches(
    charts: Sequence[Chart], measures: Sequence[Column], methods: Sequence[str]
) -> list[Choice]:
    """A table for each chart and colour difference: each patch in every method's picture."""
    keys = {key for chart in charts for scores in chart.patches.values() for key in scores}
    of_patches = [column for column in measures if column.key in keys]
    painted = [
        column for column in of_patches if roles().get(column.metric) == "colour-difference"
    ] or of_patches[:1]
    choices = []
    for column in painted:
        key = column.key
        for chart in (charts[k] for k in evenly(len(charts), _MOST_SWATCHES)):
            table = [
                {
                    "label": name,
                    "mean": _number(chart.whole, key, name),
                    "patches": [
                        {
                            "measured": _colour(scores, "", name),
                            "value": _number(scores, key, name),
                        }
                        for scores in chart.patches.values()
                    ],
                }
                for name in methods
            ]
            away = "" if chart.distance is None else f"{number(chart.distance)} m"
            words = " · ".join(filter(None, [chart.view, chart.name, away]))
            shown = {
                "names": list(map(_words, chart.patches)),
                "expected": [_colour(scores, "-expected") for scores in chart.patches.values()],
                "rows": table,
                "metric": column.metric,
                "unit": title(column),
            }
            choices.append(
                Choice(
                    f"{words}, {column.metric} ({column.variant})" if painted[1:] else words,
                    (),
                    shown,
                )
            )
    return choices


def _distances(
    charts: Sequence[Chart], near_first: Sequence[Chart], column: Column, methods: Places
) -> Choice:
    """A score of charts over their distance, as plot and in numbers."""
    key = column.key
    lines = []
    for name, place in methods.items():
        pairs = [(chart, _at(chart.whole, key, name)) for chart in near_first]
        known = [(chart, value) for chart, value in pairs if value is not None]
        words = [text(f"{chart.view} · {chart.name}") for chart, _ in known]
        hover = f"%{{text}}<br>%{{x:.2f}} m, %{{y:.3g}} {column.unit}"
        x = [chart.distance for chart, _ in known]
        y = [value for _, value in known]
        lines.append(line(name, place, x, y, hover, text=words))
    axes = (
        {"title": {"text": "distance of the chart, m"}},
        {"title": {"text": title(column)}, "rangemode": "tozero"},
    )
    figures = [figure(lines, *axes, **legend(list(methods)))] if near_first else []
    table = [
        (
            chart.view,
            chart.name,
            chart.distance,
            [_at(chart.whole, key, name) for name in methods],
        )
        for chart in charts
        if key in chart.whole
    ]
    return Choice(title(column), figures, {"rows": table})


def _colour(scores: Scores, what: str, method: str = "") -> str:
    """A patch's colour as a style sheet has it: as measured in a method's picture, or "-expected" of it; else ""."""
    metric = next(iter(metrics_of("patch-colour")), "")
    by_channel = [scores.get(f"{metric}:{channel}{what}", {}) for channel in CHANNELS]
    rgb = [
        channel.get(method) if method else _first(channel.values()) for channel in by_channel
    ]
    shown = [str(round(255 * value)) for value in rgb if value is not None]
    return f"rgb({' '.join(shown)})" if len(shown) == 3 else ""


def _first(values: Iterable[float | None]) -> float | None:
    return next((value for value in values if value is not None), None)


def _at(scores: Scores, key: str, method: str) -> float | None:
    return scores.get(key, {}).get(method)


def _number(scores: Scores, key: str, method: str) -> str:
    value = _at(scores, key, method)
    return "" if value is None else number(value)


def _words(patch: str) -> str:
    return read_label(patch)[1].replace("-", " ")
