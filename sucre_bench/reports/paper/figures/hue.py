"""The hue of each chart patch against the chart's distance (SUCRe, fig. "Hue vs. distance" and its appendix).

A panel a patch, half a turn up and down from the hue expected there, the gray line. A dot is the circular mean over
charts that are about equally far, see `figures.charts`; a line that leaves through the top comes back
from below. Needs metrics of the roles patch-hue and
chart-distance.
"""

import itertools
from collections.abc import Iterator
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from sucre_bench.arrays import Array, DataFrame
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, metrics_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.figures.charts import PLACES, seen_charts, with_places
from sucre_bench.reports.paper.figures.style import Look
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results.layout import file_name

_PANELS = 24


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset, set of patches and variant of hue."""
    hues = seen_charts(results.rows)
    hues = hues[hues["metric"].isin(metrics_of("patch-hue"))]
    forms = [v for v in dict.fromkeys(hues["variant"]) if f"{v}-expected" in set(hues["variant"])]
    if not forms:
        raise NotApplicableError(f"no hues of chart patches; {adding('patch-hue', 'chart-distance')}")
    hues = hues.assign(patch=hues["region"].str.partition("/")[2])
    for name, of_dataset in style.each_dataset(hues):
        groups = list(_with_same_patches(of_dataset))
        for first, charts in groups:
            for form in forms:
                pages = _pages(charts)
                for k, patches in enumerate(pages, 1):
                    several = (len(groups) > 1, len(forms) > 1, len(pages) > 1)
                    words = [name, *itertools.compress((first, form, str(k)), several)]
                    yield "-".join(filter(None, words)), _panels(with_places(charts), form, patches)


def _with_same_patches(hues: DataFrame) -> Iterator[tuple[str, DataFrame]]:
    """The charts that have the same patches, which panels show together, with the name of the first chart."""
    patches = {chart: frozenset(of_chart) for chart, of_chart in hues.groupby("chart")["patch"]}
    of_rows = hues["chart"].map(patches)
    for same in dict.fromkeys(of_rows):
        charts = hues[of_rows == same]
        yield file_name(charts["chart"].iloc[0]), charts


def _pages(hues: DataFrame) -> list[list[str]]:
    """The patches by their numbers, as many on a page as there is room for."""
    patches = sorted(set(hues["patch"]), key=lambda patch: int(patch.partition("-")[0]))
    return [patches[start : start + _PANELS] for start in range(0, len(patches), _PANELS)]


def _panels(hues: DataFrame, form: str, patches: list[str]) -> Figure:
    looks = style.looks(hues["method"])
    width = 4
    figure, axes = style.grid(len(patches), width, 0.6, 1.25, sharex=True)
    for k, (patch, panel) in enumerate(zip(patches, axes.flat, strict=False)):
        of_patch = hues[hues["patch"] == patch]
        expected = float(of_patch.loc[of_patch["variant"] == f"{form}-expected", "value"].iloc[0])
        _panel(panel, of_patch[of_patch["variant"] == form], expected, looks)
        panel.tick_params(labelbottom=k + width >= len(patches))
        panel.set_title(patch.partition("-")[2], fontsize=7)
    figure.supxlabel("distance of the chart (m)", fontsize=7)
    figure.supylabel(f"hue ({form}, °)", fontsize=7)
    style.legend_above(figure, axes[0, 0], 5)
    return figure


def _panel(panel: Axes, measured: DataFrame, expected: float, looks: dict[str, Look]) -> None:
    panel.axhline(expected, color="#999999", linewidth=2.5, zorder=0)
    for method, look in looks.items():
        places = measured[measured["method"] == method].groupby("place")["value"]
        turns = places.agg(lambda hues: _mean_turn(hues.to_numpy(), expected))
        unbroken = np.unwrap(turns.to_numpy(), period=360)
        for turn in range(-PLACES // 2, PLACES // 2 + 1):  # what leaves through one edge comes back at the other
            y = unbroken + 360 * turn
            if turn == 0 or (y.min() <= 180 and y.max() >= -180):
                label = method if turn == 0 else "_again"
                drawn: Any = {"color": look.colour, "marker": look.marker, "label": label, "markersize": 2.5, "lw": 0.9}
                panel.plot(turns.index, expected + y, **drawn)
    panel.set_ylim(expected - 180, expected + 180)
    ticks = np.arange(np.ceil((expected - 180) / 90), (expected + 180) / 90 + 1e-9) * 90
    panel.set_yticks(ticks, [f"{tick % 360:.0f}" for tick in ticks])


def _mean_turn(hues: Array, expected: float) -> float:
    """The circular mean of hues less the expected one: degrees in [-180, 180]."""
    return float(np.degrees(np.angle(np.exp(1j * np.radians(hues - expected)).mean())))
