"""Time against observations (SUCRe, supplementary material, Processing time): whole, and by stage where methods tell.

Each point is a restoration. The lines are t = a + b n, found by least squares of the relative error, so that small and
large n count alike; the legend has b, in seconds for a million observations, where it is twice its standard error.
Axes are logarithmic, on which such a line bends towards a where n is small. Variants that share what they pair show the
same points for pairing; reading files, and degrading what is read, is part of it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, LogLocator

from sucre_bench.arrays import Array, DataFrame
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, metrics_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import restorations

# What `times` has of each restoration, and the panels' titles.
_STAGES = {"seconds": "whole restoration", "pair": "pairing", "solve": "solving"}

# The fewest points a line is drawn through, and the least ratio of their observations.
_FEWEST, _SPREAD = 4, 2.0

# Rounds of the fit, and the least time that a line may give, in seconds.
_ROUNDS, _LEAST_S = 10, 1e-4
_LABELLED = 50  # greatest over least number up to which the axis has 2 and 5 beside powers of ten


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield the figure. NotApplicableError if no restoration has a number of observations."""
    table = times(results.rows, results.out)
    if table.empty:
        raise NotApplicableError(f"no restoration has a number of observations; {adding('observations')}")
    few = table["n"].max() < _LABELLED * table["n"].min()
    stages = [stage for stage in _STAGES if table[stage].notna().any()]
    height = 2.8 if len(stages) > 1 else 2.6
    figure, axes = style.figure(columns=2, height=height, ncols=len(stages), sharey=True)
    looks = style.looks(table["method"])
    for axis, stage in zip(axes[0], stages, strict=True):
        for method, those in table.dropna(subset=[stage]).groupby("method", sort=False):
            _series(axis, str(method), those["n"].to_numpy(), those[stage].to_numpy(), looks[str(method)])
        axis.set(title=_STAGES[stage], xlabel="observations", xscale="log", yscale="log")
        axis.xaxis.set_major_formatter(EngFormatter(sep=""))
        axis.xaxis.set_minor_locator(LogLocator(subs=(2, 5)))
        axis.xaxis.set_minor_formatter(EngFormatter(sep="") if few else "")
        axis.legend(loc="upper left", bbox_to_anchor=(0, -0.22), borderaxespad=0)
    axes[0, 0].set_ylabel("seconds")
    yield "", figure


def times(rows: DataFrame, out: Path) -> DataFrame:
    """Return a line a restoration: method, n observations, seconds, and of these pair and solve, NaN if unknown."""
    import pandas as pd

    counts = rows[
        rows["metric"].isin(metrics_of("observations")) & (rows["variant"] == "all") & (rows["status"] == "ok")
    ]
    key = ["dataset", "scene", "view", "method"]
    n = {tuple(getattr(row, name) for name in key): row.value for row in counts.itertuples()}
    lines = []
    for row in restorations(rows).itertuples():
        count = n.get(tuple(getattr(row, name) for name in key))
        if count:
            stages = read_record(row, out).get("stage_seconds", {})
            took = {stage: float(stages.get(stage, np.nan)) for stage in ("pair", "solve")}
            lines.append({"method": row.method, "n": count, "seconds": row.value, **took})
    return pd.DataFrame(lines, columns=["method", "n", *_STAGES])


def line(n: Array, seconds: Array) -> tuple[float, float, float]:
    """Return a and b of t = a + b n, in seconds and seconds an observation, and the standard error of b.

    Least squares, each error relative to the line's own time, in a few rounds; a is not below 0.
    """
    columns = np.stack([np.ones(len(n)), n], axis=1)
    (a, b), left, inverse = _fitted(columns, seconds)
    if a < 0:
        (b,), left, inverse = _fitted(columns[:, 1:], seconds)
        a = 0.0
    variance = float(left @ left) / max(len(n) - len(inverse), 1)
    return float(a), float(b), float(np.sqrt(variance * inverse[-1, -1]))


def _fitted(columns: Array, seconds: Array) -> tuple[Array, Array, Array]:
    """Coefficients, what is left relative to the fit, and the inverse of the normal equations."""
    expected = seconds
    for _ in range(_ROUNDS):
        scaled = columns / expected[:, None]
        inverse = np.linalg.inv(scaled.T @ scaled)
        coefficients = inverse @ scaled.T @ (seconds / expected)
        left = seconds / expected - scaled @ coefficients
        expected = np.maximum(columns @ coefficients, _LEAST_S)
    return coefficients, left, inverse


def _series(axis: Axes, method: str, n: Any, seconds: Any, look: style.Look) -> None:
    label, known = method, seconds > 0
    n, seconds = n[known], seconds[known]
    if len(n) >= _FEWEST and n.max() > _SPREAD * n.min():
        a, b, error = line(n, seconds)
        at = np.geomspace(n.min(), n.max(), 50)
        if b > 0:  # falling times have other causes than observations
            axis.plot(at, a + b * at, color=look.colour, linewidth=0.9)
        if b > 2 * error:
            label = f"{method}: {b * 1e6:.2g} ± {error * 1e6:.1g} s per million"
    axis.plot(n, seconds, linestyle="", marker=look.marker, color=look.colour, markersize=3, alpha=0.7, label=label)
