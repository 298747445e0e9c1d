"""A line-up: the datasets, configurations, metrics and settings of a run, as one YAML file that others can run.

    datasets: [demo, {name: colmap, root: dive, label: reef}]
    methods:
      - underwater
      - {name: sucre, label: sucre_physical, physical: true}
    metrics: [psnr, uciqe:all]
    sweep: {degrade.noise: [0, 0.02]}
    baseline: underwater
    every: 4

`sweep` has values of other options, all of which are run. Every other key is an option of `sucre-bench run`.
Experiments are the line-ups of conf/experiment/.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from sucre_bench.jobs.quoting import value_of

Kind = Literal["dataset", "method"]
KINDS: tuple[Kind, ...] = ("dataset", "method")


@dataclass(frozen=True)
class Entry:
    """A dataset, method or metric with options of its own.

    name: of a plugin or a preset; options: also its label and, for a method, its display; for a dataset `degrade`, what
    is done to it first.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """The given label, empty where none is given."""
        return str(self.options.get("label") or "")

    def words(self, group: str) -> Iterator[str]:
        """Yield the overrides of its options. group: where they stand, "method" or "metrics.psnr" say."""
        for name, value in self.options.items():
            if name == "degrade":
                yield from _flat("degrade", value)
            else:
                yield f"{group}.{name}={value_of(value)}"

    @property
    def as_data(self) -> str | dict[str, Any]:
        """As a line-up file has it."""
        return {"name": self.name, **self.options} if self.options else self.name


@dataclass(frozen=True)
class LineUp:
    """What a line-up file says. An empty field says nothing: the command's words or the defaults hold.

    metrics: each named "name" or "name:variant"; sweep: option -> values; settings: other options of a run; place: the
    file, as the user named it.
    """

    datasets: tuple[Entry, ...] = ()
    methods: tuple[Entry, ...] = ()
    metrics: tuple[Entry, ...] = ()
    sweep: Mapping[str, Sequence[Any]] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    place: str = ""

    def entries(self, kind: Kind) -> tuple[Entry, ...]:
        """Its datasets or its methods."""
        return self.datasets if kind == "dataset" else self.methods

    def words(self) -> Iterator[str]:
        """Yield the overrides of all but datasets and methods."""
        if self.metrics:
            yield f"metrics={value_of(list(dict.fromkeys(metric.name for metric in self.metrics)))}"
        for metric in self.metrics:
            yield from metric.words(f"metrics.{metric.name.partition(':')[0]}")
        for name, value in self.settings.items():
            yield from _flat(name, value)
        for key, values in self.sweep.items():
            yield f"{key}={','.join(map(value_of, values))}"

    def as_yaml(self, comment: str = "") -> str:
        """Return the text of its file: an entry a line. comment: its first lines."""
        lines = [f"# {line}" for line in comment.splitlines()]
        for key, entries in (("datasets", self.datasets), ("methods", self.methods)):
            lines += [f"{key}:", *(f"  - {_in_line(entry.as_data)}" for entry in entries)] if entries else []
        if self.metrics:
            lines.append(f"metrics: {_in_line([metric.as_data for metric in self.metrics])}")
        if self.sweep:
            lines += ["sweep:", *(f"  {key}: {_in_line(list(values))}" for key, values in self.sweep.items())]
        lines += [f"{key}: {_in_line(value)}" for key, value in self.settings.items()]
        return "\n".join([*lines, ""])


def _flat(key: str, value: Any) -> Iterator[str]:
    """The overrides of a value: those of a mapping one by one."""
    if isinstance(value, Mapping):
        for name, inner in value.items():
            yield from _flat(f"{key}.{name}", inner)
    else:
        yield f"{key}={value_of(value)}"


def _in_line(value: Any) -> str:
    import yaml

    text = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, allow_unicode=True, width=10**6)
    return text.removesuffix("\n").removesuffix("\n...")
