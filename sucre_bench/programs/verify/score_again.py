"""The metrics that score a bundle again, whether a score agrees with that of the stored picture, and the bundle's data
in the folders that the user names.
"""

import functools
import itertools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

import numpy as np

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.degrade import Degradation, degraded_whole
from sucre_bench.engine.preflight import open_scenes
from sucre_bench.engine.score import Scorer, metric_code, score_rows, scorers
from sucre_bench.errors import ANY_FAULT, InputError, SucreBenchError, one_line
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.jobs.catalogue import metric_choices
from sucre_bench.plugins.options import Choice, options_of, seed_of, typed
from sucre_bench.results.rows import Row, RowCode
from sucre_bench.scene import Restoration, Scene, View

Key = tuple[str, str, str]  # metric, variant, region

# Within the cube of rounding a score may differ more than at its corners: de00 1.08 times, in 1 of 9,776 scores.
_WITHIN = 1.2


def metric_of(metric: str, variant: str, options_hash: str) -> Scorer | str:
    """Return a metric with its default options, or why it cannot compute a score again.

    options_hash: of the options that the score was made with.
    """
    plugin = plugins.get("metric", metric)
    if plugin is None:
        return f"no metric {metric} is registered here; add --plugin FILE"
    if plugin.is_of_pairs:
        return f"{metric} is of several restored views together"
    try:
        choices = metric_choices([f"{metric}:{variant}"])
        (scorer,) = scorers(choices)
    except SucreBenchError as fault:
        return f"{metric}:{variant} cannot be computed here, {one_line(fault)}"
    if RowCode("", metric_code(choices[0])).metric_options != options_hash:
        return f"{metric} was computed with options of its own"
    return scorer


def scores_of(
    restoration: Restoration, shown: np.ndarray, view: View, chosen: Sequence[Scorer]
) -> dict[Key, Row]:
    """Return the rows of a restoration that has a restored image. Its image may be the restored image, too."""
    if view.encoding == "linear":  # metrics get the restoration in the view's encoding
        restoration = replace(
            restoration, image=srgb_decode(restoration.image).astype(np.float32)
        )
    rows = score_rows(restoration, shown, view, chosen, Row())
    return {(row.metric, row.variant, row.region): row for row in rows}


def _difference(one: float, other: float, period: float) -> float:
    apart = abs(one - other)
    return min(apart % period, period - apart % period) if math.isfinite(period) else apart


@dataclass(frozen=True, eq=False)
class Pictured:
    """A restoration whose image is a stored picture, scored again."""

    restoration: Restoration
    """Pixels of its image that have no colour are NaN."""

    step: float
    """Between two levels of the picture; 0 where the scores were made from it."""

    view: View

    scorers: Sequence[Scorer]
    """Metrics, with one variant each."""

    _moved: dict[tuple[str, str], list[dict[Key, Row]]] = field(
        default_factory=dict, init=False
    )

    @functools.cached_property
    def rows(self) -> dict[Key, Row]:
        """Its scores."""
        return scores_of(self.restoration, self.restoration.image, self.view, self.scorers)

    def difference(
        self, scorer: Scorer, key: Key, stored: float, size: float, tolerance: float
    ) -> float:
        """Return how far a stored score is from the one of the picture, as a share of it: if above a tolerance, only
        what rounding does not explain.

        size: the median size of the column; it stands for that of a score near zero.
        """
        row = self.rows[key]
        if stored == row.value:
            return 0.0
        if not math.isfinite(row.value):
            around = self._around(scorer, key)
            # A patch that is gray in 8 bits has no hue, whichever it had before. A picture without any error was
            # rounded to it from what has some.
            is_gray = math.isnan(row.value) and "charts" in scorer.plugin.needs
            is_perfect = any(
                min(one, row.value) <= stored <= max(one, row.value) for one in around
            )
            return 0.0 if around and (is_gray or is_perfect) else math.inf
        period = scorer.plugin.period
        scale = period / 2 if math.isfinite(period) else max(abs(stored), size)
        apart = max(0.0, _difference(stored, row.value, period) - 1e-9)
        if apart > tolerance * scale:
            around = self._around(scorer, key)
            reach = max((_difference(one, row.value, period) for one in around), default=0)
            apart = max(0.0, apart - _WITHIN * reach)
        return apart / scale if apart else 0.0

    def _around(self, scorer: Scorer, key: Key) -> list[float]:
        """Return scores of pictures that differ by rounding, as far as they are finite.

        Rounding moves a pixel, and the median of a patch, by half a step at most. So the unrounded colour is in a cube
        around the one in the picture. All colours are moved to the same corner of their cubes, for each corner, and
        each colour to a corner of its own.
        """
        if not self.step:
            return []
        if key[:2] not in self._moved:
            image = self.restoration.image
            corners = [np.array(one) for one in itertools.product((-1, 1), repeat=3)]
            corners.append(np.random.default_rng(0).choice((-1, 1), image.shape))
            # short of where metrics that round to 8 bits take the next level
            half = np.float32(0.499 * self.step)
            moved = ((image + half * one.astype(np.float32)).clip(0, 1) for one in corners)
            self._moved[key[:2]] = [
                scores_of(replace(self.restoration, image=one), one, self.view, [scorer])
                for one in moved
            ]
        around = [rows[key].value for rows in self._moved[key[:2]] if key in rows]
        return [one for one in around if math.isfinite(one)]


Scenes = dict[tuple[str, str], Scene]  # by dataset label, and name in rows


def open_data(rows: DataFrame, places: Mapping[str, Path]) -> tuple[Scenes, list[str]]:
    """Open the data of rows. places: folder of the data, by dataset label.

    Return the scenes, and a line for each that differs or does not open. A dataset's other options are those of the
    bundle, but none may lead out of the folder. Data that are made, since their dataset needs no folder, are made in
    the user's cache. Nothing is written into `places`.
    """
    scenes: Scenes = {}
    faults: list[str] = []
    known = rows[(rows["view"] != "") & rows["dataset"].isin(places)]
    # A scene of a dataset is the same for all methods, unless the bundle mixes data: then each is checked.
    for row in known.drop_duplicates(["dataset", "scene", "data_id"]).itertuples():
        where = f"{row.dataset} / {row.scene}"
        root = places[row.dataset]
        try:
            scenes[row.dataset, row.scene] = _scene(row, root)
        except SucreBenchError as fault:
            faults.append(f"{where}: {one_line(fault)}")
        except ANY_FAULT as fault:
            # whatever a stranger's options make fail is a fault of that bundle
            faults.append(
                f"{where}: its options cannot be used ({one_line(fault)}); ask who made the bundle"
            )
    return scenes, list(dict.fromkeys(faults))


def _scene(row: Any, root: Path) -> Scene:
    """Return the scene of a row as it was restored. Raises InputError if it does not open, or no data are those."""
    told = json.loads(row.options)
    given = dict(told["dataset"])
    degrade = dict(told.get("degrade", {}))
    replicate = int(told.get("replicate", 0))
    plugin = plugins.find("dataset", str(given.pop("name")))
    known = {option.name: option for option in options_of(plugin.cls)}
    if "root" not in known:
        raise InputError(f"dataset '{plugin.name}' has no option root; leave --data out")
    given.pop("root", None)
    for name, value in {**given, **degrade}.items():
        for text in value if isinstance(value, list) else [value]:
            if isinstance(text, str) and _leads_out(text):  # to any file of this user
                raise InputError(
                    f"option {name}={text} leads out of the data's folder; ask who made the bundle"
                )
    if known["root"].default is not None:
        # without a folder the data are made, in the user's cache: not in `root`
        given["root"] = str(root)
    options = {
        name: typed(known[name].type, value) if name in known else value
        for name, value in given.items()
    }
    seed = seed_of(Degradation.of(degrade).seed, "degrade", replicate)
    drawn = Degradation.of({**degrade, "seed": seed})
    scenes = open_scenes(Choice(plugin, row.dataset, options, replicate=replicate))
    # A scene that is called after a moved folder is renamed.
    name, _ = results.unreplicated(row.scene)
    there = {drawn.data_id(scene.data_id): scene for scene in scenes}
    if not row.data_id or row.data_id not in there:
        fault = f"the data in {root} are {', '.join(there)}, the scores of {row.data_id}"
        raise InputError(f"{fault}; give the folder of the same data")
    return degraded_whole(replace(there[row.data_id], name=name), drawn)


def _leads_out(text: str) -> bool:
    is_absolute = PurePosixPath(text).is_absolute() or PureWindowsPath(text).drive
    return bool(
        is_absolute or text.startswith("~") or ".." in text.replace("\\", "/").split("/")
    )
