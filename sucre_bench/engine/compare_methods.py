"""Several methods on the views of a scene, from Python: restored, scored and compared in one call."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import compare, plugins, results
from sucre_bench.arrays import DataFrame, Picture
from sucre_bench.compare import Comparison
from sucre_bench.compare.answer import deciding
from sucre_bench.compare.documents import as_text
from sucre_bench.compare.words import number
from sucre_bench.engine.common_pixels import InMemory, score_in_memory
from sucre_bench.engine.python_api import restore, score
from sucre_bench.engine.score import row_without_value
from sucre_bench.errors import InputError, NotApplicableError, SucreBenchError, one_line
from sucre_bench.imaging.display import display
from sucre_bench.imaging.drawing import captioned
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.jobs.catalogue import method_choice, presets
from sucre_bench.jobs.metric_words import metric_choices
from sucre_bench.machine import progress, progress_display
from sucre_bench.plugins.options import Choice
from sucre_bench.results.rows import wide
from sucre_bench.scene import Scene, View

if TYPE_CHECKING:
    from PIL.Image import Image

Methods = Sequence[Any] | Mapping[str, Any]
_GAP = 4  # pixels between the pictures of a plot


@dataclass(frozen=True, eq=False, repr=False)
class Compared:
    """The result of `compare_methods`. Printed, it is a table of the methods' means with 95 % intervals.

    rows: the long table, a row a score, each on a method's own pixels; common: scores on the pixels that all methods
    fill, of views where these differ, for `comparison`; pictures: the restored images (H, W, 3) uint8 RGB by view and
    label, holes black. What failed or was skipped is in `rows` alone, with the reason.

    >>> compared = compare_methods(Scene("reef", [], frozenset()), ["gray_world"])
    >>> compared.pictures
    {}
    """

    scene: Scene
    labels: tuple[str, ...]
    rows: DataFrame
    pictures: Mapping[tuple[str, str], Picture] = field(default_factory=dict)
    common: DataFrame | None = None

    @property
    def table(self) -> DataFrame:
        """A table with one row for each view and method, and one column for each metric: see `sucre_bench.wide`."""
        return wide(self.rows)

    @property
    def comparison(self) -> Comparison | None:
        """Means, paired differences, ranks and ties; None if there are no scores."""
        if not len(self.rows):
            return None
        rows = self.rows if self.common is None else compare.on_pixels(self.rows, self.common)
        return next(iter(compare.compare(rows, order=self.labels)), None)

    def __repr__(self) -> str:
        found = self.comparison
        return as_text([found], "md") if found else "no scores"

    def plot(self, view: str | int = 0, labels: Sequence[str] = (), metric: str = "", height: int = 360) -> Image:
        """Return a picture of one view before and after: the photograph, each method, and the reference if known.

        - view: name or place of the view;
        - labels: the methods to show; default all;
        - metric: the column of `table` whose score stands beside a method's name; default the score that sorts the
          methods;
        - height: height of the picture, in pixels.

        A notebook shows the returned picture. Raises InputError for an unknown label or view.
        """
        from PIL import Image

        shown, metric = self.scene[view], metric or self._main_metric()
        unknown = [label for label in labels if label not in self.labels]
        if unknown:
            raise InputError(f"no method '{unknown[0]}'", "labels", f"there are {', '.join(self.labels)}")
        made = {label: self.pictures.get((shown.name, label)) for label in labels or self.labels}
        panels = {"photograph": _eight_bit(shown, shown.rgb)}
        panels |= {self._title(shown.name, name, metric): each for name, each in made.items() if each is not None}
        if shown.reference is not None:
            panels["reference"] = _eight_bit(shown, shown.reference)
        named = [captioned(_resized(picture, height), name) for name, picture in panels.items()]
        gap = np.full((height, _GAP, 3), 255, np.uint8)
        return Image.fromarray(np.hstack([part for panel in named for part in (gap, panel)][1:]))

    def _main_metric(self) -> str:
        main = deciding(found).main if (found := self.comparison) else None
        return f"{main.metric}:{main.variant}" if main else ""

    def _title(self, view: str, label: str, metric: str) -> str:
        """The label, with its score if there is one."""
        name, _, variant = metric.partition(":")
        of = (self.rows["view"] == view) & (self.rows["method"] == label) & (self.rows["metric"] == name)
        scores = self.rows[of & (self.rows["status"] == "ok") & (self.rows["region"] == "image")]
        scores = scores[scores["variant"] == variant] if variant else scores
        if scores.empty:
            return label
        return " ".join(
            filter(None, [f"{label}, {name}", number(scores["value"].iloc[0]), str(scores["unit"].iloc[0])])
        )


def compare_methods(
    scene: Scene,
    methods: Methods,
    metrics: Sequence[str] = (),
    views: Iterable[str | int | View] | None = None,
    show_progress: bool | None = None,
    pixels: compare.Pixels = "common",
) -> Compared:
    """Restore views of a scene with several methods, score the restorations, and compare the methods.

    - methods: names of methods or presets, or method objects. To name configurations, give a mapping from each label
      to a name, an object, or options with the name: {"few": {"name": "sucre", "max_observations": 10}};
    - metrics: as in `score`; default those of `sucre-bench run`;
    - views: names, places or views; default all views of the scene;
    - show_progress: True shows progress on stderr, False does not, None shows it in a terminal only;
    - pixels: where methods fill different pixels of a view, "common" compares them on those that all of them fill,
      "own" each on its own.

    If a view cannot be restored, its row has the reason, and the other views continue.

    Raises InputError for an unknown method, option, metric or view, before any work.

    >>> from sucre_bench.engine.python_api import load_scenes
    >>> scene = next(load_scenes("demo", views=2, width=160, height=120))
    >>> compared = compare_methods(scene, ["underwater", "gray_world"], metrics=["psnr"])
    >>> compared.table["psnr"].groupby("method").mean().idxmax()
    'gray_world'
    >>> compared.plot(0, height=120).size
    (652, 120)
    """
    made = _made(methods)
    chosen = [view if isinstance(view, View) else scene[view] for view in (scene if views is None else views)]
    metrics = list(metrics) or _default_metrics()
    metric_choices(metrics)  # raises for a mistyped name, before any view is restored
    tables, held = list[Any](), dict[tuple[str, str], InMemory]()
    with _shown(show_progress):
        for label, method in progress.track(list(made.items()), f"methods on {scene.name}"):
            for view in progress.track(chosen, label):
                rows, restored = _one(scene, view, label, method, metrics)
                tables.append(rows)
                if restored is not None:
                    held[view.name, label] = restored
        rows = _joined(tables)
        common = score_in_memory(chosen, rows, held, metrics) if pixels == "common" else None
    return Compared(scene, tuple(made), rows, {of: restored.picture() for of, restored in held.items()}, common)


def _made(methods: Methods) -> dict[str, Any]:
    """Choices and method objects by label. InputError for an unknown name or option, or a label that is there twice."""
    if isinstance(methods, str):
        raise InputError(f"'{methods}' is one word", "methods", f"give a list, ['{methods}']")
    given = methods.items() if isinstance(methods, Mapping) else ((_name(each), each) for each in methods)
    made: dict[str, Any] = {}
    for label, what in given:
        if label in made:
            raise InputError(f"'{label}' is there twice", "methods", "give a mapping from labels to methods")
        options = dict(what) if isinstance(what, Mapping) else {"name": what}
        name = options.pop("name", label)
        made[label] = _checked(method_choice(name, options)) if isinstance(name, str) else name
    return made


def _checked(choice: Choice) -> Choice:
    """Return the choice. Raises InputError for an option that the method does not take."""
    choice.make()
    return choice


def _name(method: Any) -> str:
    if isinstance(method, Mapping):
        return str(method.get("name", ""))
    return method if isinstance(method, str) else str(method.__plugin__.name)


def _default_metrics() -> list[str]:
    """The metrics of a `run` that names none."""
    return [name for preset in presets("metrics") if preset.name == "default" for name in preset.builds_on]


def _shown(wanted: bool | None) -> AbstractContextManager[None]:
    is_wanted = sys.stderr.isatty() if wanted is None else wanted
    return progress_display.live() if is_wanted and not progress.is_watched() else contextlib.nullcontext()


def _one(
    scene: Scene, view: View, label: str, method: Any, metrics: Sequence[str]
) -> tuple[DataFrame, InMemory | None]:
    """Restore and score one view: its rows, and its picture and mask if there are any."""
    dataset = scene.name
    try:
        result = restore(method, scene, view)
    except SucreBenchError as fault:
        plugin = method.plugin if isinstance(method, Choice) else method.__plugin__
        is_skipped = isinstance(fault, NotApplicableError) or bool(plugins.missing_needs(plugin, scene.has))
        status: results.Status = "skipped" if is_skipped else "failed"
        row = results.Row(dataset=dataset, scene=scene.name, view=view.name, method=label, data_id=scene.data_id)
        return results.frame([row_without_value(row, status, one_line(fault))]), None
    rows = score(result, view, metrics, dataset=dataset)
    return rows.assign(method=label), InMemory.of(to_8bit(result.shown), result.valid)


def _joined(tables: Sequence[DataFrame]) -> DataFrame:
    import pandas as pd

    return pd.concat(tables, ignore_index=True) if tables else results.frame([])


def _eight_bit(view: View, image: Any) -> Picture:
    return to_8bit(display(image, "none", view.encoding))


def _resized(picture: Picture, height: int) -> Picture:
    import cv2

    size = (round(picture.shape[1] * height / picture.shape[0]), height)
    is_smaller = height < picture.shape[0]
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA if is_smaller else cv2.INTER_LINEAR))
