"""What Hydra composes from: options of `run`, of every plugin and of the launchers, as structured configurations."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, is_dataclass, make_dataclass
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

from sucre_bench import plugins
from sucre_bench.degrade import Degradation
from sucre_bench.errors import one_line
from sucre_bench.jobs.run_options import RunConfig, Study
from sucre_bench.plugins.options import options_of
from sucre_bench.plugins.plugin import Kind, Plugin

if TYPE_CHECKING:
    from hydra.core.config_store import ConfigStore

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

    Plugins.instance()  # Hydra's own plugins store their settings first; ours replace some
    for name, settings in (("basic", OneByOneSettings), ("slurm", SlurmSettings), ("submitit_slurm", SlurmSettings)):
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


@dataclass
class OneByOneSettings:
    """Options of the launcher that runs the jobs of a sweep on this machine, `workers` at a time: none."""

    _target_: str = "OneByOne"


@dataclass
class SlurmSettings:
    """Options of ``hydra.launcher``, named as in Hydra's own launcher for SLURM.

    timeout_min: time limit of a job; cpus_per_task: processors of a job, and so its threads; mem_gb: memory of a job,
    default the cluster's; array_parallelism: most jobs at work at once; setup: shell lines before the job;
    additional_parameters: any other parameter of sbatch, by its long name; signal_delay_s: how many seconds before its
    time limit a job gets the signal to stop (at most a quarter of the limit); latency_s: most seconds until a result is
    visible through a shared file system. A job that has ended and has no visible result after that time is lost. The
    others are sbatch's.
    """

    _target_: str = "sucre_bench.engine.slurm.launcher.Launcher"
    timeout_min: int = 60
    cpus_per_task: int = 1
    mem_gb: float | None = None
    partition: str | None = None
    account: str | None = None
    qos: str | None = None
    constraint: str | None = None
    exclude: str | None = None
    gres: str | None = None
    gpus_per_node: int | None = None
    mem_per_cpu: str | None = None
    comment: str | None = None
    name: str = "sucre_bench"
    array_parallelism: int = 256
    setup: list[str] = field(default_factory=list)
    additional_parameters: dict[str, Any] = field(default_factory=dict)
    signal_delay_s: int = 120
    latency_s: float = 30.0
    submitit_folder: str = "${hydra.sweep.dir}/slurm"


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
