"""Residuals of a least-squares fit, as in the appendices of the SUCRe paper: four figures for a restoration.

histogram: residuals, and the normal distribution of their mean and standard deviation; normal: their quantiles over
those of a normal distribution, and the line through the quartiles; fits: residuals over fitted intensities, as a
density with the running median and the range of the middle 68 %; distance: points seen from many distances, and what
the model makes of points of several colours. Red, green and blue stand side by side.

All is drawn from what methods tell as "residuals" (`sucre` and `sucre_paper` with residuals=true). Of each dataset and
method, the two views with most observations are drawn.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure

from sucre_bench.arrays import Array, evenly
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results.layout import file_name
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import restorations

# Views drawn of each dataset and method; points, and colours of the model's curves, in the figure over distance.
_VIEWS, _POINTS, _CURVES = 2, 12, 6

# A histogram shows so many standard deviations.
_REACH = 5


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield the figures. NotApplicableError if no record has residuals."""
    done = restorations(results.rows)
    drawn = False
    for (_, method), those in done.groupby(["dataset", "method"], sort=False):
        tellers = [(row, read_record(row, results.out)) for row in those.itertuples()]
        tellers = [(row, known) for row, known in tellers if known.get("residuals", {}).get("tracks")]
        tellers.sort(key=lambda teller: -teller[1].get("n_observations", 0))
        for row, known in tellers[:_VIEWS]:
            drawn, named = True, file_name(f"{row.dataset}-{method}-{Path(row.view).stem}")
            title = f"{row.view} of {row.dataset}, {method}"
            for what, make in (
                ("histogram", _histogram),
                ("normal", _normal),
                ("fits", _fits),
                ("distance", _distance),
            ):
                yield f"{what}-{named}", make(known, title)
    if not drawn:
        raise NotApplicableError("no record has residuals; run sucre or sucre_paper with method.residuals=true")


def _panels(title: str, xlabel: str, ylabel: str, **subplots: Any) -> tuple[Figure, list[Axes]]:
    figure, axes = style.figure(columns=2, height=2.2, ncols=3, **subplots)
    figure.suptitle(title)
    for axis, name in zip(axes[0], style.CHANNELS, strict=True):
        axis.set_title(name)
        axis.set_xlabel(xlabel)
        axis.locator_params(axis="x", nbins=5)
    axes[0, 0].set_ylabel(ylabel)
    return figure, list(axes[0])


def _histogram(known: Mapping[str, Any], title: str) -> Figure:
    left = known["residuals"]
    told_of = f"{title}: residuals of {left['observations']:,} observations"
    figure, axes = _panels(told_of, "residual, intensity", "density")
    for c, (axis, colour) in enumerate(zip(axes, style.CHANNELS.values(), strict=True)):
        counts, width = np.array(left["histogram"]["counts"][c]), left["histogram"]["width"]
        edges = (np.arange(len(counts) + 1) - len(counts) / 2) * width
        total = counts.sum() + left["histogram"]["beyond"][c]
        mean, std = left["mean"][c], max(left["std"][c], width / 10)
        axis.stairs(counts / (total * width), edges, fill=True, color=colour, alpha=0.5)
        at = np.linspace(-_REACH * std, _REACH * std, 201)
        normal = np.exp(-(((at - mean) / std) ** 2) / 2) / (std * np.sqrt(2 * np.pi))
        axis.plot(at, normal, "k--", linewidth=0.9)
        axis.set_xlim(float(at[0]), float(at[-1]))
        axis.set_ylim(top=1.3 * axis.get_ylim()[1])  # room for words
        axis.text(0.98, 0.96, _moments(left, c), transform=axis.transAxes, ha="right", va="top", fontsize="small")
    return figure


def _moments(left: Mapping[str, Any], c: int) -> str:
    names = {"std": "std", "robust_std": "robust std", "skew": "skew", "kurtosis": "exc. kurtosis"}
    known = {label: left[name][c] for name, label in names.items() if left[name][c] is not None}
    return "\n".join(f"{label} {value:.3g}" for label, value in known.items())


def _normal(known: Mapping[str, Any], title: str) -> Figure:
    left = known["residuals"]
    figure, axes = _panels(f"{title}: normal plots", "normal quantile", "residual, intensity", sharey=True)
    z = np.array(left["normal"]["z"])
    for c, (axis, colour) in enumerate(zip(axes, style.CHANNELS.values(), strict=True)):
        quantiles = np.array(left["normal"]["quantiles"][c])
        low, high = np.interp((-0.6745, 0.6745), z, quantiles)
        axis.plot(z, (low + high) / 2 + z * (high - low) / 1.349, "k--", linewidth=0.9)
        axis.plot(z, quantiles, ".", color=colour, markersize=2.5)
    return figure


def _fits(known: Mapping[str, Any], title: str) -> Figure:
    left = known["residuals"]["against_fit"]
    figure, axes = _panels(f"{title}: residuals over fits", "fitted intensity", "residual, intensity")
    for axis, name in zip(axes, style.CHANNELS, strict=True):
        one = left[name]
        counts = np.array(one["counts"], dtype=float).T
        heights, fits = _edges(one["residual"], len(counts)), _edges(one["fit"], counts.shape[1])
        shown = np.ma.masked_equal(counts, 0)
        axis.pcolormesh(fits, heights, shown, norm=LogNorm(1, max(counts.max(), 2)), cmap="Greys", rasterized=True)
        middle = (fits[:-1] + fits[1:]) / 2
        low, median, high = (np.array(one[key], dtype=float) for key in ("low", "median", "high"))
        axis.plot(middle, median, color=style.CHANNELS[name])
        axis.plot(middle, low, middle, high, color=style.CHANNELS[name], linewidth=0.7, linestyle="--")
        axis.axhline(0, color="k", linewidth=0.5)
    return figure


def _edges(ends: Sequence[float], n: int) -> Array:
    return np.linspace(ends[0], ends[1], n + 1)


def _distance(known: Mapping[str, Any], title: str) -> Figure:
    points = known["residuals"]["tracks"]
    chosen = [points[k] for k in evenly(len(points), _POINTS)]
    figure, axes = _panels(f"{title}: points over distance, and the model (dotted)", "distance, m", "intensity")
    nearest, farthest = (pick(at for point in chosen for at in point["distance"]) for pick in (min, max))
    z = np.linspace(nearest, farthest, 100)
    for c, (axis, colour) in enumerate(zip(axes, style.CHANNELS.values(), strict=True)):
        for point in chosen:
            axis.plot(
                point["distance"], point["intensity"][c], ".-", color=colour, alpha=0.5, linewidth=0.7, markersize=2
            )
        J = np.array([point["J"][c] for point in chosen])
        for one in np.linspace(J.min(), J.max(), _CURVES):
            axis.plot(z, _intensity(known, c, one, z), "k:", linewidth=0.9)
    return figure


def _intensity(known: Mapping[str, Any], c: int, J: float, z: Array) -> Array:
    """The image formation model (SUCRe, eq. 2)."""
    B, beta, gamma = (known[name][c] for name in ("B", "beta", "gamma"))
    return np.asarray(J * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z)))
