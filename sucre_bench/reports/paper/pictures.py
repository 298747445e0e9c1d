"""The figures of pictures: pictures (views beside restorations), seams (steps that the view does not have)."""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from PIL import Image, ImageOps

from sucre_bench.arrays import Array, evenly
from sucre_bench.errors import InputError, NotApplicableError
from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.imaging.seams import find_seams
from sucre_bench.machine.files import regular
from sucre_bench.reports.metric_roles import adding, scores_of
from sucre_bench.reports.paper import style
from sucre_bench.reports.paper.study_results import Drawn, StudyResults
from sucre_bench.results import layout
from sucre_bench.results.layout import Place
from sucre_bench.results.rows import unreplicated

_MOST_VIEWS = 4
_MOST_COLUMNS = 8
_DPI = 300
_TEXT = 0.15  # inches, a line
_GAP = 0.03  # inches between pictures

# Of seams: views drawn of each dataset, and methods of each.
_VIEWS = 2
_METHODS = 5

# The window enlarged: its share of the picture's width, and its height over its width; the top of the scale of steps.
_WINDOW = 0.22
_SHAPE = 0.75
_TOP = 0.25

# A picture is another one where so much of it differs from the photograph by more than its JPEG file does.
_DIFFERS = 8 / 255
_PART = 0.05


def pictures(results: StudyResults) -> Iterator[Drawn]:
    """Draw pictures side by side: a row a view, the view first, then each method, the scene without water last.

    At most four views, evenly spread, without repetitions; methods that do not fit beside each other go on in further
    figures. All pictures are cropped to the shape of the first, about their middle. Pixels without a colour are black,
    as in the methods' files. Yields a figure per dataset and page.
    """
    rows = results.rows
    out = results.out
    is_drawn = False
    for suffix, of_dataset in style.each_dataset(rows):
        names = of_dataset.loc[
            of_dataset["view"] != "", ["dataset", "scene", "view"]
        ].drop_duplicates()
        several = names["scene"].nunique() > 1
        views = {}
        for dataset, scene, view in names.sort_values(["scene", "view"]).itertuples(
            index=False
        ):
            if unreplicated(scene)[1]:
                continue
            place = layout.find(dataset, scene, view, out)
            if place and place.original(out).is_file():
                name = place.stem.name
                views[f"{scene} · {name}" if several else name] = place
        every = [*views.items()]
        views = dict(every[n] for n in evenly(len(every), _MOST_VIEWS))
        has_reference = any(place.reference(out).is_file() for place in views.values())
        # the photograph is there as "input"
        same = {name for table in results.comparisons for name in table.photographs}
        methods = [name for name in dict.fromkeys(of_dataset["method"]) if name not in same]
        for page, shown in (
            style.pages(methods, _MOST_COLUMNS - 1 - has_reference) if views and methods else ()
        ):
            columns = {"input": [place.original(out) for place in views.values()]}
            columns |= {
                method: [place.restored(out, method) for place in views.values()]
                for method in shown
            }
            if has_reference:
                columns["reference"] = [place.reference(out) for place in views.values()]
            is_drawn = True
            yield (suffix, page), _pictures(list(views), columns)
    if not is_drawn:
        raise NotApplicableError(f"no pictures under {out}; overwrite=always makes them again")


def _pictures(views: Sequence[str], columns: Mapping[str, Sequence[Path]]) -> Figure:
    """A row a view; columns: the files of each, which may be missing."""
    with Image.open(columns["input"][0]) as first:
        shape = first.height / first.width
    width = (style.WIDTH[2] - _TEXT) / len(columns) - _GAP
    height = shape * width
    heads = [_wrapped(name, width, 3) for name in columns]
    total = (
        0.05
        + 0.115 * max(head.count("\n") + 1 for head in heads)
        + len(views) * (height + _GAP)
    )
    figure, axes = style.figure(2, total, len(views), len(columns))
    figure.set_layout_engine("none")  # pictures keep their shape
    files = list(columns.values())
    for (r, c), panel in np.ndenumerate(axes):
        left = _TEXT + c * (width + _GAP)
        bottom = (len(views) - r - 1) * (height + _GAP)
        panel.set_position(
            (left / style.WIDTH[2], bottom / total, width / style.WIDTH[2], height / total)
        )
        panel.set(xticks=[], yticks=[])
        panel.spines[:].set_visible(False)
        try:
            with Image.open(regular(files[c][r])) as picture:
                wide = min(round(width * _DPI), picture.width, round(picture.height / shape))
                size = (wide, max(1, round(wide * shape)))
                fitted = np.asarray(
                    ImageOps.fit(picture.convert("RGB"), size, Image.Resampling.BOX)
                )
        except (OSError, InputError):
            panel.set_facecolor("#EEEEEE")
            panel.text(
                0.5,
                0.5,
                "none",
                ha="center",
                va="center",
                color="#777777",
                transform=panel.transAxes,
            )
        else:
            panel.imshow(fitted, aspect="auto", interpolation="none")
    for panel, head in zip(axes[0], heads, strict=True):
        panel.set_title(head, pad=2)
    for name, panel in zip(views, axes[:, 0], strict=True):
        panel.set_ylabel(_wrapped(name, height), labelpad=2)
    return figure


def _wrapped(text: str, inches: float, lines: int = 1) -> str:
    """A label of 7 points in so many lines, broken between words, without its end where there is no room."""
    # wrap breaks at spaces: a zero byte stands for none
    words = re.sub(r"([_,=])", "\\1\0 ", text)
    wrapped = textwrap.wrap(
        words,
        max(5, int(inches / 0.057)),
        max_lines=lines,
        placeholder="…",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return "\n".join(wrapped).replace("\0 ", "").replace("\0", "")


def seams(results: StudyResults) -> Iterator[Drawn]:
    """Draw pictures beside one another, with the steps that the photograph does not have (`imaging.seams`).

    Of each dataset, the views with the highest score of the metric seams are drawn, a figure each. It has the
    photograph, and every method that changed it, all at full contrast (percentiles 1 and 99 of each channel), as the
    metric sees them. Below are, enlarged, the window with most seams in any of them; and the steps. Distances are not
    kept with results: steps are looked for at all distances here, and without accounting for those. Scores are the
    metric's.
    """
    scores = scores_of(results.rows, "seams")
    is_drawn = False
    scores = scores[scores["variant"].isin(scores["variant"].iloc[:1])]  # of several, the first
    for _, of_dataset in scores.groupby("dataset", sort=False):
        views = of_dataset.groupby(["dataset", "scene", "view"], sort=False)
        worst = views["value"].max().sort_values(ascending=False, kind="stable")
        for dataset, scene, view in worst.index[:_VIEWS]:
            of_view = views.get_group((dataset, scene, view))
            values = dict(zip(of_view["method"], of_view["value"], strict=True))
            photograph, changed = _changed(
                layout.find(dataset, scene, view, results.out), [*values], results.out
            )
            if changed:
                is_drawn = True
                titles = {method: f"{method}\nseams {values[method]:.2%}" for method in changed}
                figure = _seams(photograph, changed, titles)
                figure.suptitle(f"{view} of {dataset}")
                yield (layout.file_name(f"{dataset}-{Path(view).stem}"),), figure
    if not is_drawn:
        raise NotApplicableError(
            f"no picture with a score of seams; {adding('seams')}, and run methods on depth"
        )


def _changed(
    place: Place | None, methods: Sequence[str], out: Path
) -> tuple[Array, dict[str, Array]]:
    """The photograph and what methods made of it, NaN where there is no colour, without those that left it alone."""
    changed: dict[str, Array] = {}
    if place is None or not place.original(out).is_file():
        return np.zeros((0, 0, 3)), changed
    photograph = read_rgb(place.original(out))
    for path, method in ((place.restored(out, method), method) for method in methods):
        if len(changed) < _METHODS and path.is_file():
            made = read_rgb(path)
            known = np.asarray((made > 0).any(axis=-1))
            if np.mean(np.abs(made - photograph)[known] > _DIFFERS) > _PART:
                changed[method] = np.where(known[..., None], made, np.nan)
    return photograph, changed


def _seams(
    photograph: Array, changed: Mapping[str, Array], titles: Mapping[str, str]
) -> Figure:
    import cv2

    found = {method: find_seams(picture, photograph) for method, picture in changed.items()}
    high, wide = photograph.shape[:2]
    shapes = [high / wide, _SHAPE, high / wide]
    columns = {"photograph\n": photograph} | {
        titles[method]: picture for method, picture in changed.items()
    }
    height = style.WIDTH[2] / len(columns) * sum(shapes) + 0.7  # of titles
    figure, axes = style.figure(2, height, 3, len(columns), height_ratios=shapes)
    # The window with most seams in any of the pictures, in pixels of the photograph.
    w = max(1, round(_WINDOW * wide))
    h = min(max(1, round(w * _SHAPE)), high)
    masks = [seams.is_seam.astype(np.float32) for seams in found.values()]
    rows, cols = masks[0].shape
    size = (max(1, round(w * cols / wide)), max(1, round(h * rows / high)))
    within = np.max(
        [cv2.boxFilter(mask, -1, size, borderType=cv2.BORDER_CONSTANT) for mask in masks],
        axis=0,
    )
    row, col = np.unravel_index(int(within.argmax()), within.shape)
    x = min(max(round((col + 0.5) * wide / cols - w / 2), 0), wide - w)
    y = min(max(round((row + 0.5) * high / rows - h / 2), 0), high - h)
    for column, (title, picture) in zip(axes.T, columns.items(), strict=True):
        shown = np.nan_to_num(picture)
        column[0].imshow(shown)
        column[0].add_patch(
            Rectangle((x, y), w, h, fill=False, edgecolor="white", linewidth=0.8)
        )
        column[1].imshow(shown[y : y + h, x : x + w], interpolation="nearest")
        column[0].set_title(title)
        for panel in column:
            panel.set(xticks=[], yticks=[])
            panel.spines[:].set_visible(False)
    for panel, seams in zip(axes[2, 1:], found.values(), strict=True):
        image: AxesImage = panel.imshow(seams.excess, vmin=0, vmax=_TOP, cmap="magma")
        panel.set_facecolor("#888888")  # not looked at
    axes[2, 0].set_axis_off()
    bar = figure.colorbar(image, cax=axes[2, 0].inset_axes((0.2, 0.05, 0.08, 0.9)))
    bar.set_label("step that the photograph\ndoes not have,\nshare of contrast")
    return figure
