"""The schema of a command: `RunConfig` and every plugin's options, as Hydra composes them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, field, fields, make_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, one_line
from sucre_bench.jobs.explain import GROUPS
from sucre_bench.jobs.study import Study
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Plugin

__all__ = ["CONF", "CONF_FOLDER", "RunConfig", "Shard", "Tracking", "register"]

CONF = "sucre_bench.conf"
CONF_FOLDER = Path(__file__).parent.parent / "conf"


def register() -> None:
    """Tell Hydra's config store every plugin's options; what cannot be used is left out."""
    from hydra.core.config_store import ConfigStore
    from hydra.core.plugins import Plugins

    from sucre_bench.jobs.slurm_settings import Settings

    Plugins.instance()  # Hydra's own plugins store their settings first; ours replace some
    store = ConfigStore.instance()
    for name, settings in (("basic", OneByOne), ("slurm", Settings), ("submitit_slurm", Settings)):
        store.store(group="hydra/launcher", name=name, node=settings, provider="sucre_bench")
    store.store(name="base_run", node=RunConfig)
    for group, kind in GROUPS.items():
        for plugin in list(plugins.discover(kind).values()):
            if isinstance(plugin, Plugin):
                package = f"metrics.{plugin.name}" if kind == "metric" else group
                try:
                    store.store(group=group, name=plugin.name, node=_schema(plugin), package=package)
                except Exception as fault:  # a default that is not of its option's type, say
                    plugins.set_aside(plugin, one_line(fault))


def _schema(plugin: Plugin) -> type[Any]:
    """A structured config of the plugin's options, and what the bench adds to them."""
    from omegaconf import II
    from omegaconf import MISSING as ASK

    own: list[tuple[str, Any, Any]] = []
    for option in options_of(plugin.cls):
        default = ASK if option.default is MISSING else option.default
        own.append((option.name, _hydra_type(option.type), II("seed") if option.name == "seed" else default))
    added: list[tuple[str, Any, Any]] = [("name", str, plugin.name)]
    if plugin.kind == "metric":
        added += [("variants", list[str], list(plugin.default))]
    else:
        added += [("label", str | None, None)]
    if plugin.kind == "method":
        added += [("display", str, plugin.display)]
    return make_dataclass(
        f"{plugin.cls.__name__}Config", [(name, type_, _field(value)) for name, type_, value in added + own]
    )


def _field(value: Any) -> Any:
    mutable = isinstance(value, (list, tuple))
    return field(default_factory=lambda: list(value)) if mutable else field(default=value)


def _hydra_type(annotation: Any) -> Any:
    """The nearest type OmegaConf can check: it knows neither Literal (checked by `options.check_options`) nor tuple."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return str
    if origin in (Union, UnionType):
        return Union[tuple(_hydra_type(a) for a in args)]  # noqa: UP007
    if origin is tuple or origin is list:
        return list[_hydra_type(args[0])]  # type: ignore[misc]
    return annotation


T = TypeVar("T")


@dataclass
class OneByOne:
    """Options of the launcher that runs the jobs of a sweep in this process: none."""

    _target_: str = "sucre_bench.engine.launch.OneByOne"


@dataclass
class Tracking:
    """Where results are logged besides the table.

    uri: an mlflow tracking URI, default a store in the output folder; "off" logs nowhere; experiment: mlflow's.
    """

    uri: str = "sqlite:///${out}/mlflow.db"
    experiment: str = "sucre_bench"


@dataclass
class Shard:
    """A part of the selected views: block `index` of `count` blocks of neighbours, as equal as may be."""

    index: int = 0
    count: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.index < self.count:
            raise InputError(
                f"shard: block {self.index} of {self.count}; shard.index goes from 0 to shard.count - 1: "
                "shard.count=8 'shard.index=range(8)'"
            )

    def of(self, items: Sequence[T]) -> Sequence[T]:
        """Return this block's items."""
        n = len(items)
        return items[n * self.index // self.count : n * (self.index + 1) // self.count]


# A degradation's options, for Hydra: what is frozen, it would not let anyone override.
_hints = get_type_hints(Degradation)


_Degrade = make_dataclass("Degrade", [(f.name, _hints[f.name], field(default=f.default)) for f in fields(Degradation)])


@dataclass
class RunConfig:
    """What `sucre-bench run` accepts beside dataset, method and metrics.

    pairs_gb: disk space that the jobs of a sweep may use to share pairs while it runs (0: they share none);
    degrade: what is done to the dataset first, the options of `sucre_bench.degrade.Degradation`; replicate: which
    repetition, each with other draws, averaged over when methods are compared; study: the tables and figures that an
    experiment makes of its rows, the fields of `sucre_bench.reports.paper.Study`.
    """

    dataset: Any = field(default_factory=dict)
    method: Any = field(default_factory=dict)
    metrics: dict[str, Any] = field(default_factory=dict)
    out: str = "outputs"
    views: Any = None
    every: int = 1
    first: int | None = None
    overwrite: str = "missing"
    save: str = "display"
    seed: int = 0
    report: bool = True
    plugins: list[str] = field(default_factory=list)
    pairs_gb: float = 8.0
    tracking: Tracking = field(default_factory=Tracking)
    degrade: Any = field(default_factory=_Degrade)
    replicate: int = 0
    shard: Shard = field(default_factory=Shard)
    study: Any = field(default_factory=Study.defaults)
