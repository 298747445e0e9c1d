"""Figures of studies: each module has ``draw(results)``; `style` has their colours, markers and sizes.

``draw(results)`` yields pairs: a suffix for the file's name (may be empty), and a matplotlib figure. If a dataset gives
no figure, a NotApplicableError ("why; what to do") stands in its place. If there is nothing to draw at all, `draw`
raises it. Figures read only the study's results (`StudyResults`) and the files of a run under ``results.out`` (see
`results.layout`). They are drawn inside ``style.look()``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from sucre_bench.errors import NotApplicableError
    from sucre_bench.reports.paper.study_results import StudyResults

Drawn: TypeAlias = "Iterator[tuple[str, Figure | NotApplicableError]]"
Draw = Callable[["StudyResults"], Drawn]


def find(name: str) -> Draw:
    """Return the function that draws the figure of this name."""
    draw: Draw = import_module(f"{__name__}.{name}").draw
    return draw
