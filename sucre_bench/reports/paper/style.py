"""The style of figures: sizes of paper columns, type, panels, and a colour and a marker for each method.

A method's colour is found from its label alone, so that it has the same one in every figure, run and study. Where two
methods of one figure would share it, `looks` gives one of them the next. The palette begins with the seven colours of
Okabe & Ito 2008, "Color Universal Design". Each of the others is dark enough for white paper, and the farthest from all
before it (CIEDE2000) as people with normal, deuteranope and protanope vision see it (Machado, Oliveira & Fernandes
2009). Colours may still be confused where there are many: markers tell those apart.
"""

from __future__ import annotations

import hashlib
import io
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np

from sucre_bench.arrays import DataFrame
from sucre_bench.machine.files import write_atomically
from sucre_bench.results.layout import file_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

T = TypeVar("T")

# Width in inches of one column, and of both, of a two-column paper.
WIDTH = {1: 3.35, 2: 6.9}

PALETTE = (
    "#000000", "#E69F00", "#56B4E9", "#009E73", "#0072B2", "#D55E00", "#CC79A7", "#2D0096", "#872D3C", "#B4C387",
    "#006969", "#0F2D00", "#784B00", "#3C1E3C", "#8778FF", "#E1B4B4", "#C30F96", "#D25A5A", "#690FFF", "#00D2D2",
)  # fmt: skip
# Of the channels of an image.
CHANNELS = {"red": "#D55E00", "green": "#009E73", "blue": "#0072B2"}
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "p")


class Look(NamedTuple):
    """How a method is drawn."""

    colour: str
    """As #RRGGBB."""

    marker: str
    """One of matplotlib's."""


def look() -> AbstractContextManager[None]:
    """Switch the style on, for what is drawn inside."""
    import matplotlib

    return matplotlib.rc_context(fname=Path(__file__).with_name("paper.mplstyle"))


def own_look(method: str) -> Look:
    """Return a method's own colour and marker, which it has wherever no other method of a figure wants that colour."""
    place = int.from_bytes(hashlib.blake2b(method.encode(), digest_size=8).digest(), "little")
    return Look(PALETTE[place % len(PALETTE)], MARKERS[place // len(PALETTE) % len(MARKERS)])


def looks(methods: Iterable[str]) -> dict[str, Look]:
    """Return how each of a figure's methods is drawn: no two alike, and no two of one colour while there are enough."""
    methods = list(dict.fromkeys(methods))
    found: dict[str, Look] = {}
    for method in sorted(methods):
        # whatever order a figure has them in; first those that can have their own
        if own_look(method).colour not in {look.colour for look in found.values()}:
            found[method] = own_look(method)
    for method in sorted(set(methods) - set(found)):
        own = own_look(method)
        used = [*found.values()]
        colour = min(_from(PALETTE, own.colour), key=[look.colour for look in used].count)
        taken = [look.marker for look in used if look.colour == colour]
        found[method] = Look(colour, min(_from(MARKERS, own.marker), key=taken.count))
    return {method: found[method] for method in methods}


def _from(cycle: tuple[str, ...], first: str) -> tuple[str, ...]:
    """All of them, beginning at one."""
    start = cycle.index(first)
    return cycle[start:] + cycle[:start]


def figure(
    columns: int = 1, height: float = 2.4, nrows: int = 1, ncols: int = 1, **subplots: Any
) -> tuple[Figure, Any]:
    """Return a figure as wide as one or two columns of a paper, and its axes as an array (nrows, ncols).

    height: in inches; subplots: as of matplotlib's Figure.subplots (sharex, width_ratios ...).
    """
    from matplotlib.figure import Figure

    with look():
        made = Figure(figsize=(WIDTH[columns], height), layout="constrained")
        return made, made.subplots(nrows, ncols, squeeze=False, **subplots)


def grid(
    count: int, width: int, top: float, each: float, **subplots: Any
) -> tuple[Figure, list[Axes]]:
    """Return a figure, and its panels row by row, at most `width` of them side by side.

    Every panel has the labels of its x axis. top, each: inches above the panels, and of each row
    of panels; subplots: see `figure`.
    """
    width = min(count, width)
    n_rows = -(-count // width)
    made, axes = figure(min(width, 2), top + each * n_rows, n_rows, width, **subplots)
    for n, panel in enumerate(axes.flat):
        panel.set_visible(n < count)
        if "sharex" in subplots:
            panel.tick_params(labelbottom=True)
    return made, list(axes.flat[:count])


def caption(figure: Figure, below: str, named: Axes) -> None:
    """Write what the x axes of all panels show, and above the panels the names of what one of them shows."""
    figure.supxlabel(below)
    handles, labels = named.get_legend_handles_labels()
    most = 5 if figure.get_figwidth() > WIDTH[1] else 3
    figure.legend(handles, labels, loc="outside upper center", ncols=min(most, len(labels)))


def each_dataset(rows: DataFrame) -> Iterator[tuple[str, DataFrame]]:
    """Yield each dataset's rows with a suffix for its figures, empty where there is but one dataset."""
    datasets = list(dict.fromkeys(rows["dataset"]))
    for dataset in datasets:
        yield file_name(dataset) if len(datasets) > 1 else "", rows[rows["dataset"] == dataset]


def pages(items: Sequence[T], most: int) -> Iterator[tuple[str, list[T]]]:
    """Yield items in as few pages of at most so many as there can be, as equal as may be, each with its number.

    The number of a page is empty if it is the only one.
    """
    n = -(-len(items) // most)
    for number, part in enumerate(np.array_split(np.arange(len(items)), n), 1):
        yield str(number) if n > 1 else "", [items[k] for k in part]


def save(figure: Figure, path: Path, svg: bool = False) -> list[Path]:
    """Write a figure as `path` with .png (300 dpi) and .pdf (vectors), and .svg if asked; return what was written.

    Equal figures make equal files.
    """
    written = []
    for suffix in (".png", ".pdf", *([".svg"] if svg else [])):
        buffer = io.BytesIO()
        undated = {".pdf": {"CreationDate": None}, ".svg": {"Date": None}}.get(suffix, {})
        with look():
            figure.savefig(buffer, format=suffix[1:], metadata=undated)
        target = path.with_name(path.name + suffix)  # a name may hold a dot
        write_atomically(target, buffer.getvalue())
        written.append(target)
    return written
