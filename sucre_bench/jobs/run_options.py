"""The options of `sucre-bench run` and their defaults: `RunConfig`, and those of plugins, as Hydra composes them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, dataclass, field, is_dataclass, make_dataclass
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, TypeVar, Union, get_args, get_origin

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import InputError, one_line
from sucre_bench.jobs.shard import Shard
from sucre_bench.jobs.study_block import Study
from sucre_bench.plugins.options import check_values, options_of
from sucre_bench.plugins.plugin import Kind, Plugin
from sucre_bench.plugins.ranges import check_ranges

if TYPE_CHECKING:
    from hydra.core.config_store import ConfigStore

CONF = "sucre_bench.conf"
CONF_FOLDER = Path(__file__).parent.parent / "conf"
# Hydra's groups of plugins.
GROUPS: dict[str, Kind] = {"method": "method", "dataset": "dataset", "metrics": "metric"}


class _Schemas(dict[str, Any]):
    """Hydra's store, and the plugins whose options it has: group and name to plugin.

    Hydra copies its store for each job that it composes, and only reads the copy.
    """

    plugins: dict[tuple[str, str], Plugin]

    def __deepcopy__(self, memo: object) -> _Schemas:
        return self


def register() -> None:
    """Tell Hydra's config store the options of every plugin, and of no other; what cannot be used is left out."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    if not isinstance(store.repo, _Schemas):
        _store_settings(store)
        store.repo = _Schemas(store.repo)
        store.repo.plugins = {}
    stored = store.repo.plugins
    usable = {(group, name): plugin for group, kind in GROUPS.items() for name, plugin in plugins.usable(kind).items()}
    for group, name in [key for key, plugin in stored.items() if usable.get(key) is not plugin]:
        del store.repo[group][f"{name}.yaml"], stored[group, name]
    for (group, name), plugin in usable.items():
        if (group, name) not in stored:
            package = f"metrics.{name}" if plugin.kind == "metric" else group
            try:
                store.store(group=group, name=name, node=_schema(plugin), package=package)
            except Exception as fault:  # a default that is not of its option's type, say
                plugins.set_aside(plugin, one_line(fault))
            else:
                stored[group, name] = plugin


def _store_settings(store: ConfigStore) -> None:
    """Store what is the same for every command: the launchers' options and the keys of `run`."""
    from hydra.core.plugins import Plugins

    from sucre_bench.jobs.slurm_settings import Settings

    Plugins.instance()  # Hydra's own plugins store their settings first; ours replace some
    for name, settings in (("basic", OneByOneSettings), ("slurm", Settings), ("submitit_slurm", Settings)):
        store.store(group="hydra/launcher", name=name, node=settings, provider="sucre_bench")
    store.store(name="base_run", node=_run_schema())


def _schema(plugin: Plugin) -> type[Any]:
    """A structured config of the plugin's options, and what the bench adds to them."""
    from omegaconf import II
    from omegaconf import MISSING as ASK

    options: list[tuple[str, Any, Any]] = []
    for option in options_of(plugin.cls):
        default = ASK if option.default is MISSING else option.default
        options.append((option.name, _hydra_type(option.type), II("seed") if option.name == "seed" else default))
    added: list[tuple[str, Any, Any]] = [("name", str, plugin.name)]
    if plugin.kind == "metric":
        added += [("variants", list[str], list(plugin.default))]
    else:
        added += [("label", str | None, None)]
    if plugin.kind == "method":
        added += [("display", str, plugin.display)]
    return make_dataclass(
        f"{plugin.cls.__name__}Config", [(name, type_, _field(value)) for name, type_, value in added + options]
    )


def _field(value: Any) -> Any:
    if isinstance(value, (list, tuple)):
        return field(default_factory=lambda: list(value))
    return field(default_factory=lambda: value) if is_dataclass(value) or value == {} else field(default=value)


def _hydra_type(annotation: Any) -> Any:
    """The nearest type that OmegaConf can check.

    It knows neither Literal, which `options.check_values` checks, nor tuple, nor a choice that includes lists.
    """
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Mapping or any(get_origin(arg) is Sequence for arg in args):
        return Any
    if origin is Sequence:
        return list[args[0]]  # type: ignore[valid-type]
    if origin is Literal:
        return str
    if origin in (Union, UnionType):
        return Union[tuple(_hydra_type(a) for a in args)]  # noqa: UP007
    if origin is tuple or origin is list:
        return list[_hydra_type(args[0])]  # type: ignore[misc]
    return annotation


T = TypeVar("T")


@dataclass
class OneByOneSettings:
    """Options of the launcher that runs the jobs of a sweep in this process: none."""

    _target_: str = "sucre_bench.engine.launch.OneByOne"


@dataclass
class Tracking:
    """Where mlflow logs the run."""

    uri: str = "sqlite:///${out}/mlflow.db"
    """mlflow's tracking URI; the default is a store in the results folder. off: no mlflow."""
    experiment: str = "sucre_bench"
    """Name of the experiment in mlflow."""


Overwrite = Literal["missing", "failed", "always", "never"]
Save = Literal["display", "full"]


@dataclass(frozen=True)
class RunConfig:
    """The keys of `sucre-bench run`."""

    dataset: Mapping[str, Any] = field(default_factory=dict)
    """The dataset's name, label and options."""
    method: Mapping[str, Any] = field(default_factory=dict)
    """The method's name, label, display and options."""
    metrics: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    """Each metric's name, variants and options."""
    out: str = "outputs"
    """The results folder. A second run with the same folder adds to it."""
    views: str | Sequence[str] | None = None
    """Only these views, by name, or a .txt file with one name a line; null: all views."""
    every: int = 1
    """Only every Nth view; 1: every view."""
    first: int | None = None
    """Only the first N views; null: all views."""
    overwrite: Overwrite = "missing"
    """missing: restore views that have no result, failed, or are out of date; failed: also views at which the process
    died; always: all views; never: only views without a result."""
    view_timeout_s: float | None = None
    """Most seconds of a method for a view, and of a metric for a score; longer ones fail. null: no limit."""
    save: Save = "display"
    """display: write restored images; full: also J, B, beta and gamma (.npz), for metrics that you add later."""
    seed: int = 0
    """Seed of datasets and methods that draw random numbers."""
    report: bool = True
    """Write the page of the results folder; false: write none."""
    plugins: Sequence[str] = ()
    """Python files with plugins."""
    pairs_gb: float = 8.0
    """Most GB of disk for the pairs that the jobs of a sweep share while it runs; 0: share none."""
    cache_gb: float = 8.0
    """Most GB of disk for decoded images and depth maps while a run lasts; 0: decode files each time."""
    cache_keep: bool = False
    """Keep decoded images and depth maps in the results folder for the next run."""
    tracking: Tracking = field(default_factory=Tracking)
    """Where results are logged besides the table."""
    degrade: Degradation = field(default_factory=Degradation)
    """How the dataset is degraded before methods see it."""
    replicate: int = 0
    """Number of the repetition. Each has other random draws; comparisons average over them."""
    shard: Shard = field(default_factory=Shard)
    """A part of the views."""
    study: Study | None = None
    """The tables and figures that an experiment makes of its rows."""
    baseline: str = ""
    """Label of the method that the others are compared with; empty: the best method."""

    def __post_init__(self) -> None:
        check_ranges(self, "", every="[1, inf)", first="[1, inf)", replicate="[0, inf)", pairs_gb="[0, inf)")
        check_ranges(self, "", cache_gb="[0, inf)", view_timeout_s="(0, inf)")
        if not self.out.strip():
            raise InputError("is empty", "out", "name a folder, for example out=results")

    @classmethod
    def of(cls, values: Mapping[str, Any]) -> RunConfig:
        """Read a resolved configuration. Raises InputError for an unknown option, or a value that is not acceptable."""
        nested: dict[str, Callable[[Any], Any]] = {
            "tracking": lambda given: Tracking(**given),
            "degrade": Degradation.of,
            "shard": lambda given: Shard(**given),
            "study": lambda given: None if given in (None, Study.defaults()) else Study.of(given),
        }
        check_values("", options_of(cls), values, "see `sucre-bench run --help`")
        options: dict[str, Any] = {k: nested[k](value) if k in nested else value for k, value in values.items()}
        return cls(**options)


def _run_schema() -> type[Any]:
    """`RunConfig` as Hydra can hold it: unfrozen, with the options of no study, and plugins of any kind."""
    fields_ = []
    for option in options_of(RunConfig):
        if option.name == "degrade":
            one: tuple[Any, Any] = _unfrozen(Degradation), field(default_factory=_unfrozen(Degradation))
        elif option.name == "study":
            one = Any, field(default_factory=Study.defaults)
        else:
            one = _hydra_type(option.type), _field(option.default)
        fields_.append((option.name, *one))
    return make_dataclass("RunSchema", fields_)


@functools.cache
def _unfrozen(cls: type[Any]) -> type[Any]:
    """A copy of a frozen dataclass that Hydra lets users override."""
    return make_dataclass(cls.__name__, [(o.name, o.type, _field(o.default)) for o in options_of(cls)])
