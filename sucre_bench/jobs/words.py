"""Words of a command: values in Hydra's grammar, and the command that makes a row again."""

import re
import shlex
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.plugins.options import options_of, plain_value
from sucre_bench.plugins.plugin import Kind

# Words that Hydra does not read as text, in any case.
_NO_TEXT = frozenset({"true", "false", "null", "nan", "inf"})


def quoted(text: str) -> str:
    """Return any text as the value of an override: bare if Hydra reads that as the same text, else in quotes.

    Backslashes are doubled right before a quote, and before ``${``, which is escaped: it would be interpolated. All
    others are read as they are.
    """
    is_number = re.fullmatch(r"\.[\d_]+(e[+-]?\d+)?", text, re.IGNORECASE)
    if re.fullmatch(r"[A-Za-z_./][\w./-]*", text, re.ASCII) and text.lower() not in _NO_TEXT and not is_number:
        return text
    literal = re.sub(r"(\\*)\$\{", lambda found: found[1] * 2 + r"\${", text)
    return "'" + re.sub(r"(\\*)('|$)", lambda found: found[1] * 2 + (r"\'" if found[2] else ""), literal) + "'"


def value_of(value: Any) -> str:
    """Return a value, of an option as rows keep it, as Hydra reads it back."""
    if value is None:
        return "null"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (list, tuple)):
        return f"[{','.join(map(value_of, value))}]"
    if isinstance(value, Mapping):
        return "{" + ",".join(f"{k}:{value_of(v)}" for k, v in value.items()) + "}"
    return quoted(value) if isinstance(value, str) else repr(value)


def undegraded_label(label: str, degrade: Mapping[str, Any], name: str) -> str:
    """Return a dataset's label without what a degradation adds to it; name: of the dataset, where nothing is left."""
    suffix = Degradation.of(degrade).labelled("") if degrade else ""
    return label.removesuffix(suffix) or name


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
    """Words as a shell takes them: in double quotes where a word has single ones and nothing that is read within."""
    has_quote = ("'" in word and not set(word) & set('"$`\\!') for word in words)
    return " ".join(f'"{w}"' if double else shlex.quote(w) for w, double in zip(words, has_quote, strict=True))
