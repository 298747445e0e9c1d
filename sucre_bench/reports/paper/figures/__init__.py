"""Figures of studies, a module each, with ``draw(rows, study, out)``; `style` is how they look.

``draw(rows, study, out)`` yields a suffix of the file's name (it may be empty) and a matplotlib figure, or a
NotApplicableError ("why; what to do") in its place, of a dataset that gives none. It reads rows, and files that a run
keeps under `out` (see `results.layout`), nothing else, and raises NotApplicableError where they hold nothing to
draw at all. It is called with the style switched on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from sucre_bench.errors import NotApplicableError
    from sucre_bench.jobs.study import Study

__all__ = ["Draw", "Drawn", "find"]

Drawn: TypeAlias = "Iterator[tuple[str, Figure | NotApplicableError]]"
Draw = Callable[["pd.DataFrame", "Study", Path], Drawn]


def find(name: str) -> Draw:
    """Return what draws a figure."""
    draw: Draw = import_module(f"{__name__}.{name}").draw
    return draw
