"""The page's plots, as JSON for Plotly, which the page's script draws.

A colour is a name of the style sheet, such as "--ink", or "--m0" for the first method: the script resolves it for light
and dark.
"""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench.compare import Cell, Column, Comparison
from sucre_bench.compare.words import title

Figure = dict[str, Any]

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
    """What a list on the page offers to show. name: in the list; figures: what it shows; table: in numbers, below."""

    name: str
    figures: Sequence[Figure] = ()
    table: Any = None


def key_of(column: Column) -> str:
    """The name of a score on the page."""
    return f"{column.metric}:{column.variant}"


def figure(traces: Sequence[Figure], x: Figure, y: Figure, height: int = _TALL, **layout: Any) -> Figure:
    """Return a figure with the look of the page. x, y: its axes, as Plotly has them; height: in pixels."""
    axis = {"gridcolor": "--line", "linecolor": "--line", "tickcolor": "--line", "zeroline": False, "automargin": True}
    axis |= {"ticks": "outside", "ticklen": 4}
    plain = {
        "paper_bgcolor": "transparent",
        "plot_bgcolor": "transparent",
        "height": height,
        "font": {"color": "--ink", "size": 12.5},
        "margin": {"l": 58, "r": 16, "t": 14, "b": 56},
        "hovermode": "closest",
        "hoverlabel": {"bgcolor": "--raised", "bordercolor": "--line", "font": {"color": "--ink"}},
        "showlegend": False,
    }
    return {"data": list(traces), "layout": plain | {"xaxis": axis | x, "yaxis": axis | y} | layout}


def text(words: str) -> str:
    """Return words that Plotly shows as they are: it reads some markup."""
    return html.escape(words, quote=False)


def look(place: int) -> Figure:
    """Return the marker of a method. place: the method's among all of the page."""
    return {"color": f"--m{place}", "symbol": _SYMBOLS[place % len(_SYMBOLS)], "size": 8}


def line(name: str, place: int, x: Sequence[Any], y: Sequence[Any], hover: str, **more: Any) -> Figure:
    """Return a method's line with markers. hover: what Plotly shows of a point, after the method's name."""
    drawn = {"mode": "lines+markers", "line": {"color": f"--m{place}", "width": 1.3}, "marker": look(place)}
    shown = f"{text(name)}<br>{hover}<extra></extra>"
    return {"name": text(name), "x": list(x), "y": list(y), "hovertemplate": shown} | drawn | more


def legend(names: Sequence[str]) -> Figure:
    """Return the part of a layout that names a plot's methods below it, where there are several."""
    below = {"orientation": "h", "yref": "container", "y": 0, "yanchor": "bottom", "x": 0, "xref": "container"}
    rows = 1 + sum(len(name) + 8 for name in names) // 90
    margin = {"l": 58, "r": 16, "t": 14, "b": 56 + 22 * rows}
    return {"showlegend": True, "legend": below, "margin": margin, "height": _TALL + 22 * rows}


def cost(table: Comparison, column: Column, seconds: Column, places: Mapping[str, int]) -> Figure | None:
    """Return a score against the seconds a view; None where no method has both. places: see `look`."""
    known = [
        (name, cell, took)
        for name in table.methods
        if (cell := table.cells.get((name, column))) and (took := table.cells.get((name, seconds)))
        if math.isfinite(cell.mean) and took.mean > 0
    ]
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
    x = {"type": "log", "title": {"text": "seconds a view"}, "range": [min(decades) - 0.35, max(decades) + 0.35]}
    y = {"title": {"text": text(title(column))}, "autorange": "reversed" if column.better == "lower" else True}
    names = {"margin": {"l": 58, "r": 110, "t": 14, "b": 56}} if is_named else legend([name for name, *_ in known])
    return figure(traces, x | {"dtick": 1}, y, **names)


def over_datasets(tables: Sequence[Comparison], columns: Sequence[Column | None], names: Mapping[str, int]) -> Figure:
    """Return a score over datasets, a line a method. columns: the score's in each table; names: see `look`."""
    lines, titles = [], [text(table.title) for table in tables]
    for name, place in names.items():
        cells = [
            table.cells.get((name, column)) if column else None for table, column in zip(tables, columns, strict=True)
        ]
        means = [cell.mean if cell and math.isfinite(cell.mean) else None for cell in cells]
        lines.append(line(name, place, titles, means, "%{x}, %{y:.3g}", error_y=_interval(cells, width=3)))
    first = next(column for column in columns if column)
    return figure(lines, {"type": "category"}, {"title": {"text": text(title(first))}}, **legend(list(names)))


def _interval(cells: Iterable[Cell | None], width: int) -> Figure:
    """The bars of 95 % intervals, none where there is no interval."""
    ends = [(cell.low, cell.mean, cell.high) if cell else (math.nan,) * 3 for cell in cells]
    known = [(high - mean, mean - low) if math.isfinite(low + high) else (0, 0) for low, mean, high in ends]
    above, below = zip(*known, strict=True)
    bars = {"array": above, "arrayminus": below, "thickness": 1.2, "width": width}
    return {"type": "data", "symmetric": False} | bars


def waters(views: Sequence[Mapping[str, Any]], method: int) -> list[Figure]:
    """Return a plot for each parameter of the water, a line a channel over the views, the truth dotted.

    views: as the page has them; method: whose water, by its place.
    """
    names = [text(view["name"]) for view in views]
    estimates = [view["results"][method].get("water") or {} for view in views]
    made = []
    for key, _, words, unit in PARAMETERS:
        traces: list[Figure] = []
        for c, (channel, colour) in enumerate(CHANNELS.items()):
            errors = [of_water(water.get("standard_error") or {}, key, c) for water in estimates]
            bars = {"type": "data", "array": [error or 0 for error in errors], "thickness": 1, "width": 2}
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
                traces.append({"name": "true", "x": names, "y": truth, "mode": "lines", "line": dotted})
        x = {"type": "category", "showticklabels": False, "title": {"text": "views in order", "standoff": 6}}
        label, margin = f"{words}, {unit}" if unit else words, {"l": 46, "r": 12, "t": 30, "b": 40}
        made.append(figure(traces, x, {"rangemode": "tozero"}, 280, title=heading(label), margin=margin))
    return made


def of_water(water: Mapping[str, Any], key: str, channel: int) -> Any:
    """Return a channel of a water's parameter; None where it is not known."""
    values = water.get(key)
    return values[channel] if isinstance(values, list) and len(values) > channel else None


def heading(label: str) -> Figure:
    """Return the title of a small plot, above its left end."""
    return {"text": label, "x": 0, "xref": "paper", "y": 1, "yref": "container", "yanchor": "top", "font": {"size": 13}}
