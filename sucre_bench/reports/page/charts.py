"""What the page shows of colour charts: each patch as measured and expected, and errors and hues over distance."""

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.compare import Column
from sucre_bench.compare.words import number, title
from sucre_bench.reports.metric_roles import metrics_of, roles
from sucre_bench.reports.page import plots
from sucre_bench.reports.page.plots import Choice

Scores = dict[str, list[Any]]  # by "metric:variant", a value a method, None where it has none

_MOST_SWATCHES = 40  # charts whose patches the page shows


@dataclass(frozen=True)
class Chart:
    """A chart of a view. view: as the page calls it; scores: of the whole chart; patches: of each patch, by name."""

    view: str
    name: str
    scores: Scores = field(default_factory=dict)
    patches: dict[str, Scores] = field(default_factory=dict)

    @property
    def title(self) -> str:
        """View, chart and distance."""
        away = "" if self.distance is None else f"{number(self.distance)} m"
        return " · ".join(filter(None, [self.view, self.name, away]))

    @cached_property
    def distance(self) -> float | None:
        """In metres; of the view, so the same for every method."""
        keys = [key for key in self.scores if _role(key) == "chart-distance"]
        return _first(value for key in keys for value in self.scores[key])

    @property
    def ordered(self) -> list[str]:
        """The names of its patches, by their number."""
        return sorted(self.patches, key=_place)


@dataclass(frozen=True)
class Charts:
    """The charts of a dataset. methods: their labels, each with its place among all of the page."""

    charts: Sequence[Chart]
    columns: Sequence[Column]
    methods: Mapping[str, int]

    def swatches(self) -> list[Choice]:
        """Return a table for each chart and colour difference: each patch in every method's picture."""
        of_patches = [
            c for c in self._measures() if any(_key(c) in p for one in self.charts for p in one.patches.values())
        ]
        measures = [c for c in of_patches if _role(_key(c)) == "colour-difference"] or of_patches[:1]
        shown = [self.charts[k] for k in evenly(len(self.charts), _MOST_SWATCHES)]
        several = len(measures) > 1
        return [
            Choice(f"{one.title}{f', {c.metric} ({c.variant})' * several}", table=self._patches(one, c))
            for c in measures
            for one in shown
        ]

    def _patches(self, chart: Chart, column: Column) -> dict[str, Any]:
        patches = [chart.patches[name] for name in chart.ordered]
        expected = [_colour(scores, "-expected") for scores in patches]
        rows = [
            {
                "label": name,
                "mean": _number(_at(chart.scores.get(_key(column)), at)),
                "patches": [
                    {"measured": _colour(p, "", at), "value": _number(_at(p.get(_key(column)), at))} for p in patches
                ],
            }
            for at, name in enumerate(self.methods)
        ]
        names = [_words(name) for name in chart.ordered]
        return {"names": names, "expected": expected, "rows": rows, "metric": column.metric, "unit": title(column)}

    def distances(self) -> list[Choice]:
        """Return each score of charts over their distance, as plot and in numbers."""
        near_first = sorted((one for one in self.charts if one.distance is not None), key=lambda one: one.distance or 0)
        made = []
        for column in self._measures():
            key = _key(column)
            lines = []
            for at, (name, place) in enumerate(self.methods.items()):
                known = [one for one in near_first if _at(one.scores.get(key), at) is not None]
                words = [plots.text(f"{one.view} · {one.name}") for one in known]
                hover = f"%{{text}}<br>%{{x:.2f}} m, %{{y:.3g}} {column.unit}"
                values = [one.scores[key][at] for one in known]
                lines.append(plots.line(name, place, [one.distance for one in known], values, hover, text=words))
            x, y = {"title": {"text": "distance of the chart, m"}}, {"title": {"text": title(column)}}
            names = plots.legend(list(self.methods))
            figures = [plots.figure(lines, x, y | {"rangemode": "tozero"}, **names)] if near_first else []
            scored = [one for one in self.charts if key in one.scores]
            rows = [(one.view, one.name, one.distance, one.scores[key]) for one in scored]
            made.append(Choice(title(column), figures, {"rows": rows}))
        return made

    def hues(self) -> list[Choice]:
        """Return the hue of every patch over distance, for each kind of chart and way of measuring hue."""
        keys = dict.fromkeys(key for one in self.charts for patch in one.patches.values() for key in patch)
        hues = [key for key in keys if _role(key) == "patch-hue" and not key.endswith("-expected")]
        kinds: dict[tuple[str, ...], list[Chart]] = defaultdict(list)
        for one in sorted(self.charts, key=lambda one: one.distance or 0):
            if one.patches and one.distance is not None:
                kinds[tuple(one.ordered)].append(one)
        return [
            Choice(f"{key.partition(':')[2]}, {', '.join(dict.fromkeys(one.name for one in alike))}", figures)
            for key in hues
            for patches, alike in kinds.items()
            if (
                figures := [
                    self._hue(key, patch, alike) for patch in patches if any(key in c.patches[patch] for c in alike)
                ]
            )
        ]

    def _hue(self, key: str, patch: str, charts: Sequence[Chart]) -> plots.Figure:
        """The hue of one patch; hues stand within half a turn of the expected one."""
        scores = [one.patches[patch] for one in charts]
        expected = _first(value for own in scores for value in own.get(f"{key}-expected", []))
        colour = next((made for own in scores if (made := _colour(own, "-expected"))), "")
        lines = []
        for at, (name, place) in enumerate(self.methods.items()):
            known = [
                (one.distance, value) for one in charts if (value := _at(one.patches[patch].get(key), at)) is not None
            ]
            turned = [v if expected is None else expected + (v - expected + 180) % 360 - 180 for _, v in known]
            small = {"marker": plots.look(place) | {"size": 5}}
            lines.append(plots.line(name, place, [d for d, _ in known], turned, "%{x:.2f} m, %{y:.0f}°", **small))
        return plots.hue(_words(patch), colour, lines, expected)

    def _measures(self) -> list[Column]:
        return [
            c
            for c in self.columns
            if c.of == "chart" and c.directed and any(_key(c) in one.scores for one in self.charts)
        ]


def read_charts(rows: DataFrame, methods: Mapping[str, int], names: Mapping[tuple[str, str], str]) -> list[Chart]:
    """Return the charts of a dataset's rows. names: what the page calls each view, by scene and view."""
    at = {name: n for n, name in enumerate(methods)}
    ok = rows[(rows["status"] == "ok") & rows["method"].isin(at)]
    of_charts = ok[(ok["region"] != "image") & ~ok["region"].str.startswith("image/")]
    made: dict[tuple[str, str, str], Chart] = {}
    columns = ["scene", "view", "region", "metric", "variant", "method", "value"]
    for scene, view, region, metric, variant, method, value in of_charts[columns].itertuples(index=False, name=None):
        name, _, patch = region.partition("/")
        chart = made.setdefault((scene, view, name), Chart(names[scene, view], name))
        scores = chart.patches.setdefault(patch, {}) if patch else chart.scores
        finite = value if math.isfinite(value) else None
        scores.setdefault(f"{metric}:{variant}", [None] * len(at))[at[method]] = finite
    order = list(names)
    return [made[key] for key in sorted(made, key=lambda key: order.index(key[:2]))]


def _colour(scores: Scores, what: str, at: int | None = None) -> str:
    """A patch's colour as a style sheet has it: as measured in a method's picture, or "-expected" of it; else ""."""
    metric = next(iter(metrics_of("patch-colour")), "")
    rgb = [scores.get(f"{metric}:{channel}{what}", []) for channel in ("red", "green", "blue")]
    values = [_first(channel) if at is None else _at(channel, at) for channel in rgb]
    if any(value is None for value in values):
        return ""
    return "rgb({} {} {})".format(*(round(255 * float(value)) for value in values if value is not None))


def _role(key: str) -> str:
    return roles().get(key.partition(":")[0], "")


def _key(column: Column) -> str:
    return f"{column.metric}:{column.variant}"


def _first(values: Any) -> Any:
    return next((value for value in values if value is not None), None)


def _at(values: Sequence[Any] | None, at: int) -> Any:
    return values[at] if values else None


def _number(value: float | None) -> str:
    return "" if value is None else number(value)


def _place(patch: str) -> int:
    """The number of a patch, of "<number>-<name>"."""
    first = patch.partition("-")[0]
    return int(first) if first.isdecimal() else 0


def _words(patch: str) -> str:
    return patch.lstrip("0123456789").removeprefix("-").replace("-", " ")
