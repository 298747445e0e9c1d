"""Pictures side by side: a row a view, the view itself first, then each method, the scene without water last.

At most four views, evenly spread; methods that do not fit beside each other go on in further figures. All pictures are
cropped to the shape of the first, about their middle. Pixels without a colour are black, as in the methods' files.
"""

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.errors import NotApplicableError
from sucre_bench.reports.paper.figures import style
from sucre_bench.reports.paper.study_results import StudyResults
from sucre_bench.results import layout
from sucre_bench.results.layout import Place
from sucre_bench.results.rows import unreplicated

_MOST_VIEWS = 4
_MOST_COLUMNS = 8
_DPI = 300
_TEXT = 0.15  # inches, a line
_GAP = 0.03  # inches between pictures


def draw(results: StudyResults) -> Iterator[tuple[str, Figure]]:
    """Yield a figure per dataset and page."""
    rows, out = results.rows, results.out
    datasets = list(dict.fromkeys(rows["dataset"]))
    found = [(dataset, rows[rows["dataset"] == dataset]) for dataset in datasets]
    kept = [(dataset, of_dataset, _views(dataset, of_dataset, out)) for dataset, of_dataset in found]
    if not any(views for _, _, views in kept):
        raise NotApplicableError(f"no pictures under {out}; overwrite=always makes them again")
    for dataset, of_dataset, views in kept:
        if not views:
            continue
        has_reference = any(place.reference(out).is_file() for _, place in views)
        several = pages(list(dict.fromkeys(of_dataset["method"])), _MOST_COLUMNS - 1 - has_reference)
        for n, methods in enumerate(several, 1):
            words = [dataset if len(datasets) > 1 else "", str(n) if len(several) > 1 else ""]
            yield "-".join(filter(None, words)), _figure(views, methods, has_reference, out)


def pages(methods: Sequence[str], most: int) -> list[list[str]]:
    """Return methods in as few groups of at most so many as there can be, as equal as may be, in their order."""
    n = -(-len(methods) // most)
    return [list(part) for part in np.array_split(np.array(methods, dtype=object), n)]


def _views(dataset: str, rows: DataFrame, out: Path) -> list[tuple[str, Place]]:
    """The names and places of a few views that were kept, evenly spread; the first of repetitions."""
    names = rows.loc[rows["view"] != "", ["scene", "view"]].drop_duplicates().sort_values(["scene", "view"])
    several = names["scene"].nunique() > 1
    places = [
        (f"{scene} · {place.stem.name}" if several else place.stem.name, place)
        for scene, view in names.itertuples(index=False)
        if not unreplicated(scene)[1]
        and (place := layout.find(dataset, scene, view, out))
        and place.original(out).is_file()
    ]
    return [places[n] for n in evenly(len(places), _MOST_VIEWS)]


def _figure(views: Sequence[tuple[str, Place]], methods: Sequence[str], has_reference: bool, out: Path) -> Figure:
    columns: list[tuple[str, list[Path]]] = [("input", [place.original(out) for _, place in views])]
    columns += [(method, [place.restored(out, method) for _, place in views]) for method in methods]
    if has_reference:
        columns.append(("reference", [place.reference(out) for _, place in views]))
    first = _read(columns[0][1][0])
    shape = first.shape[0] / first.shape[1]
    width = (style.WIDTH[2] - _TEXT) / len(columns) - _GAP
    height = shape * width
    heads = [_wrapped(name, width, 2) for name, _ in columns]
    top = 0.05 + 0.115 * max(head.count("\n") + 1 for head in heads)
    total = top + len(views) * (height + _GAP)
    figure, axes = style.figure(2, total, len(views), len(columns))
    figure.set_layout_engine("none")  # pictures keep their shape
    for c, ((_, paths), head) in enumerate(zip(columns, heads, strict=True)):
        for r, path in enumerate(paths):
            left, bottom = _TEXT + c * (width + _GAP), (len(views) - r - 1) * (height + _GAP)
            place = (left / style.WIDTH[2], bottom / total, width / style.WIDTH[2], height / total)
            axes[r, c].set_position(place)
            _show(axes[r, c], _read(path), shape, round(width * _DPI))
        axes[0, c].set_title(head, fontsize=7, pad=2)
    for (name, _), panel in zip(views, axes[:, 0], strict=True):
        panel.set_ylabel(_wrapped(name, height), labelpad=2)
    return figure


def _show(panel: Any, image: Any, shape: float, width: int) -> None:
    """A picture of that shape, or the word that there is none. width: in pixels of the printed figure."""
    panel.set(xticks=[], yticks=[])
    panel.spines[:].set_visible(False)
    if image is None:
        panel.set_facecolor("#EEEEEE")
        panel.text(0.5, 0.5, "none", ha="center", va="center", color="#777777", transform=panel.transAxes)
    else:
        panel.imshow(_fitted(image, shape, width), aspect="auto", interpolation="none")


def _fitted(image: Any, shape: float, width: int) -> Any:
    """The middle of an image, of that height over width, no wider than it is printed."""
    import cv2

    H, W = image.shape[:2]
    h, w = min(H, round(W * shape)), min(W, round(H / shape))
    top, left = (H - h) // 2, (W - w) // 2
    image = image[top : top + h, left : left + w]
    size = (width, max(1, round(width * shape)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA) if w > width else image


def _read(path: Path) -> Any:
    """A picture (H, W, 3) of 8 bits; None where there is none."""
    import cv2

    image = cv2.imread(str(path), cv2.IMREAD_COLOR) if path.is_file() else None
    return None if image is None else image[..., ::-1]


def _wrapped(text: str, inches: float, lines: int = 1) -> str:
    """A label of 7 points in so many lines, without its end where there is no room."""
    broken = textwrap.wrap(text, max(5, int(inches / 0.057)))
    return (
        "\n".join(broken) if len(broken) <= lines else "\n".join([*broken[: lines - 1], broken[lines - 1][:-1] + "…"])
    )
