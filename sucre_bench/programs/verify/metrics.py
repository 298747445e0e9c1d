"""The registered metrics that score a bundle again, with the options that the bundle's scores were made with."""

import functools
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import plugins
from sucre_bench.engine.score import Scorer, metric_code, score_rows, scorers
from sucre_bench.errors import ANY_FAULT, SucreBenchError
from sucre_bench.jobs.metric_words import MetricChoice, metric_choices
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.plugins.options import options_of, typed
from sucre_bench.results.bundle_format import Bundle
from sucre_bench.results.restorations import Measured
from sucre_bench.results.rows import Row
from sucre_bench.scene import Restoration, View

_CONFIG = "config.yaml"
_MOST_BYTES = 4_000_000  # of a stranger's YAML that is read


class Metrics:
    """The registered metrics, made once each, and which of them the pictures are not enough for."""

    def __init__(self, bundle: Bundle) -> None:
        self._bundle = bundle
        self._known: dict[tuple[str, str, str], Scorer | str] = {}
        self._unrounded: dict[tuple[str, str], bool] = {}

    def of(self, metric: str, variant: str, code: str) -> Scorer | str:
        """Return a metric in one variant, or why it cannot be used. code: of a row; ends in a hash of its options."""
        key = (metric, variant, _options_hash(code))
        if key not in self._known:
            self._known[key] = self._made(*key)
        return self._known[key]

    def _made(self, metric: str, variant: str, options_hash: str) -> Scorer | str:
        plugin = plugins.usable("metric").get(metric)
        if plugin is None:
            return f"no metric {metric} is registered here"
        if plugin.is_of_pairs:
            return f"{metric} is of several restored views together"
        try:
            (plain,) = metric_choices([f"{metric}:{variant}"])
        except SucreBenchError:
            return f"{metric} has no variant {variant} here"
        for choice in self._with_options(plain) if options_hash else [plain]:
            if _options_hash(metric_code(choice)) == options_hash:
                return _scorer(choice)
        return f"the bundle does not say the options of {metric}"

    def _with_options(self, plain: MetricChoice) -> Iterator[MetricChoice]:
        """A metric with its default options, and with each set of options in the bundle's configuration."""
        known = options_of(plain.plugin.cls)
        types = {option.name: option.type for option in known}
        recorded = [given for given in self._recorded if given.get("name") == plain.plugin.name]
        for given in ({option.name: option.default for option in known}, *recorded):
            options = {name: typed(types[name], value) for name, value in given.items() if name in types}
            if options:
                yield replace(plain, choice=replace(plain.choice, options=options))

    @functools.cached_property
    def _recorded(self) -> list[Mapping[str, Any]]:
        """The metrics of the bundle's configuration, each with its name and options; none if it cannot be read."""
        if self._bundle.entries.get(_CONFIG, math.inf) > _MOST_BYTES:
            return []
        try:
            told = read_yaml(self._bundle.read(_CONFIG).decode())
            jobs = [told, *told.get("jobs", [])]
            return [dict(metric) for job in jobs for metric in job.get("metrics", {}).values()]
        except ANY_FAULT:
            return []

    def rests_on_unrounded(self, scorer: Scorer, row: Row, restoration: Restoration, view: View) -> bool:
        """Whether a score changes with the restoration while the restored image stays: the bundle has the latter."""
        key = (row.metric, f"{row.variant}-{scorer.code}")
        if key not in self._unrounded:
            other = replace(restoration, image=restoration.image - np.float32(0.5))
            again = score_rows(Measured(other, math.nan, math.nan), restoration.image, view, [scorer], Row())
            values = {one.region: one.value for one in again if one.metric == row.metric}
            self._unrounded[key] = not _equal(values.get(row.region, math.nan), row.value)
        return self._unrounded[key]


def _options_hash(code: str) -> str:
    """What a metric's code, or that of a row, says of the metric's options; "" where it has none."""
    return code.rpartition(".")[2].partition("-")[2]


def _scorer(choice: MetricChoice) -> Scorer | str:
    """A metric with options of a stranger: they may name no file of this user."""
    name = choice.plugin.name
    if any(isinstance(value, Path) for value in choice.choice.options.values()):
        return f"an option of {name} names a file"
    try:
        (made,) = scorers([choice])
    except SucreBenchError:
        return f"{name} does not accept the bundle's options here"
    return made


def _equal(one: float, other: float) -> bool:
    return one == other or (math.isnan(one) and math.isnan(other)) or math.isclose(one, other, rel_tol=1e-9)
