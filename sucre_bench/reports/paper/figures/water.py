"""Estimated water against the variance of a view's distances (SUCRe, fig. "Distance map variance vs. parameters").

A row a parameter, a column a method, at most four a figure; a dot a view and channel; dashed, the true water where the
run's records know it. On top, the scatter of each channel over the views: standard deviation by mean. Views of one
water that disagree at the left and agree at the right are the paper's case. Needs metrics of the roles
water-parameters and distance-variance.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from sucre_bench.arrays import DataFrame
from sucre_bench.compare.words import number
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, metrics_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results.restorations import read_record

# parameter, as variants begin with it: its name in a run's records, and as an axis says it
_PARAMETERS = {
    "veiling_light": ("B", "veiling light $B$"),
    "attenuation": ("beta", "attenuation $\\beta$ (1/m)"),
    "backscatter": ("gamma", "backscatter $\\gamma$ (1/m)"),
}
_MARKERS = {"red": "o", "green": "s", "blue": "^"}
_VIEW = ["dataset", "scene", "view"]
_METHODS = 4


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset and four methods."""
    rows, out = results.rows, results.out
    ok = rows[(rows["status"] == "ok") & rows["value"].notna()]
    water = ok[ok["metric"].isin(metrics_of("water-parameters"))]
    variances = (
        ok[ok["metric"].isin(metrics_of("distance-variance"))]
        .drop_duplicates(_VIEW)
        .rename(columns={"value": "variance"})
    )
    water = water.merge(variances[[*_VIEW, "variance"]], on=_VIEW)
    if water.empty:
        remedy = f"{adding('water-parameters', 'distance-variance')}, with a method that estimates water, on images"
        raise NotApplicableError(f"no water beside a variance of distances; {remedy} with depth")
    for name, of_dataset in style.each_dataset(water):
        methods = list(dict.fromkeys(of_dataset["method"]))
        pages = [methods[start : start + _METHODS] for start in range(0, len(methods), _METHODS)]
        for k, page in enumerate(pages, 1):
            words = [name, str(k) if len(pages) > 1 else ""]
            yield "-".join(word for word in words if word), _page(of_dataset, page, out)


def _page(water: DataFrame, methods: Sequence[str], out: Path) -> Figure:
    figure, axes = style.figure(2, 4.8, len(_PARAMETERS), len(methods), sharex=True, sharey="row")
    true = Line2D([], [], color="#666666", linewidth=0.8, linestyle="--", label="true")
    known = False
    for column, method in zip(axes.T, methods, strict=True):
        estimates = water[water["method"] == method]
        truth = _truth(estimates, out)
        known = known or bool(truth)
        for panel, (parameter, (symbol, _)) in zip(column, _PARAMETERS.items(), strict=True):
            _panel(panel, estimates, parameter, truth.get(symbol))
        column[0].set_title(method, fontsize=7)
    for line, (_, title) in zip(axes, _PARAMETERS.values(), strict=True):
        line[0].set_ylabel(title)
        low, high = line[0].get_ylim()
        line[0].set_ylim(low, high + 0.15 * (high - low))  # room for the numbers
    figure.supxlabel("variance of the view's distances (m²)", fontsize=7)
    handles = [*axes[0, 0].get_legend_handles_labels()[0], *([true] if known else [])]
    figure.legend(handles=handles, loc="outside upper center", ncols=len(handles))
    return figure


def _panel(panel: Axes, estimates: DataFrame, parameter: str, truth: Any) -> None:
    for place, (channel, marker) in enumerate(_MARKERS.items()):
        of_channel, colour = estimates[estimates["variant"] == f"{parameter}-{channel}"], style.CHANNELS[channel]
        panel.scatter(
            of_channel["variance"], of_channel["value"], s=9, color=colour, marker=marker, linewidths=0, label=channel
        )
        if truth is not None:
            panel.axhline(truth[place], color=colour, linewidth=0.8, linestyle="--", zorder=0)
        if len(of_channel) > 1 and (mean := of_channel["value"].mean()):
            percent = round(100 * of_channel["value"].std() / abs(mean), 3)
            panel.text(
                0.19 + 0.31 * place, 1, f"{number(percent)} %",
                color=colour, ha="center", va="top", transform=panel.transAxes,
            )  # fmt: skip


def _truth(estimates: DataFrame, out: Path) -> dict[str, Any]:
    """The true water of a method's views, by B, beta and gamma, from what the run kept beside its pictures.

    Empty where it is not known, where scenes differ in it, and where it explains other intensities than the estimate.
    """
    one = [read_record(row, out) for row in estimates.drop_duplicates(["dataset", "scene"]).itertuples()]
    true = [record.get("true_water") or {} for record in one]
    fits = all(t and t["encoding"] == record.get("encoding") for t, record in zip(true, one, strict=True))
    return true[0] if fits and all(t == true[0] for t in true) else {}
