"""What the page shows of colour charts: each patch as measured and expected, and errors and hues over distance."""

import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench.arrays import CHANNELS, DataFrame, evenly
from sucre_bench.compare import Column
from sucre_bench.compare.words import number, title
from sucre_bench.imaging.chart_kinds import read_label
from sucre_bench.reports.metric_roles import metrics_of, roles
from sucre_bench.reports.page import plots
from sucre_bench.reports.page.plots import Choice, key_of
from sucre_bench.results.rows import values_of

Scores = Mapping[str, Mapping[str, float | None]]  # by "metric:variant" and method; None: infinite

_MOST_SWATCHES = 40  # charts whose patches the page shows


@dataclass(frozen=True)
class Chart:
    """A chart of a view.

    view: as the page calls it; distance: in metres, the same for every method; whole: its own scores; patches: those
    of each patch, by name, in order of number.
    """

    view: str
    name: str
    distance: float | None
    whole: Scores
    patches: Mapping[str, Scores]


def chart_content(
    rows: DataFrame, columns: Sequence[Column], methods: Mapping[str, int], names: Mapping[tuple[str, str], str]
) -> dict[str, list[Choice]]:
    """Return the lists of swatches, errors over distance, and hues over distance that the page offers of a dataset.

    methods: labels, each with its place among all of the page; names: what the page calls each view, by scene and view.
    """
    charts = _read(rows, methods, names)
    keys = {key for chart in charts for key in chart.whole}
    measures = [c for c in columns if c.of == "chart" and c.directed and key_of(c) in keys]
    near_first = sorted((chart for chart in charts if chart.distance is not None), key=lambda one: one.distance or 0)
    return {
        "swatches": _swatches(charts, measures, list(methods)),
        "distances": [_distances(charts, near_first, column, methods) for column in measures],
        "hues": _hues(near_first, methods),
    }


def _read(rows: DataFrame, methods: Iterable[str], names: Mapping[tuple[str, str], str]) -> list[Chart]:
    """The charts of a dataset's rows, in the order of the views."""
    ok = rows[(rows["status"] == "ok") & rows["method"].isin(list(methods))]
    ok = ok[(ok["region"] != "image") & ~ok["region"].str.startswith("image/")]
    scores: dict[Any, Any] = defaultdict(lambda: defaultdict(lambda: defaultdict(dict)))
    for *view, region, metric, variant, method, value in values_of(
        ok, "scene", "view", "region", "metric", "variant", "method", "value"
    ):
        name, _, patch = region.partition("/")
        scores[*view, name][patch][f"{metric}:{variant}"][method] = value if math.isfinite(value) else None
    order, known, charts = {view: n for n, view in enumerate(names)}, roles(), []
    for scene, view, name in sorted(scores, key=lambda key: order[key[:2]]):
        patches = scores[scene, view, name]
        whole = patches.pop("", {})
        away = [key for key in whole if known.get(key.partition(":")[0]) == "chart-distance"]
        distance = _first(value for key in away for value in whole[key].values())
        by_number = {patch: patches[patch] for patch in sorted(patches, key=lambda label: read_label(label)[0])}
        charts.append(Chart(names[scene, view], name, distance, whole, by_number))
    return charts


def _swatches(charts: Sequence[Chart], measures: Sequence[Column], methods: Sequence[str]) -> list[Choice]:
    """A table for each chart and colour difference: each patch in every method's picture."""
    keys = {key for chart in charts for scores in chart.patches.values() for key in scores}
    of_patches = [column for column in measures if key_of(column) in keys]
    painted = [column for column in of_patches if roles().get(column.metric) == "colour-difference"] or of_patches[:1]
    choices = []
    for column in painted:
        key = key_of(column)
        for chart in (charts[k] for k in evenly(len(charts), _MOST_SWATCHES)):
            table = [
                {
                    "label": name,
                    "mean": _number(chart.whole, key, name),
                    "patches": [
                        {"measured": _colour(scores, "", name), "value": _number(scores, key, name)}
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
            choices.append(Choice(f"{words}, {column.metric} ({column.variant})" if painted[1:] else words, (), shown))
    return choices


def _distances(
    charts: Sequence[Chart], near_first: Sequence[Chart], column: Column, methods: Mapping[str, int]
) -> Choice:
    """A score of charts over their distance, as plot and in numbers."""
    key, lines = key_of(column), []
    for name, place in methods.items():
        known = [(chart, value) for chart in near_first if (value := _at(chart.whole, key, name)) is not None]
        words = [plots.text(f"{chart.view} · {chart.name}") for chart, _ in known]
        hover = f"%{{text}}<br>%{{x:.2f}} m, %{{y:.3g}} {column.unit}"
        x, y = [chart.distance for chart, _ in known], [value for _, value in known]
        lines.append(plots.line(name, place, x, y, hover, text=words))
    axes = {"title": {"text": "distance of the chart, m"}}, {"title": {"text": title(column)}, "rangemode": "tozero"}
    figures = [plots.figure(lines, *axes, **plots.legend(list(methods)))] if near_first else []
    table = [
        (chart.view, chart.name, chart.distance, [_at(chart.whole, key, name) for name in methods])
        for chart in charts
        if key in chart.whole
    ]
    return Choice(title(column), figures, {"rows": table})


def _hues(near_first: Sequence[Chart], methods: Mapping[str, int]) -> list[Choice]:
    """The hue of every patch over distance, for each way of measuring hue and each kind of chart."""
    keys = dict.fromkeys(key for chart in near_first for scores in chart.patches.values() for key in scores)
    hues = [key for key in keys if key.partition(":")[0] in metrics_of("patch-hue") and not key.endswith("-expected")]
    kinds: dict[tuple[str, ...], list[Chart]] = defaultdict(list)
    for chart in near_first:
        kinds[tuple(chart.patches)].append(chart)
    choices = []
    for key in hues:
        for patches, charts in kinds.items():
            measured = [patch for patch in patches if any(key in chart.patches[patch] for chart in charts)]
            if measured:
                words = f"{key.partition(':')[2]}, {', '.join(dict.fromkeys(chart.name for chart in charts))}"
                choices.append(Choice(words, [_hue(key, patch, charts, methods) for patch in measured]))
    return choices


def _hue(key: str, patch: str, charts: Sequence[Chart], methods: Mapping[str, int]) -> plots.Figure:
    """The hue of one patch over distance; hues stand within half a turn of the expected one, in degrees."""
    scores = [chart.patches[patch] for chart in charts]
    expected = _first(value for of_chart in scores for value in of_chart.get(f"{key}-expected", {}).values())
    lines = []
    for name, place in methods.items():
        known = [(chart.distance, _at(of_chart, key, name)) for chart, of_chart in zip(charts, scores, strict=True)]
        x, y = [away for away, hue in known if hue is not None], [hue for _, hue in known if hue is not None]
        turned = y if expected is None else [expected + (hue - expected + 180) % 360 - 180 for hue in y]
        small = {"marker": plots.look(place) | {"size": 5}}
        lines.append(plots.line(name, place, x, turned, "%{x:.2f} m, %{y:.0f}°", **small))
    colour = next(filter(None, (_colour(of_chart, "-expected") for of_chart in scores)), "")
    square = f'<span style="color:{colour}">■</span> ' if colour else ""
    dotted = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": expected, "y1": expected}
    shapes = [] if expected is None else [dotted | {"line": {"color": "--ink", "width": 1, "dash": "dot"}}]
    layout = {"margin": {"l": 40, "r": 8, "t": 26, "b": 26}, "shapes": shapes}
    heading = plots.heading(square + plots.text(_words(patch)))
    return plots.figure(lines, {}, {"nticks": 5}, 190, title=heading, **layout)


def _colour(scores: Scores, what: str, method: str = "") -> str:
    """A patch's colour as a style sheet has it: as measured in a method's picture, or "-expected" of it; else ""."""
    metric = next(iter(metrics_of("patch-colour")), "")
    by_channel = [scores.get(f"{metric}:{channel}{what}", {}) for channel in CHANNELS]
    rgb = [channel.get(method) if method else _first(channel.values()) for channel in by_channel]
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
