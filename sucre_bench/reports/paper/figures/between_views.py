"""How much the colour of a point changes between views, against the difference of its distances from the cameras.

What a perfect restorer leaves does not depend on the distance: a flat line. Needs a metric of the role
change-with-distance; a dot is the mean over views, at the middle of a range of differences.
"""

from collections.abc import Iterator

from matplotlib.figure import Figure

from sucre_bench.arrays import DataFrame
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.metric_roles import adding, metrics_of, symbol
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults

_RANGE = r"image/([\d.]+)-([\d.]+) m"


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset, a panel per metric and variant. NotApplicableError if there is no such score."""
    rows = results.rows
    rows = rows[(rows["status"] == "ok") & rows["metric"].isin(metrics_of("change-with-distance"))]
    ends = rows["region"].str.extract(_RANGE).astype(float)
    rows = rows.assign(place=ends.mean(axis=1))[ends.notna().all(axis=1)]
    if rows.empty:
        raise NotApplicableError(f"no scores of several restored views; {adding('change-with-distance')}")
    for name, of_dataset in style.each_dataset(rows):
        yield name, _figure(of_dataset)


def _figure(rows: DataFrame) -> Figure:
    panels = list(dict.fromkeys(zip(rows["metric"], rows["variant"], strict=True)))
    looks = style.looks(rows["method"])
    figure, axes = style.figure(2, 0.6 + 2.6 * len(panels), len(panels), 1, sharex=True)
    for (metric, variant), panel in zip(panels, axes[:, 0], strict=True):
        scores = rows[(rows["metric"] == metric) & (rows["variant"] == variant)]
        for method, look in looks.items():
            means = scores[scores["method"] == method].groupby("place")["value"].mean()
            panel.plot(means.index, means, color=look.colour, marker=look.marker, label=method)
        panel.set_ylabel(symbol(metric, str(scores["unit"].iloc[0])))
        panel.set_xscale("log", base=2)
        ranges = scores.drop_duplicates("place").sort_values("place")
        panel.set_xticks(ranges["place"], ranges["region"].str.extract(r"image/(.*) m")[0])
        panel.minorticks_off()
        panel.set_ylim(bottom=0)
        panel.grid(axis="y")
    figure.supxlabel("difference of a point's distances from the two cameras (m)", fontsize=7)
    style.legend_above(figure, axes[0, 0], 5)
    return figure
