"""Makes the command that computes a row again, from the columns of the row."""

import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench import plugins
from sucre_bench.jobs.labels import undegraded_label
from sucre_bench.jobs.quoting import value_of
from sucre_bench.plugins.options import options_of, plain_value
from sucre_bench.plugins.plugin import Kind


@dataclass(frozen=True)
class Rerun:
    """How a method was run on a dataset, as a row tells it.

    dataset, method: their labels; options: of the row, as `results.Row` keeps them; seed: the row's; files: plugins
    that were loaded from a file. A row of before datasets were kept in it has no command.
    """

    dataset: str
    method: str
    options: Mapping[str, Any]
    seed: int
    files: tuple[str, ...] = ()

    def words(self) -> list[str]:
        """The command's words up to the views and metrics, without quotes; empty where the row does not tell them."""
        dataset: Mapping[str, Any] = self.options.get("dataset") or {}
        if "name" not in dataset or "name" not in self.options:
            return []
        said = ["sucre-bench", "run", *(word for file in self.files for word in ("--plugin", file))]
        said += self._choice("dataset", dataset, undegraded_label(self.dataset, self._degrade, str(dataset["name"])))
        said += [f"degrade.{name}={value_of(value)}" for name, value in self._degrade.items()]
        said += self._choice("method", self.method_record, self.method)
        if replicate := self.options.get("replicate"):
            said.append(f"replicate={replicate}")
        if self.seed and "seed" not in self.options:
            said.append(f"seed={self.seed}")
        return [*said, "out=again"]

    @property
    def method_record(self) -> dict[str, Any]:
        """The method's name, display and options."""
        return {name: value for name, value in self.options.items() if name not in ("dataset", "degrade", "replicate")}

    def given(self) -> dict[str, Any]:
        """The method's options that are not as they are by default."""
        return {k: v for k, v in given("method", self.method_record).items() if k != "name"}

    @property
    def _degrade(self) -> Mapping[str, Any]:
        return self.options.get("degrade") or {}

    @staticmethod
    def _choice(kind: Kind, record: Mapping[str, Any], label: str) -> Iterator[str]:
        yield f"{kind}={value_of(record['name'])}"
        for name, value in given(kind, record).items():
            if name != "name":
                yield f"{kind}.{name}={value_of(value)}"
        if label != record["name"]:
            yield f"{kind}.label={value_of(label)}"


def given(kind: Kind, record: Mapping[str, Any], seed: int = 0) -> dict[str, Any]:
    """Return what differs in a record from the plugin's defaults; everything where the plugin is not there to be asked.

    seed: the run's, which a plugin has that was given none.
    """
    plugin = plugins.usable(kind).get(str(record.get("name")))
    if plugin is None:
        return dict(record)
    defaults: dict[str, Any] = {option.name: option.default for option in options_of(plugin.cls)}
    defaults |= {"seed": seed, "display": plugin.display}  # of the run, unless it is given
    return {name: value for name, value in record.items() if plain_value(defaults.get(name, ...)) != value}


def metric_words(metric: str, variants: Collection[str]) -> list[str]:
    """The words that ask for variants of a metric, beside its name in metrics=[...]."""
    plugin = plugins.usable("metric").get(metric)
    is_default = plugin is not None and set(variants) == set(plugin.default)
    return [] if is_default else [f"metrics.{metric}.variants={value_of(list(variants))}"]


def shell(words: Sequence[str]) -> str:
    """Words as a shell takes them."""
    return " ".join(map(_shell_word, words))


def _shell_word(word: str) -> str:
    """In double quotes if the word has single ones, and nothing that a shell would read within double ones."""
    return f'"{word}"' if "'" in word and not set(word) & set('"$`\\!') else shlex.quote(word)
