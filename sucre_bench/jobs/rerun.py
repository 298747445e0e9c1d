"""The command that makes a row again."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.jobs.word_syntax import value_of
from sucre_bench.plugins.options import options_of, plain_value
from sucre_bench.plugins.plugin import Kind


def undegraded_label(label: str, degrade: Mapping[str, Any], name: str) -> str:
    """Return a dataset's label without what a degradation adds to it; name: of the dataset, where nothing is left."""
    suffix = Degradation.of(degrade).labelled("") if degrade else ""
    return label.removesuffix(suffix) or name


@dataclass(frozen=True)
class Rerun:
    """How a method was run on a dataset, as a row tells it.

    A row that was written before rows kept the dataset has no command.
    """

    # Labels.
    dataset: str
    method: str

    options: Mapping[str, Any]
    """Of the row, as `results.Row` keeps them."""

    seed: int
    """Of the row."""

    files: tuple[str, ...] = ()
    """Those that plugins were loaded from."""

    def words(self) -> list[str]:
        """The command's words up to the views and metrics, without quotes; empty where the row does not tell them."""
        dataset: Mapping[str, Any] = self.options.get("dataset") or {}
        if "name" not in dataset or "name" not in self.options:
            return []
        degrade = self.options.get("degrade") or {}
        label = undegraded_label(self.dataset, degrade, str(dataset["name"]))
        settings = {
            **_choosing("dataset", dataset, label),
            **{f"degrade.{name}": value for name, value in degrade.items()},
            **_choosing("method", self.method_record, self.method),
        }
        if replicate := self.options.get("replicate"):
            settings["replicate"] = replicate
        if self.seed and "seed" not in self.options:
            settings["seed"] = int(self.seed)
        files = [word for file in self.files for word in ("--plugin", file)]
        said = [f"{key}={value_of(value)}" for key, value in settings.items()]
        return ["sucre-bench", "run", *files, *said, "out=again"]

    @property
    def method_record(self) -> dict[str, Any]:
        """The method's name, display and options."""
        return {
            name: value
            for name, value in self.options.items()
            if name not in ("dataset", "degrade", "replicate")
        }

    def given(self) -> dict[str, Any]:
        """The method's options that are not as they are by default."""
        return given("method", self.method_record)


def _choosing(kind: Kind, record: Mapping[str, Any], label: str) -> dict[str, Any]:
    """The settings that choose a dataset or method with the options of a record."""
    changed = given(kind, record)
    if label != record["name"]:
        changed["label"] = label
    return {kind: record["name"], **{f"{kind}.{name}": v for name, v in changed.items()}}


def given(kind: Kind, record: Mapping[str, Any], seed: int = 0) -> dict[str, Any]:
    """Return the options that differ from the plugin's defaults; all of them where the plugin is not there to be asked.

    seed: the run's, which a plugin has that was given none.
    """
    plugin = plugins.get(kind, str(record.get("name")))
    defaults: dict[str, Any] = {}
    if plugin:
        defaults = {option.name: option.default for option in options_of(plugin.cls)}
        # of the run, unless it is given
        defaults |= {"seed": seed, "display": plugin.display}
    return {
        name: v
        for name, v in record.items()
        if name != "name" and plain_value(defaults.get(name, ...)) != v
    }


def metric_words(metric: str, variants: Collection[str]) -> list[str]:
    """The words that ask for variants of a metric, beside its name in metrics=[...]."""
    plugin = plugins.get("metric", metric)
    is_default = plugin is not None and set(variants) == set(plugin.default)
    return [] if is_default else [f"metrics.{metric}.variants={value_of(list(variants))}"]
