"""Pictures beside one another, with the steps that the photograph does not have (`sucre_bench.imaging.seams`).

Of each dataset, the views with the highest score of the metric seams are drawn, a figure each: the photograph, and
every method that changed it, all at full contrast (percentiles 1 and 99 of each channel), as the metric sees them;
enlarged, the window with most seams in any of them; and the steps. Distances are not kept
with results: steps are looked for at all distances here, and without accounting for those. Scores are the metric's.
"""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle

from sucre_bench.arrays import Array
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.imaging.seams import Seams, find_seams
from sucre_bench.reports.metric_roles import adding, metrics_of
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results import layout

# Views drawn of each dataset, and pictures of each: the photograph and so many methods.
_VIEWS, _METHODS = 2, 5

# The window enlarged: its share of the picture's width, and its height over its width; the top of the scale of steps.
_WINDOW, _SHAPE, _TOP = 0.22, 0.75, 0.25

# A picture is another one where so much of it differs from the photograph by more than its JPEG file does.
_DIFFERS, _PART = 8 / 255, 0.05


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure a view. NotApplicableError where there is no score of seams or no picture."""
    rows, out = results.rows, results.out
    scores = rows[rows["metric"].isin(metrics_of("seams")) & (rows["status"] == "ok")]
    scores = scores[scores["variant"].isin(scores["variant"].iloc[:1])]  # of several, the first
    drawn = False
    for _, those in scores.groupby("dataset", sort=False):
        worst = those.groupby(["dataset", "scene", "view"], sort=False)["value"].max()
        for of in worst.sort_values(ascending=False, kind="stable").index[:_VIEWS]:
            dataset, scene, view = (str(part) for part in of)
            here = (those["scene"] == scene) & (those["view"] == view)
            values = dict(zip(those.loc[here, "method"], those.loc[here, "value"], strict=True))
            pictures = _pictures(dataset, scene, view, values, out)
            if len(pictures) > 1:
                drawn = True
                suffix = layout.file_name(f"{dataset}-{Path(view).stem}")
                yield suffix, _figure(pictures, values, f"{view} of {dataset}")
    if not drawn:
        raise NotApplicableError(f"no picture with a score of seams; {adding('seams')}, and run methods on depth")


def _pictures(dataset: str, scene: str, view: str, values: dict[str, float], out: Path) -> dict[str, Array]:
    """The photograph, and what methods made of it, NaN where there is no colour; those that left it alone not again."""
    place = layout.find(dataset, scene, view, out)
    if place is None or not place.original(out).is_file():
        return {}
    pictures = {"photograph": read_rgb(place.original(out))}
    for method in values:
        path = place.restored(out, method)
        if len(pictures) <= _METHODS and path.is_file():
            made = read_rgb(path)
            known = np.asarray((made > 0).any(axis=-1))
            difference: Array = np.abs(made - pictures["photograph"])[known]
            if np.count_nonzero(difference > _DIFFERS) > _PART * difference.size:
                pictures[method] = np.where(known[..., None], made, np.nan)
    return pictures


def _figure(pictures: dict[str, Array], values: dict[str, float], title: str) -> Figure:
    photograph = pictures["photograph"]
    found = {name: find_seams(picture, photograph) for name, picture in pictures.items() if name != "photograph"}
    high, wide = photograph.shape[:2]
    shapes = [high / wide, _SHAPE, high / wide]
    height = style.WIDTH[2] / len(pictures) * sum(shapes) + 0.7  # of titles
    figure, axes = style.figure(2, height, nrows=3, ncols=len(pictures), height_ratios=shapes)
    x, y, w, h = _window(list(found.values()), high, wide)
    for column, (name, picture) in zip(axes.T, pictures.items(), strict=True):
        shown = np.nan_to_num(picture)
        column[0].imshow(shown)
        column[0].add_patch(Rectangle((x, y), w, h, fill=False, edgecolor="white", linewidth=0.8))
        column[1].imshow(shown[y : y + h, x : x + w], interpolation="nearest")
        column[0].set_title(f"{name}\nseams {values[name]:.2%}" if name in values else f"{name}\n")
        for axis in column:
            axis.set(xticks=[], yticks=[])
            axis.spines[:].set_visible(False)
    for axis, seams in zip(axes[2, 1:], found.values(), strict=True):
        image: AxesImage = axis.imshow(seams.excess, vmin=0, vmax=_TOP, cmap="magma")
        axis.set_facecolor("#888888")  # not looked at
    axes[2, 0].set_axis_off()
    bar = figure.colorbar(image, cax=axes[2, 0].inset_axes((0.2, 0.05, 0.08, 0.9)))
    bar.set_label("step that the photograph\ndoes not have,\nshare of contrast")
    figure.suptitle(title)
    return figure


def _window(found: list[Seams], high: int, wide: int) -> tuple[int, int, int, int]:
    """Where most seams are, in any of the pictures: left, top, width, height in pixels."""
    import cv2

    w = max(1, round(_WINDOW * wide))
    h = min(max(1, round(w * _SHAPE)), high)
    within = []
    for seams in found:
        rows, columns = seams.is_seam.shape
        size = (max(1, round(w * columns / wide)), max(1, round(h * rows / high)))
        within.append(cv2.boxFilter(seams.is_seam.astype(np.float32), -1, size, borderType=cv2.BORDER_CONSTANT))
    most = within[int(np.argmax([one.max() for one in within]))]
    y, x = np.unravel_index(int(most.argmax()), most.shape)
    left, top = round((x + 0.5) * wide / most.shape[1] - w / 2), round((y + 0.5) * high / most.shape[0] - h / 2)
    return min(max(left, 0), wide - w), min(max(top, 0), high - h), w, h
