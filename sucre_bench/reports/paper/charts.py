"""The figures over distance, of colour charts: charts, swatches and hue.

A dot is the mean over charts that are about equally far, at most eight such places.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

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
        methods = list(dict.fromkeys(of_dataset["method"]))
        step = 0.004 * np.ptp(placed["place"])  # beside each other, that bars do not hide bars
        shift = placed["method"].map(methods.index) - (len(methods) - 1) / 2
        is_patch = placed["region"].str.contains("/", regex=False)
        placed = placed.assign(place=placed["place"] + step * shift)
        about = "distance of the chart (m); bars: standard deviation over its patches"
        yield (name,), _over_places(placed[~is_patch], about, placed[is_patch])


def _over_places(scores: DataFrame, below: str, patches: DataFrame | None = None) -> Figure:
    """A panel a metric and variant, a line a method: its mean score at each place, and the spread of patches."""
    measures = list(dict.fromkeys(zip(scores["metric"], scores["variant"], strict=True)))
    figure, panels = style.grid(len(measures), 2, 0.5, 2.3, sharex=True)
    for (metric, variant), panel in zip(measures, panels, strict=True):
        for method, (colour, marker) in style.looks(scores["method"]).items():
            key = (metric, variant, method)
            means = _at_places(scores, *key).mean()
            panel.plot(
                means.index, means, color=colour, marker=marker, label=method, markersize=3
            )
            if patches is not None:
                spread = _at_places(patches, *key).std().reindex(means.index)
                bars: Any = {"ecolor": colour, "alpha": 0.3, "elinewidth": 0.7, "zorder": 1}
                panel.errorbar(means.index, means, spread, fmt="none", **bars)
        unit = scores.loc[scores["metric"] == metric, "unit"].iloc[0]
        several = sum(metric == other for other, _ in measures) > 1
        panel.set_ylabel(f"{symbol(metric, unit)}{f', {variant}' if several else ''}")
        panel.set_ylim(bottom=0)
        panel.grid(axis="y")
    style.caption(figure, below, panels[0])
    return figure


def _at_places(scores: DataFrame, metric: str, variant: str, method: str) -> Any:
    """The values of one measure and method, grouped by place."""
    chosen = (
        (scores["metric"] == metric)
        & (scores["variant"] == variant)
        & (scores["method"] == method)
    )
    return scores[chosen].groupby("place")["value"]


def _seen_charts(rows: DataFrame) -> DataFrame:
    """The scores of charts and patches, with the columns chart, and distance in metres.

    Raises NotApplicableError where no chart has a distance.
    """
    scores = scores_of(rows)
    scores = scores.assign(chart=scores["region"].str.split("/").str[0])
    seen = beside(scores, scores_of(scores, "chart-distance"), "distance", _CHART)
    if seen.empty:
        remedy = f"{adding('chart-distance')}, on images with charts and depth"
        raise NotApplicableError(f"no colour chart at a known distance; {remedy}")
    return seen


def _with_places(seen: DataFrame) -> DataFrame:
    """Add the column place: the mean distance of the charts that are about as far, equally many at each place."""
    sites = seen.drop_duplicates(_CHART)["distance"].to_numpy()
    n = min(_PLACES, len(sites))
    edges = np.quantile(sites, np.arange(1, n) / n)  # of as many charts as places, each is one
    middles = np.array(
        [sites[np.searchsorted(edges, sites, "right") == k].mean() for k in range(n)]
    )
    return seen.assign(place=middles[np.searchsorted(edges, seen["distance"], "right")])


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
        is_patch = of_dataset["region"].str.contains("/", regex=False)
        errors = of_dataset[(of_dataset["role"] == "colour-difference") & is_patch]
        # Charts that all methods show, of one kind: with the same patches.
        shown = errors.groupby(_CHART).agg(
            distance=("distance", "first"),
            methods=("method", "nunique"),
            kind=(
                "region",
                lambda names: "|".join(sorted({name.partition("/")[2] for name in names})),
            ),
        )
        shown = shown[shown["methods"] == len(methods)]
        if shown.empty:
            reason = "no colour chart that every method shows; leave out the methods with holes"
            yield (name,), NotApplicableError(reason)
            continue
        shown = shown[shown["kind"] == shown["kind"].mode()[0]].sort_values(
            "distance", kind="stable"
        )
        variants = list(dict.fromkeys(errors["variant"]))
        variant = "srgb" if "srgb" in variants else variants[0]
        of_variant = errors[errors["variant"] == variant]
        colours = of_dataset[of_dataset["role"] == "patch-colour"]
        figure, axes = style.figure(2, 1.0 + 0.2 * len(methods), 1, 2)
        for panel, chart in zip(axes[0], (shown.index[0], shown.index[-1]), strict=True):
            of_chart = [
                table[(table[_CHART] == list(chart)).all(axis=1)]
                for table in (of_variant, colours)
            ]
            _paint(panel, methods, *of_chart)
            panel.set_title(f"{chart[-1]}, {shown.loc[chart, 'distance']:.1f} m")
        axes[0, 0].set_yticks(range(len(methods)), methods)
        figure.supxlabel(
            f"measured, above a strip of what is expected, and $\\Delta E_{{00}}$ to the {variant} list"
        )
        yield (name,), figure


def _paint(panel: Axes, methods: Sequence[str], errors: DataFrame, colours: DataFrame) -> None:
    """One chart: a line a method, a column a patch. errors, colours: scores of its patches."""
    error_of = errors.set_index(["method", "region"])["value"]
    value_of = colours.set_index(["method", "region", "variant"])["value"]
    patches = sorted(
        set(errors["region"]), key=lambda region: read_label(region.rpartition("/")[2])[0]
    )
    patches = [patches[k] for k in evenly(len(patches), _SWATCHES)]
    for y, method in enumerate(methods):
        for x, patch in enumerate(patches):
            if (method, patch) not in error_of.index or (
                method,
                patch,
                "red",
            ) not in value_of.index:
                continue
            rgb, expected = (
                [value_of[method, patch, channel + end] for channel in style.CHANNELS]
                for end in ("", "-expected")
            )
            panel.add_patch(
                Rectangle((x - 0.48, y - 0.46), 0.96, 0.92, facecolor=rgb, linewidth=0)
            )
            panel.add_patch(
                Rectangle((x - 0.48, y + 0.2), 0.96, 0.26, facecolor=expected, linewidth=0)
            )
            ink = "black" if np.dot(rgb, (0.299, 0.587, 0.114)) > 0.5 else "white"
            panel.text(
                x,
                y - 0.13,
                f"{error_of[method, patch]:.0f}",
                color=ink,
                ha="center",
                va="center",
            )
    panel.set(xlim=(-0.5, len(patches) - 0.5), ylim=(len(methods) - 0.5, -0.5))
    panel.set_xticks(
        range(len(patches)),
        [read_label(patch.rpartition("/")[2])[1] for patch in patches],
        rotation=90,
    )
    panel.set_yticks([])
    panel.tick_params(length=0)
    panel.spines[:].set_visible(False)


def hue(results: StudyResults) -> Iterator[Drawn]:
    """Draw the hue of each patch over the chart's distance (SUCRe, fig. "Hue vs. distance" and its appendix).

    A panel a patch, half a turn up and down from the hue expected there, the gray line. A dot is a circular mean; a
    line that leaves through the top comes back from below. Needs metrics of the roles patch-hue and chart-distance.
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
    hues = hues.assign(patch=hues["region"].str.partition("/")[2])
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
        expected = hues.loc[
            (hues["patch"] == patch) & (hues["variant"] == f"{form}-expected"), "value"
        ].iloc[0]
        panel.axhline(expected, color="#999999", linewidth=2.5, zorder=0)
        for method, (colour, marker) in style.looks(hues["method"]).items():
            of_patch = hues[
                (hues["patch"] == patch)
                & (hues["variant"] == form)
                & (hues["method"] == method)
            ]
            vectors = (
                np.exp(1j * np.radians(of_patch["value"] - expected))
                .groupby(of_patch["place"])
                .mean()
            )
            unbroken = np.unwrap(np.degrees(np.angle(vectors)), period=360)  # of circular means
            for turn in range(-_PLACES // 2, _PLACES // 2 + 1):
                # what leaves through one edge comes back at the other
                y = unbroken + 360 * turn
                if turn == 0 or (np.abs(y) <= 180).any():
                    drawn: Any = {
                        "color": colour,
                        "marker": marker,
                        "label": method if turn == 0 else "_again",
                    }
                    panel.plot(
                        vectors.index, expected + y, markersize=2.5, linewidth=0.9, **drawn
                    )
        panel.set_ylim(expected - 180, expected + 180)
        ticks = np.arange(np.ceil((expected - 180) / 90), (expected + 180) / 90 + 1e-9) * 90
        panel.set_yticks(ticks, [f"{tick % 360:.0f}" for tick in ticks])
        panel.set_title(read_label(patch)[1])
    figure.supylabel(f"hue ({form}, °)")
    style.caption(figure, "distance of the chart (m)", panels[0])
    return figure
