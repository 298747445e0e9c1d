"""The patches of the nearest and the farthest colour chart, as each method shows them, with their CIEDE2000.

Each swatch is the measured colour above a strip of the expected one, of the sRGB list: numbers are those of the variant
srgb, if it was scored. Needs metrics of the roles patch-colour, colour-difference and chart-distance.
"""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, roles
from sucre_bench.reports.paper.figures import Drawn, style
from sucre_bench.reports.paper.figures.charts import seen_charts
from sucre_bench.reports.paper.study_results import StudyResults

_CHANNELS = ["red", "green", "blue"]
_PATCHES = 18  # no more are wide enough for their number
_CHART = ["scene", "view", "chart"]


def draw(results: StudyResults) -> Drawn:
    """Yield a figure per dataset, or why there is none of it."""
    charts = seen_charts(results.rows)
    role = charts["metric"].map(roles())
    if not {"patch-colour", "colour-difference"} <= set(role):
        remedy = adding("patch-colour", "colour-difference", "chart-distance")
        raise NotApplicableError(f"no colours of chart patches; {remedy}")
    charts = charts.assign(role=role)[role.isin(("patch-colour", "colour-difference"))]
    for name, of_dataset in style.each_dataset(charts):
        try:
            yield name, _swatches(of_dataset)
        except NotApplicableError as reason:
            yield name, reason


def _swatches(charts: DataFrame) -> Figure:
    methods = list(dict.fromkeys(charts["method"]))
    nearest, farthest = _ends(charts, methods)
    variants = list(dict.fromkeys(charts.loc[charts["role"] == "colour-difference", "variant"]))
    variant = "srgb" if "srgb" in variants else variants[0]
    figure, axes = style.figure(2, 1.0 + 0.2 * len(methods), 1, 2)
    for panel, place in zip(axes[0], (nearest, farthest), strict=True):
        of_chart = charts[(charts[_CHART] == list(place)).all(axis=1)]
        _panel(panel, of_chart, methods, variant)
        panel.set_title(f"{place[2]}, {of_chart['distance'].iloc[0]:.1f} m", fontsize=7)
    axes[0, 0].set_yticks(range(len(methods)), methods)
    caption = f"measured, above a strip of what is expected, and $\\Delta E_{{00}}$ to the {variant} list"
    figure.supxlabel(caption, fontsize=7)
    return figure


def _ends(charts: DataFrame, methods: list[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The nearest and the farthest chart that all methods show, of one kind: with the same patches."""
    scored = charts[(charts["role"] == "colour-difference") & charts["region"].str.contains("/", regex=False)]
    of = scored.groupby(_CHART).agg(
        distance=("distance", "first"),
        methods=("method", "nunique"),
        kind=("region", lambda names: "|".join(sorted({name.partition("/")[2] for name in names}))),
    )
    shown = of[of["methods"] == len(methods)]
    if shown.empty:
        raise NotApplicableError("no colour chart that every method shows; leave out the methods with holes")
    shown = shown[shown["kind"] == shown["kind"].mode()[0]].sort_values("distance", kind="stable")
    return shown.index[0], shown.index[-1]


def _panel(axes: Axes, chart: DataFrame, methods: list[str], variant: str) -> None:
    """One chart: a line a method, a column a patch."""
    errors = chart[(chart["role"] == "colour-difference") & chart["region"].str.contains("/", regex=False)]
    errors = errors[errors["variant"] == variant].set_index(["method", "region"])["value"]
    colours = chart[chart["role"] == "patch-colour"].set_index(["method", "region", "variant"])["value"]
    patches = sorted({region for _, region in errors.index}, key=_number)
    patches = [patches[k] for k in evenly(len(patches), _PATCHES)]
    for y, method in enumerate(methods):
        for x, patch in enumerate(patches):
            if (method, patch) not in errors.index or (method, patch, "red") not in colours.index:
                continue
            measured, expected = (
                np.array([colours[method, patch, channel + end] for channel in _CHANNELS]) for end in ("", "-expected")
            )
            _swatch(axes, (x, y), measured, expected, float(errors[method, patch]))
    axes.set(xlim=(-0.5, len(patches) - 0.5), ylim=(len(methods) - 0.5, -0.5))
    names = [patch.partition("/")[2].partition("-")[2] for patch in patches]
    axes.set_xticks(range(len(patches)), names, rotation=90)
    axes.set_yticks([])
    axes.tick_params(length=0)
    axes.spines[:].set_visible(False)


def _swatch(axes: Axes, at: tuple[int, int], measured: Any, expected: Any, error: float) -> None:
    x, y = at
    axes.add_patch(Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=measured, linewidth=0))
    axes.add_patch(Rectangle((x - 0.48, y + 0.2), 0.96, 0.26, facecolor=expected, linewidth=0))
    ink = "black" if measured @ [0.299, 0.587, 0.114] > 0.5 else "white"
    axes.text(x, y - 0.13, f"{error:.0f}", color=ink, ha="center", va="center", fontsize=7)


def _number(patch: str) -> int:
    """The number of a patch, of its region "<chart>/<number>-<name>"."""
    return int(patch.rpartition("/")[2].partition("-")[0])
