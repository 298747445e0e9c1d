"""The errors of colour charts against their distance (SUCRe, fig. "Chart psi-bar error vs. distance").

A dot is the mean over charts that are about equally far, at most eight such places; the bar behind it reaches one
standard deviation of their patches to either side. Needs metrics of the roles chart-distance, and
chart-error or colour-difference.
"""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from sucre_bench.arrays import DataFrame
from sucre_bench.errors import NotApplicableError
from sucre_bench.plugins.plugin import Role
from sucre_bench.reports.metric_roles import adding, metrics_of, symbol
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults

_ERRORS: tuple[Role, ...] = ("chart-error", "colour-difference")
_CHART = ["dataset", "scene", "view", "chart"]
PLACES = 8


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset, a panel per error and variant, of those that the study names if it names any."""
    charts = seen_charts(results.rows)
    charts = charts[charts["metric"].isin(metrics_of(*_ERRORS))]
    full = charts["metric"] + ":" + charts["variant"]
    named = charts["metric"].isin(results.study.metrics) | full.isin(results.study.metrics)
    charts = charts[named] if named.any() else charts
    if charts.empty:
        raise NotApplicableError(f"no errors of colour charts; {adding(*_ERRORS, 'chart-distance')}")
    for name, of_dataset in style.each_dataset(charts):
        yield name, _against_distance(with_places(of_dataset))


def seen_charts(rows: DataFrame) -> DataFrame:
    """Return the scores of charts and patches, with the columns chart, and distance in metres.

    Raises NotApplicableError where no chart has a distance.
    """
    ok = rows[(rows["status"] == "ok") & rows["value"].notna()]
    ok = ok.assign(chart=ok["region"].str.split("/").str[0])
    distances = (
        ok[ok["metric"].isin(metrics_of("chart-distance"))]
        .drop_duplicates(_CHART)
        .rename(columns={"value": "distance"})
    )
    if distances.empty:
        remedy = f"{adding('chart-distance')}, on images with charts and depth"
        raise NotApplicableError(f"no colour chart at a known distance; {remedy}")
    return ok.merge(distances[[*_CHART, "distance"]], on=_CHART)


def with_places(charts: DataFrame) -> DataFrame:
    """Add the column place: the mean distance of the charts that are about as far, equally many at each place."""
    sites = charts.drop_duplicates(_CHART)["distance"].to_numpy()
    n = min(PLACES, len(sites))
    edges = np.quantile(sites, np.arange(1, n) / n)  # of as many charts as places, each is one
    middles = np.array([sites[np.searchsorted(edges, sites, "right") == k].mean() for k in range(n)])
    return charts.assign(place=middles[np.searchsorted(edges, charts["distance"], "right")])


def _against_distance(charts: DataFrame) -> Figure:
    panels = list(dict.fromkeys(zip(charts["metric"], charts["variant"], strict=True)))
    looks = style.looks(charts["method"])
    width = min(len(panels), 2)
    figure, axes = style.grid(len(panels), width, 0.5, 2.3, sharex=True)
    step = 0.004 * np.ptp(charts["place"])  # beside each other, that bars do not hide bars
    for place, ((metric, variant), panel) in enumerate(zip(panels, axes.flat, strict=False)):
        scores = charts[(charts["metric"] == metric) & (charts["variant"] == variant)]
        is_patch = scores["region"].str.contains("/", regex=False)
        whole, patches = scores[~is_patch], scores[is_patch]
        for k, (method, look) in enumerate(looks.items()):
            means = whole[whole["method"] == method].groupby("place")["value"].mean()
            spread = patches[patches["method"] == method].groupby("place")["value"].std().reindex(means.index)
            x = means.index + step * (k - (len(looks) - 1) / 2)
            panel.errorbar(x, means, spread, fmt="none", ecolor=look.colour, alpha=0.3, elinewidth=0.7, zorder=1)
            panel.plot(x, means, color=look.colour, marker=look.marker, label=method, markersize=3)
        several = sum(metric == other for other, _ in panels) > 1
        panel.set(ylabel=f"{symbol(metric, str(scores['unit'].iloc[0]))}{f', {variant}' if several else ''}")
        panel.set_ylim(bottom=0)
        panel.tick_params(labelbottom=place + width >= len(panels))
        panel.grid(axis="y")
    figure.supxlabel("distance of the chart (m); bars: standard deviation over its patches", fontsize=7)
    style.legend_above(figure, axes[0, 0], 5 if width == 2 else 3)
    return figure
