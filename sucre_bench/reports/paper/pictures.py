"""The figures of pictures: pictures (views beside restorations), seams (steps that the view does not have)."""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
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
from sucre_bench.results.rows import unreplicated

_MOST_VIEWS = 4
_MOST_COLUMNS = 8
_DPI = 300
_TEXT = 0.13  # inches, a line
_GAP = 0.01  # inches around a picture

# Of seams: views drawn of each dataset, and methods of each.
_VIEWS = 2
_METHODS = 5

_TOP = 0.25  # of the scale of steps


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
    width = (style.WIDTH[2] - _TEXT) / len(columns)
    heads = [_wrapped(name, width, 3) for name in columns]
    n_lines = 1 + max(head.count("\n") for head in heads)
    height = 0.05 + _TEXT * n_lines + len(views) * shape * width
    figure, axes = style.figure(2, height, len(views), len(columns))
    figure.set_layout_engine("compressed", w_pad=_GAP, h_pad=_GAP, wspace=0, hspace=0)
    for column, files in zip(axes.T, columns.values(), strict=True):
        for panel, file in zip(column, files, strict=True):
            panel.set(xticks=[], yticks=[], box_aspect=shape)
            panel.spines[:].set_visible(False)
            try:
                with Image.open(regular(file)) as picture:
                    wide = min(
                        round(width * _DPI), picture.width, round(picture.height / shape)
                    )
                    size = (wide, max(1, round(wide * shape)))
                    fitted = ImageOps.fit(picture.convert("RGB"), size, Image.Resampling.BOX)
            except (OSError, InputError):
                panel.set_facecolor("#EEEEEE")
                centred: Any = {"ha": "center", "va": "center", "transform": panel.transAxes}
                panel.text(0.5, 0.5, "none", color="#777777", **centred)
            else:
                panel.imshow(np.asarray(fitted), aspect="auto", interpolation="none")
    for panel, head in zip(axes[0], heads, strict=True):
        panel.set_title(head, pad=2)
    for name, panel in zip(views, axes[:, 0], strict=True):
        panel.set_ylabel(_wrapped(name, shape * width, 1), labelpad=2)
    return figure


def _wrapped(text: str, inches: float, lines: int) -> str:
    """A label of 7 points in so many lines, broken after _ , and =, without its end where there is no room."""
    words = re.sub("([_,=])", r"\1 ", text)
    n_letters = max(5, int(inches / 0.057))
    whole: Any = {"break_long_words": False, "placeholder": "…"}
    wrapped = textwrap.fill(words, n_letters, max_lines=lines, **whole)
    return re.sub("([_,=]) ", r"\1", wrapped)


def seams(results: StudyResults) -> Iterator[Drawn]:
    """Draw pictures beside one another, with the steps that the photograph does not have (`imaging.seams`).

    Of each dataset, the views with the highest score of the metric seams are drawn, a figure each. It has the
    photograph, and the methods with most seams, and the steps below each. Distances are not kept with results: steps
    are looked for at all distances here, and without accounting for those. Scores are the metric's.
    """
    scores = scores_of(results.rows, "seams")
    scores = scores[scores["variant"].isin(scores["variant"].iloc[:1])]  # of several, the first
    scores = scores.sort_values("value", ascending=False, kind="stable")
    is_drawn = False
    for dataset, of_dataset in scores.groupby("dataset", sort=False):
        worst = of_dataset.groupby(["scene", "view"], sort=False)
        for (scene, view), of_view in [*worst][:_VIEWS]:
            place = layout.find(str(dataset), scene, view, results.out)
            if not place or not place.original(results.out).is_file():
                continue
            pictures = {}
            for method, value in of_view[["method", "value"]].itertuples(index=False):
                path = place.restored(results.out, method)
                if path.is_file():
                    pictures[f"{method}\nseams {value:.2%}"] = read_rgb(path)
            if pictures:
                is_drawn = True
                shown = dict([*pictures.items()][:_METHODS])
                figure = _seams(read_rgb(place.original(results.out)), shown)
                figure.suptitle(f"{view} of {dataset}")
                yield (layout.file_name(f"{dataset}-{Path(view).stem}"),), figure
    if not is_drawn:
        raise NotApplicableError(
            f"no picture with a score of seams; {adding('seams')}, and run methods on depth"
        )


def _seams(photograph: Array, pictures: Mapping[str, Array]) -> Figure:
    """Pictures by title beside the photograph, and below each its steps."""
    n_columns = 1 + len(pictures)
    height = 2 * style.WIDTH[2] / n_columns * photograph.shape[0] / photograph.shape[1] + 0.7
    figure, axes = style.figure(2, height, 2, n_columns)
    for panel in axes.flat:
        panel.set(xticks=[], yticks=[])
        panel.spines[:].set_visible(False)
    axes[0, 0].imshow(photograph)
    axes[0, 0].set_title("photograph\n")
    for column, (title, picture) in zip(axes.T[1:], pictures.items(), strict=True):
        is_known = (picture > 0).any(axis=-1, keepdims=True)
        steps = find_seams(np.where(is_known, picture, np.nan), photograph).excess
        column[0].imshow(picture)
        column[0].set_title(title)
        image = column[1].imshow(steps, vmin=0, vmax=_TOP, cmap="magma")
        column[1].set_facecolor("#888888")  # not looked at
    bar = figure.colorbar(image, cax=axes[1, 0].inset_axes((0.2, 0.05, 0.08, 0.9)))
    bar.set_label("step that the photograph\ndoes not have,\nshare of contrast")
    return figure
