"""The figures over distance, of colour charts: charts, swatches and hue.

A dot is the mean over charts that are about equally far, at most eight such places.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MultipleLocator

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.chart_kinds import read_label
from sucre_bench.plugins.plugin import Role
from sucre_bench.reports.metric_roles import (
    adding,
    beside,
    metrics_of,
    roles,
    scores_of,
    symbol,
)
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults
from sucre_bench.results.layout import file_name

_ERRORS: tuple[Role, ...] = ("chart-error", "colour-difference")
_PAINTED: tuple[Role, ...] = ("patch-colour", "colour-difference")
_CHART = ["dataset", "scene", "view", "chart"]
_PLACES = 8
_SWATCHES = 18  # no more are wide enough for their number
_HUES = 24  # panels of a figure


def charts(results: StudyResults) -> Iterator[Drawn]:
    """Draw the errors of charts over their distance (SUCRe, fig. "Chart psi-bar error vs. distance").

    The bar behind a dot reaches one standard deviation of its charts' patches to either side. Needs metrics of the
    roles chart-distance, and chart-error or colour-difference. Yields a figure per dataset, a panel per error and
    variant, of those that the study names if it names any.
    """
    seen = _seen_charts(results.rows)
    seen = seen[seen["metric"].isin(metrics_of(*_ERRORS))]
    full = seen["metric"] + ":" + seen["variant"]
    named = seen["metric"].isin(results.study.metrics) | full.isin(results.study.metrics)
    seen = seen[named] if named.any() else seen
    if seen.empty:
        raise NotApplicableError(
            f"no errors of colour charts; {adding(*_ERRORS, 'chart-distance')}"
        )
    for name, of_dataset in style.each_dataset(seen):
        placed = _with_places(of_dataset)
        measures = placed.groupby(["metric", "variant"], sort=False)
        figure, panels = style.grid(len(measures), 2, 0.5, 2.3, sharex=True)
        looks = style.looks(placed["method"])
        step = 0.004 * np.ptp(placed["place"])  # beside each other, that bars do not hide bars
        for ((metric, variant), of_measure), panel in zip(measures, panels, strict=True):
            is_patch = of_measure["patch"] != ""
            of_patches = of_measure[is_patch].groupby(["method", "place"])["value"]
            of_charts = of_measure[~is_patch].groupby(["method", "place"])["value"]
            table = pd.DataFrame({"mean": of_charts.mean(), "spread": of_patches.std()})
            for n, (method, (colour, marker)) in enumerate(looks.items()):
                if method not in table.index:
                    continue
                of_method = table.loc[method]
                x = of_method.index + step * (n - (len(looks) - 1) / 2)
                y = of_method["mean"]
                panel.plot(x, y, color=colour, marker=marker, label=method, markersize=3)
                bars: Any = {"ecolor": colour, "alpha": 0.3, "elinewidth": 0.7, "zorder": 1}
                panel.errorbar(x, y, of_method["spread"], fmt="none", **bars)
            several = placed.loc[placed["metric"] == metric, "variant"].nunique() > 1
            label = symbol(str(metric), of_measure["unit"].iloc[0])
            panel.set_ylabel(f"{label}, {variant}" if several else label)
            panel.set_ylim(bottom=0)
            panel.grid(axis="y")
        about = "distance of the chart (m); bars: standard deviation over its patches"
        style.caption(figure, about, panels[0])
        yield (name,), figure


def _seen_charts(rows: DataFrame) -> DataFrame:
    """The scores of charts and patches, with the columns chart, patch ("" for the chart), and distance in metres.

    Raises NotApplicableError where no chart has a distance.
    """
    scores = scores_of(rows)
    parts = scores["region"].str.partition("/")
    scores = scores.assign(chart=parts[0], patch=parts[2])
    seen = beside(scores, scores_of(scores, "chart-distance"), "distance", _CHART)
    if seen.empty:
        remedy = f"{adding('chart-distance')}, on images with charts and depth"
        raise NotApplicableError(f"no colour chart at a known distance; {remedy}")
    return seen


def _with_places(seen: DataFrame) -> DataFrame:
    """Add the column place: the mean distance of the charts that are about as far, equally many at each place."""
    sites = seen.drop_duplicates(_CHART)
    places = pd.qcut(sites["distance"].rank(method="first"), min(_PLACES, len(sites)))
    means = sites["distance"].groupby(places, observed=True).transform("mean")
    return seen.merge(sites[_CHART].assign(place=means), on=_CHART)


def swatches(results: StudyResults) -> Iterator[Drawn]:
    """Paint the patches of the nearest and the farthest colour chart, as each method shows them, with their CIEDE2000.

    Each swatch is the measured colour above a strip of the expected one, of the sRGB list. Numbers are those of the
    variant srgb, if it was scored. Needs metrics of the roles patch-colour, colour-difference and chart-distance.
    Yields a figure per dataset, or why there is none of it.
    """
    seen = _seen_charts(results.rows)
    seen = seen.assign(role=seen["metric"].map(roles()))
    if not {*_PAINTED} <= set(seen["role"]):
        raise NotApplicableError(
            f"no colours of chart patches; {adding(*_PAINTED, 'chart-distance')}"
        )
    for name, of_dataset in style.each_dataset(seen[seen["role"].isin(_PAINTED)]):
        methods = list(dict.fromkeys(of_dataset["method"]))
        of_patches = of_dataset[of_dataset["patch"] != ""]
        errors = of_patches[of_patches["role"] == "colour-difference"]
        # Charts that all methods show, of one kind: with the same patches.
        shown = errors.groupby(_CHART).agg(
            distance=("distance", "first"),
            methods=("method", "nunique"),
            kind=("patch", lambda names: "|".join(sorted(set(names)))),
        )
        shown = shown[shown["methods"] == len(methods)]
        if shown.empty:
            reason = "no colour chart that every method shows; leave out the methods with holes"
            yield (name,), NotApplicableError(reason)
            continue
        shown = shown[shown["kind"] == shown["kind"].mode()[0]]
        shown = shown.sort_values("distance", kind="stable")
        variants = list(dict.fromkeys(errors["variant"]))
        variant = "srgb" if "srgb" in variants else variants[0]
        figure, axes = style.figure(2, 1.0 + 0.2 * len(methods), 1, 2)
        for panel, chart in zip(axes[0], (shown.index[0], shown.index[-1]), strict=True):
            of_chart = of_patches[(of_patches[_CHART] == list(chart)).all(axis=1)]
            _paint(panel, methods, of_chart, variant)
            panel.set_title(f"{chart[-1]}, {shown.loc[chart, 'distance']:.1f} m")
        axes[0, 0].set_yticks(range(len(methods)), methods)
        figure.supxlabel(
            f"measured, above a strip of what is expected, and $\\Delta E_{{00}}$ to the {variant} list"
        )
        yield (name,), figure


def _paint(panel: Axes, methods: Sequence[str], scores: DataFrame, variant: str) -> None:
    """One chart: a line a method, a column a patch. scores: of its patches; variant: of the colour difference."""
    value = scores.set_index(["method", "patch", "variant"])["value"].to_dict()
    scored = scores.loc[scores["variant"] == variant, "patch"]
    patches = sorted(set(scored), key=read_label)
    patches = [patches[k] for k in evenly(len(patches), _SWATCHES)]
    for y, method in enumerate(methods):
        for x, patch in enumerate(patches):
            error = value.get((method, patch, variant))
            rgb = [value.get((method, patch, channel)) for channel in style.CHANNELS]
            if error is None or None in rgb:
                continue
            expected = [
                value[method, patch, f"{channel}-expected"] for channel in style.CHANNELS
            ]
            swatch = Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=rgb, linewidth=0)
            strip = Rectangle((x - 0.48, y + 0.2), 0.96, 0.26, facecolor=expected, linewidth=0)
            panel.add_patch(swatch)
            panel.add_patch(strip)
            ink = "black" if np.dot(rgb, (0.299, 0.587, 0.114)) > 0.5 else "white"
            panel.text(x, y - 0.13, f"{error:.0f}", color=ink, ha="center", va="center")
    names = [read_label(patch)[1] for patch in patches]
    panel.set(xlim=(-0.5, len(patches) - 0.5), ylim=(len(methods) - 0.5, -0.5))
    panel.set_xticks(range(len(patches)), names, rotation=90)
    panel.set_yticks([])
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)


def hue(results: StudyResults) -> Iterator[Drawn]:
    """Draw the hue of each patch over the chart's distance (SUCRe, fig. "Hue vs. distance" and its appendix).

    A panel a patch, half a turn up and down from the hue expected there, the gray line. A dot is a circular mean.
    Needs metrics of the roles patch-hue and chart-distance.
    Yields a figure per dataset, set of patches and variant of hue.
    """
    hues = scores_of(_seen_charts(results.rows), "patch-hue")
    forms = [
        v for v in dict.fromkeys(hues["variant"]) if f"{v}-expected" in set(hues["variant"])
    ]
    if not forms:
        raise NotApplicableError(
            f"no hues of chart patches; {adding('patch-hue', 'chart-distance')}"
        )
    for name, of_dataset in style.each_dataset(hues):
        # Charts with the same patches share panels.
        kinds = of_dataset["chart"].map(of_dataset.groupby("chart")["patch"].agg(frozenset))
        for kind in dict.fromkeys(kinds):
            of_kind = _with_places(of_dataset[kinds == kind])
            first = file_name(of_kind["chart"].iloc[0]) if kinds.nunique() > 1 else ""
            for form in forms:
                for page, patches in style.pages(sorted(kind, key=read_label), _HUES):
                    words = (name, first, form if len(forms) > 1 else "", page)
                    yield words, _hues(of_kind, form, patches)


def _hues(hues: DataFrame, form: str, patches: Sequence[str]) -> Figure:
    figure, panels = style.grid(len(patches), 4, 0.6, 1.25, sharex=True)
    for patch, panel in zip(patches, panels, strict=True):
        of_patch = hues[hues["patch"] == patch]
        expected = of_patch.loc[of_patch["variant"] == f"{form}-expected", "value"].iloc[0]
        panel.axhline(expected, color="#999999", linewidth=2.5, zorder=0)
        measured = of_patch[of_patch["variant"] == form]
        vectors = np.exp(1j * np.radians(measured["value"] - expected))
        means = vectors.groupby([measured["method"], measured["place"]]).mean()
        for method, (colour, marker) in style.looks(hues["method"]).items():
            if method in means.index:
                of_method = means.loc[method]
                y = expected + np.degrees(np.angle(of_method))
                look: Any = {"color": colour, "marker": marker, "markersize": 2.5}
                panel.plot(of_method.index, y, linewidth=0.9, label=method, **look)
        panel.set_ylim(expected - 180, expected + 180)
        panel.yaxis.set_major_locator(MultipleLocator(90))
        panel.yaxis.set_major_formatter(lambda hue, _: f"{hue % 360:.0f}")
        panel.set_title(read_label(patch)[1])
    figure.supylabel(f"hue ({form}, °)")
    style.caption(figure, "distance of the chart (m)", panels[0])
    return figure
