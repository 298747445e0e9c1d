"""The figures of fits: residuals and scaling of restorations by SUCRe, water (estimated water of all views)."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import EngFormatter, LogLocator
from scipy.stats import norm

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.compare.words import number
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, beside, scores_of
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults
from sucre_bench.results.layout import file_name
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import KEYS, restorations

# Of residuals: views drawn of each dataset and method; points, and colours of the model's curves, over distance; and
# how many standard deviations a histogram shows.
_VIEWS = 2
_POINTS = 12
_CURVES = 6
_REACH = 5
_MOMENTS = {
    "std": "std",
    "robust_std": "robust std",
    "skew": "skew",
    "kurtosis": "exc. kurtosis",
}

# Of scaling: what the table of times has of each restoration, and the panels' titles.
_STAGES = {"value": "whole restoration", "pair": "pairing", "solve": "solving"}

# The fewest points a line is drawn through, and the least ratio of their observations.
_FEWEST = 4
_SPREAD = 2.0
# Rounds of the fit: each error counts relative to the line's own time.
_ROUNDS = 10

# Of water: parameter, as variants begin with it; its name in a run's records, and as an axis says it.
_PARAMETERS = {
    "veiling_light": ("B", "veiling light $B$"),
    "attenuation": ("beta", "attenuation $\\beta$ (1/m)"),
    "backscatter": ("gamma", "backscatter $\\gamma$ (1/m)"),
}
_MARKERS = {"red": "o", "green": "s", "blue": "^"}
_VIEW = ["dataset", "scene", "view"]
_METHODS = 4


def residuals(results: StudyResults) -> Iterator[Drawn]:
    """Draw residuals of a least-squares fit, as in the appendices of the SUCRe paper: a figure for a restoration.

    From top to bottom: residuals, and the normal distribution of their mean and standard deviation; their quantiles
    over those of a normal distribution, and the line through the quartiles; residuals over fitted intensities, as a
    density with the running median and the range of the middle 68 %; points seen from many distances, and what the
    model makes of points of several colours. Red, green and blue stand side by side.

    All is drawn from what methods record as "residuals" (`sucre`, `sucre_plus` and `sucre_paper`). Of each
    dataset and method, the two views with most observations are drawn.
    """
    rows = (
        (_histogram, "residual, intensity", "density"),
        (_normal, "normal quantile", "residual, intensity"),
        (_fits, "fitted intensity", "residual, intensity"),
        (_distance, "distance, m", "intensity"),
    )
    is_drawn = False
    each = restorations(results.rows).groupby(["dataset", "method"], sort=False)
    for (dataset, method), of_method in each:
        records = [(row.view, read_record(row, results.out)) for row in of_method.itertuples()]
        recorded = [each for each in records if each[1].get("residuals", {}).get("tracks")]
        recorded.sort(key=lambda each: -each[1].get("n_observations", 0))
        for view, record in recorded[:_VIEWS]:
            is_drawn = True
            figure, axes = style.figure(2, 8.0, len(rows), len(style.CHANNELS))
            count = record["residuals"]["observations"]
            figure.suptitle(
                f"{view} of {dataset}, {method}: residuals of {count:,} observations"
            )
            for (draw, x, y), panels in zip(rows, axes, strict=True):
                channels = zip(panels, style.CHANNELS.values(), strict=True)
                for channel, (panel, colour) in enumerate(channels):
                    panel.set_xlabel(x)
                    panel.locator_params(axis="x", nbins=5)
                    draw(panel, record, channel, colour)
                panels[0].set_ylabel(y)
            for panel, name in zip(axes[0], style.CHANNELS, strict=True):
                panel.set_title(name)
            yield (file_name(f"{dataset}-{method}-{Path(view).stem}"),), figure
    if not is_drawn:
        raise NotApplicableError(
            "no record has residuals; run sucre, sucre_plus or sucre_paper with save=full"
        )


def _histogram(panel: Axes, record: Mapping[str, Any], channel: int, colour: str) -> None:
    left = record["residuals"]
    counts = np.array(left["histogram"]["counts"][channel])
    width = left["histogram"]["width"]
    edges = (np.arange(len(counts) + 1) - len(counts) / 2) * width
    total = counts.sum() + left["histogram"]["beyond"][channel]
    std = max(left["std"][channel], width / 10)
    panel.stairs(counts / (total * width), edges, fill=True, color=colour, alpha=0.5)
    at = np.linspace(-_REACH * std, _REACH * std, 201)
    panel.plot(at, norm.pdf(at, left["mean"][channel], std), "k--", linewidth=0.9)
    panel.set_xlim(float(at[0]), float(at[-1]))
    panel.set_ylim(top=1.5 * panel.get_ylim()[1])  # room for words
    words = [
        f"{name} {left[key][channel]:.3g}"
        for key, name in _MOMENTS.items()
        if left[key][channel] is not None
    ]
    where: Any = {"ha": "right", "va": "top", "fontsize": 5.5, "transform": panel.transAxes}
    panel.text(0.98, 0.98, "\n".join(words), **where)


def _normal(panel: Axes, record: Mapping[str, Any], channel: int, colour: str) -> None:
    normal = record["residuals"]["normal"]
    z = np.array(normal["z"])
    quantiles = np.array(normal["quantiles"][channel])
    low, high = np.interp((-0.6745, 0.6745), z, quantiles)
    panel.plot(z, (low + high) / 2 + z * (high - low) / 1.349, "k--", linewidth=0.9)
    panel.plot(z, quantiles, ".", color=colour, markersize=2.5)


def _fits(panel: Axes, record: Mapping[str, Any], channel: int, colour: str) -> None:
    of_channel = record["residuals"]["against_fit"][list(style.CHANNELS)[channel]]
    counts = np.array(of_channel["counts"], dtype=float).T
    lowest, highest = of_channel["residual"]
    first, last = of_channel["fit"]
    heights = np.linspace(lowest, highest, counts.shape[0] + 1)
    fits = np.linspace(first, last, counts.shape[1] + 1)
    shown = np.ma.masked_equal(counts, 0)
    panel.pcolormesh(fits, heights, shown, norm="log", cmap="Greys", rasterized=True)
    middle = (fits[:-1] + fits[1:]) / 2
    for name, line in (("low", "--"), ("median", "-"), ("high", "--")):
        panel.plot(middle, np.array(of_channel[name], dtype=float), line, color=colour)
    panel.axhline(0, color="k", linewidth=0.5)


def _distance(panel: Axes, record: Mapping[str, Any], channel: int, colour: str) -> None:
    """Points over distance, and dotted the image formation model (SUCRe, eq. 2)."""
    points = record["residuals"]["tracks"]
    chosen = [points[k] for k in evenly(len(points), _POINTS)]
    for point in chosen:
        drawn: Any = {"color": colour, "alpha": 0.5, "linewidth": 0.7, "markersize": 2}
        panel.plot(point["distance"], point["intensity"][channel], ".-", **drawn)
    distances = np.concatenate([point["distance"] for point in chosen])
    z = np.linspace(distances.min(), distances.max(), 100)
    B, beta, gamma = (record[name][channel] for name in ("B", "beta", "gamma"))
    colours = [point["J"][channel] for point in chosen]
    for J in np.linspace(min(colours), max(colours), _CURVES):
        panel.plot(z, J * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z)), "k:", linewidth=0.9)


def scaling(results: StudyResults) -> Iterator[Drawn]:
    """Draw time over observations (SUCRe, supplementary material, Processing time), whole, and by stage if recorded.

    Each point is a restoration. The lines are t = a + b n, found by least squares of the relative error, so that small
    and large n count alike. The legend has b, in seconds for a million observations, where it is twice its standard
    error. Axes are logarithmic, on which such a line bends towards a where n is small. Variants that share what they
    pair show the same points for pairing; reading files, and degrading what is read, is part of it.
    """
    counts = scores_of(results.rows, "observations")
    table = beside(restorations(results.rows), counts[counts["variant"] == "all"], "n", KEYS)
    table = table[table["n"] > 0]
    if table.empty:
        raise NotApplicableError(
            f"no restoration has a number of observations; {adding('observations')}"
        )
    stages = [
        read_record(row, results.out).get("stage_seconds", {}) for row in table.itertuples()
    ]
    for stage in ("pair", "solve"):
        table[stage] = [seconds.get(stage, np.nan) for seconds in stages]
    shown = {stage: title for stage, title in _STAGES.items() if table[stage].notna().any()}
    figure, axes = style.figure(2, 2.8, ncols=len(shown), sharey=True)
    for panel, (stage, title) in zip(axes[0], shown.items(), strict=True):
        for method, look in style.looks(table["method"]).items():
            of_method = table[(table["method"] == method) & (table[stage] > 0)]
            if of_method.empty:
                continue
            n = of_method["n"].to_numpy()
            seconds = of_method[stage].to_numpy()
            label = method
            if len(n) >= _FEWEST and n.max() > _SPREAD * n.min():
                expected = seconds
                for _ in range(_ROUNDS):
                    (b, a), covariance = np.polyfit(n, seconds, 1, w=1 / expected, cov=True)
                    expected = np.maximum(a + b * n, seconds.min())
                error = np.sqrt(covariance[0, 0])
                at = np.geomspace(n.min(), n.max(), 50)
                if b > 0:  # falling times have other causes than observations
                    panel.plot(at, a + b * at, color=look.colour, linewidth=0.9)
                if b > 2 * error:
                    label = f"{method}: {b * 1e6:.2g} ± {error * 1e6:.1g} s per million"
            panel.plot(
                n, seconds, look.marker, color=look.colour, markersize=3, alpha=0.7, label=label
            )
        panel.set(title=title, xlabel="observations", xscale="log", yscale="log")
        panel.xaxis.set_major_formatter(EngFormatter(sep=""))
        panel.xaxis.set_minor_formatter(EngFormatter(sep=""))
        panel.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        panel.legend(loc="upper left", bbox_to_anchor=(0, -0.22), borderaxespad=0)
    axes[0, 0].set_ylabel("seconds")
    yield (), figure


def water(results: StudyResults) -> Iterator[Drawn]:
    """Draw estimated water over the variance of distances (SUCRe, fig. "Distance map variance vs. parameters").

    A row a parameter, a column a method, at most four a figure; a dot a view and channel. Dashed is the true water
    where the run's records know it. On top, the scatter of each channel over the views: standard deviation by mean.
    Views of one water that disagree at the left and agree at the right are the paper's case. Needs metrics of the roles
    water-parameters and distance-variance. Yields a figure per dataset and page of methods.
    """
    estimates = scores_of(results.rows, "water-parameters")
    estimates = beside(
        estimates, scores_of(results.rows, "distance-variance"), "variance", _VIEW
    )
    if estimates.empty:
        remedy = f"{adding('water-parameters', 'distance-variance')}, with a method that estimates water, on images"
        raise NotApplicableError(
            f"no water beside a variance of distances; {remedy} with depth"
        )
    for name, of_dataset in style.each_dataset(estimates):
        for page, methods in style.pages(list(dict.fromkeys(of_dataset["method"])), _METHODS):
            figure, axes = style.figure(
                2, 4.8, len(_PARAMETERS), len(methods), sharex=True, sharey="row"
            )
            for column, method in zip(axes.T, methods, strict=True):
                of_method = of_dataset[of_dataset["method"] == method]
                first = of_method.drop_duplicates(["dataset", "scene"])
                records = [read_record(row, results.out) for row in first.itertuples()]
                true = [record.get("true_water") or {} for record in records]
                # Not of scenes that differ in it, nor where it explains other intensities than the estimate.
                fits = all(
                    t and t["encoding"] == r.get("encoding")
                    for t, r in zip(true, records, strict=True)
                )
                truth = true[0] if fits and all(t == true[0] for t in true) else {}
                for panel, (parameter, (symbol, _)) in zip(
                    column, _PARAMETERS.items(), strict=True
                ):
                    _parameter(panel, of_method, parameter, truth.get(symbol, ()))
                column[0].set_title(method)
            for row, (_, label) in zip(axes, _PARAMETERS.values(), strict=True):
                row[0].set_ylabel(label)
                low, high = row[0].get_ylim()
                row[0].set_ylim(low, high + 0.15 * (high - low))  # room for the numbers
            about = (
                "variance of the view's distances (m²); dashed: true water, where it is known"
            )
            style.caption(figure, about, axes[0, 0])
            yield (name, page), figure


def _parameter(
    panel: Axes, estimates: DataFrame, parameter: str, truth: Sequence[float]
) -> None:
    for place, (channel, marker) in enumerate(_MARKERS.items()):
        of_channel = estimates[estimates["variant"] == f"{parameter}-{channel}"]
        colour = style.CHANNELS[channel]
        dots: Any = {"color": colour, "marker": marker, "label": channel}
        panel.scatter(of_channel["variance"], of_channel["value"], s=9, linewidths=0, **dots)
        if truth:
            panel.axhline(truth[place], color=colour, linewidth=0.8, linestyle="--", zorder=0)
        if len(of_channel) > 1 and (mean := of_channel["value"].mean()):
            percent = number(round(100 * of_channel["value"].std() / abs(mean), 3))
            where: Any = {"ha": "center", "va": "top", "transform": panel.transAxes}
            panel.text(0.19 + 0.31 * place, 1, f"{percent} %", color=colour, **where)
