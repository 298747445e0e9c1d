"""Several methods on the views of a scene, from Python: restored, scored and compared in one call."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import compare, plugins, results
from sucre_bench.arguments import checked, checked_fields
from sucre_bench.arrays import DataFrame, Picture
from sucre_bench.compare import Comparison
from sucre_bench.compare.documents import Format, as_text, without_costs
from sucre_bench.compare.terminal_table import as_table
from sucre_bench.engine.common_pixels import Source, score_in_memory
from sucre_bench.engine.python_api import restore, score
from sucre_bench.engine.score import row_of_fault, row_without_value
from sucre_bench.errors import (
    InputError,
    SucreBenchError,
    check_number,
)
from sucre_bench.imaging.display import display
from sucre_bench.imaging.drawing import captioned
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.jobs.catalogue import method_choice, metric_choices
from sucre_bench.machine import progress, terminal
from sucre_bench.plugins.options import Choice
from sucre_bench.results.rows import wide
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from PIL.Image import Image
else:
    Image = Any

Methods = Sequence[Any] | Mapping[str, Any]
_WIDTH = 100  # characters of a printed table
_GAP = 4  # pixels between the pictures of a plot


@dataclass(frozen=True, eq=False, repr=False)
@checked_fields
class Compared:
    """The result of `compare_methods`. Printed, it is a table of the methods' means with 95 % intervals.

    It leaves out seconds and memory, which `table` has.

    >>> compared = compare_methods(Scene("reef", [], frozenset()), ["gray_world"])
    >>> compared.pictures
    {}
    """

    scene: Scene
    labels: tuple[str, ...]

    rows: DataFrame
    """The long table, a row a score, each on a method's own pixels. It alone has what failed or was skipped, with the
    reason."""

    pictures: Mapping[tuple[str, str], Picture] = field(default_factory=dict)
    """The restored images (H, W, 3) uint8 RGB by view and label, holes black."""

    common: DataFrame | None = None
    """Scores on the pixels that all methods fill, of views where these differ, for `comparison`; None if methods
    are compared on their own pixels."""

    @property
    def table(self) -> DataFrame:
        """A table with one row for each view and method, and one column for each metric: see `sucre_bench.wide`."""
        return wide(self.rows)

    @property
    def comparison(self) -> Comparison | None:
        """Means, paired differences, ranks and ties; None if there are no scores."""
        if not len(self.rows):
            return None
        common = self.common
        rows = self.rows if common is None else compare.on_pixels(self.rows, common)
        return next(iter(compare.compare(rows, order=self.labels)), None)

    def markdown(self) -> str:
        """Return the table of means with 95 % intervals in Markdown."""
        return self._as_text("md")

    def latex(self) -> str:
        """Return the table of means with 95 % intervals in LaTeX. It needs the package booktabs."""
        return self._as_text("latex")

    def _as_text(self, how: Format) -> str:
        found = self.comparison
        return as_text([without_costs(found)], how) if found else "no scores"

    def __repr__(self) -> str:
        found = self.comparison
        if found is None:
            return "no scores"
        return terminal.plain(as_table(without_costs(found), _WIDTH), _WIDTH)

    def _repr_markdown_(self) -> str:
        return self.markdown()

    @checked
    def plot(self, view: str | int = 0, height: int = 360) -> Image:
        """Return a picture of one view before and after: the photograph, each method, and the reference if known.

        - view: name or place of the view;
        - height: height of the picture, in pixels.

        A notebook shows the returned picture. Raises InputError for an unknown view.
        """
        import cv2
        from PIL import Image

        shown = self.scene[view]
        check_number("plot(height)", height, "[16, 10000]")
        panels = {"photograph": to_8bit(display(shown.rgb, "none", shown.encoding))}
        for label in self.labels:
            if (shown.name, label) in self.pictures:
                panels[label] = self.pictures[shown.name, label]
        if shown.reference is not None:
            panels["reference"] = to_8bit(display(shown.reference, "none", shown.encoding))
        parts = []
        for title, picture in panels.items():
            size = (round(picture.shape[1] * height / picture.shape[0]), height)
            how = cv2.INTER_AREA if height < picture.shape[0] else cv2.INTER_LINEAR
            resized: Picture = np.asarray(
                cv2.resize(picture, size, interpolation=how), np.uint8
            )
            parts += [np.full((height, _GAP, 3), 255, np.uint8), captioned(resized, title)]
        return Image.fromarray(np.hstack(parts[1:]))


@checked
def compare_methods(
    scene: Scene,
    methods: Methods,
    metrics: str | Sequence[Any] = (),
    views: Iterable[str | int | View] | None = None,
    pixels: compare.Pixels = "common",
) -> Compared:
    """Restore views of a scene with several methods, score the restorations, and compare the methods.

    - methods: names of methods or presets, or method objects. To name configurations, give a mapping from each label
      to a name, an object, or options with the name: {"few": {"name": "sucre", "max_observations": 10}};
    - metrics: as in `score`; default those of `sucre-bench run`;
    - views: names, places or views; default all views of the scene;
    - pixels: where methods fill different pixels of a view, "common" compares them on those that all of them fill,
      "own" each on its own.

    If a view cannot be restored, its row has the reason, and the other views continue.

    Raises InputError for an unknown method, option, metric or view, before any work.

    >>> from sucre_bench.engine.python_api import load_scene
    >>> scene = load_scene("demo", views=2, width=160, height=120)
    >>> compared = compare_methods(scene, ["underwater", "gray_world"], metrics=["psnr"])
    >>> compared.table["psnr"].groupby("method").mean().idxmax()
    'gray_world'
    >>> compared.plot(0, height=120).size
    (652, 120)
    """
    import pandas as pd

    made = _made(methods)
    chosen = [
        view if isinstance(view, View) else scene[view]
        for view in (scene if views is None else views)
    ]
    # By default, the metrics of a `run` that names none.
    metrics = [metrics] if isinstance(metrics, str) else list(metrics)
    metrics = metrics or ["default"]
    metric_choices(metrics)  # raises for a mistyped name, before any view is restored
    tables = [results.frame([])]
    held = dict[tuple[str, str], Source]()
    with progress.live() if sys.stderr.isatty() else contextlib.nullcontext():
        for label, method in progress.track(list(made.items()), f"methods on {scene.name}"):
            for view in progress.track(chosen, label):
                rows, restored = _one(scene, view, label, method, metrics)
                tables.append(rows)
                if restored is not None:
                    held[view.name, label] = restored
        rows = pd.concat(tables[1:] or tables, ignore_index=True)
        common = score_in_memory(chosen, rows, held, metrics) if pixels == "common" else None
    return Compared(
        scene,
        tuple(made),
        rows,
        {of: restored.picture(()) for of, restored in held.items()},
        common,
    )


def _made(methods: Methods) -> dict[str, Any]:
    """Choices and method objects by label. InputError for an unknown name or option, or a label that is there twice."""
    given = (
        methods.items() if isinstance(methods, Mapping) else [(None, each) for each in methods]
    )
    made: dict[str, Any] = {}
    for label, what in given:
        options = dict(what) if isinstance(what, Mapping) else {"name": what}
        name = options.pop("name", label or "")
        label = label or (name if isinstance(name, str) else plugins.plugin_of(name).name)
        if label in made:
            raise InputError(
                f"'{label}' is there twice", "methods", "give a mapping from labels to methods"
            )
        made[label] = method_choice(name, options) if isinstance(name, str) else name
        if isinstance(name, str):
            made[label].make()  # raises for an option that the method does not take
    return made


def _one(
    scene: Scene, view: View, label: str, method: Any, metrics: Sequence[Any]
) -> tuple[DataFrame, Source | None]:
    """Restore and score one view: its rows, and its picture and mask if there are any."""
    try:
        result = restore(method, scene, view)
    except SucreBenchError as fault:
        plugin = method.plugin if isinstance(method, Choice) else plugins.plugin_of(method)
        base = results.Row(scene.name, scene.name, view.name, label, data_id=scene.data_id)
        if lacks := plugins.missing_needs(plugin, scene.has):
            return results.frame([row_without_value(base, "skipped", lacks)]), None
        return results.frame([row_of_fault(base, fault, None)]), None
    rows = score(result, view, metrics, dataset=scene.name)
    return rows.assign(method=label), Source.held(to_8bit(result.shown), result.valid)
