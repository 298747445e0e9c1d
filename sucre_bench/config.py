"""Configuration: Hydra's, with the plugins' own fields as its schema.

Every method, dataset and metric becomes an option of the group of its kind, typed by its dataclass, so that a wrong
name or type is found before any work. `jobs` turns command-line overrides, sweeps included, into validated `Job`s.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, field, fields, make_dataclass
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

from sucre_bench import plugins
from sucre_bench.colour import check_display
from sucre_bench.errors import InputError, SucreBenchError, did_you_mean, one_line
from sucre_bench.layout import file_name
from sucre_bench.plugins import Broken, Kind, Plugin

if TYPE_CHECKING:
    from omegaconf import DictConfig

__all__ = ["CONF", "Choice", "Job", "MetricChoice", "Sweep", "compose", "jobs", "metric_choices", "register"]

CONF = "sucre_bench.conf"
_GROUP: dict[Kind, str] = {"method": "method", "dataset": "dataset", "metric": "metrics"}
_KINDS: dict[str, Kind | None] = {**{group: kind for kind, group in _GROUP.items()}, "experiment": None}
_RESERVED = {"name", "label", "display", "variants"}  # set by the bench beside a plugin's own options


@dataclass
class Tracking:
    """Where results are logged besides the table.

    uri: an mlflow tracking URI, default a store in the output folder; "off" logs nowhere.
    """

    uri: str = "sqlite:///${out}/mlflow.db"
    experiment: str = "sucre_bench"
    parent_run: str = ""


@dataclass
class RunConfig:
    """What `sucre-bench run` accepts beside dataset, method and metrics."""

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
    tracking: Tracking = field(default_factory=Tracking)


# -- from plugins to schema --------------------------------------------------------------------------------


def register() -> None:
    """Tell Hydra's config store every plugin's options; what does not import is left out."""
    from hydra.core.config_store import ConfigStore

    store = ConfigStore.instance()
    store.store(name="base_run", node=RunConfig)
    for kind, group in _GROUP.items():
        for plugin in plugins.discover(kind).values():
            if isinstance(plugin, Plugin):
                package = f"metrics.{plugin.name}" if kind == "metric" else group
                store.store(group=group, name=plugin.name, node=_schema(plugin), package=package)


def _schema(plugin: Plugin) -> type[Any]:
    """A structured config of the plugin's options, and what the bench adds to them."""
    from omegaconf import II
    from omegaconf import MISSING as ASK

    own: list[tuple[str, Any, Any]] = []
    for option in plugins.options(plugin.cls):
        if option.name in _RESERVED:
            raise InputError(f"{plugin.name}.{option.name}: a reserved name; call the option something else")
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
    mutable = isinstance(value, (list, tuple, dict))
    return field(default_factory=lambda: list(value)) if mutable else field(default=value)


def _hydra_type(annotation: Any) -> Any:
    """The nearest type OmegaConf can check: it knows neither Literal (checked by `plugins.create`) nor tuple."""
    origin, args = get_origin(annotation), get_args(annotation)
    if origin is Literal:
        return str
    if origin in (Union, UnionType):
        return Union[tuple(_hydra_type(a) for a in args)]  # noqa: UP007
    if origin is tuple or origin is list:
        return list[_hydra_type(args[0])]  # type: ignore[misc]
    return annotation


# -- from overrides to jobs --------------------------------------------------------------------------------


@dataclass(frozen=True)
class Choice:
    """A plugin with the options it is to be made with. display: a method's normalisation, else empty."""

    plugin: Plugin
    label: str
    options: Mapping[str, Any]
    display: str = ""

    def make(self) -> Any:
        """Create the plugin. InputError when an option is not acceptable."""
        return plugins.create(self.plugin, self.options)

    @property
    def record(self) -> dict[str, Any]:
        """What a row keeps as options."""
        display = {"display": self.display} if self.display else {}
        return {"name": self.plugin.name, **display, **{k: _plain(v) for k, v in self.options.items()}}


@dataclass(frozen=True)
class MetricChoice:
    """A metric and the variants of it to compute."""

    choice: Choice
    variants: tuple[str, ...]

    @property
    def plugin(self) -> Plugin:
        return self.choice.plugin


@dataclass(frozen=True)
class Job:
    """One dataset, one method, some metrics: what one Hydra job does."""

    dataset: Choice
    method: Choice
    metrics: tuple[MetricChoice, ...]
    out: Path
    views: tuple[str, ...] | None
    every: int
    first: int | None
    overwrite: str
    save: str
    seed: int
    report: bool
    tracking: Tracking
    config: str  # as YAML, resolved

    @classmethod
    def of(cls, config: DictConfig) -> Job:
        """Read a composed configuration. InputError for what its types alone cannot tell."""
        import yaml
        from omegaconf import OmegaConf

        values: dict[str, Any] = OmegaConf.to_container(config, resolve=True)  # type: ignore[assignment]
        values.pop("hydra", None)
        _only_known("the configuration", values, {f.name for f in fields(RunConfig)})
        for name, choices in (("overwrite", ("missing", "always", "never")), ("save", ("display", "full"))):
            if values[name] not in choices:
                raise InputError(f"{name}={values[name]}: not a choice; {did_you_mean(values[name], choices)}")
        if values["every"] < 1:
            raise InputError(f"every={values['every']}: at least 1; every=5 takes each fifth view")
        if values["first"] is not None and values["first"] < 1:
            raise InputError(f"first={values['first']}: at least 1; first=5 takes the first five views")
        return cls(
            dataset=_choice("dataset", values["dataset"]),
            method=_choice("method", values["method"]),
            metrics=_metrics(values["metrics"]),
            out=Path(values["out"]),
            views=_view_names(values["views"]),
            every=values["every"],
            first=values["first"],
            overwrite=values["overwrite"],
            save=values["save"],
            seed=values["seed"],
            report=values["report"],
            tracking=Tracking(**values["tracking"]),
            config=yaml.safe_dump(_plain_tree(values), sort_keys=False, allow_unicode=True),
        )


@dataclass(frozen=True)
class Sweep:
    """What a command asks for.

    overrides: as Hydra takes them; multirun: whether it is a sweep; in_process: its jobs run one by one, here.
    """

    jobs: tuple[Job, ...]
    overrides: tuple[str, ...]
    multirun: bool
    in_process: bool = True


def _choice(kind: Kind, values: dict[str, Any]) -> Choice:
    values = dict(values)
    if "name" not in values:
        raise InputError(f"no {kind} is chosen; add {kind}=NAME, `sucre-bench list {kind}s` shows what there is")
    plugin = plugins.find(kind, values.pop("name"))
    label, display = values.pop("label", None), values.pop("display", "")
    if display:
        check_display(display)
    types = {o.name: o.type for o in plugins.options(plugin.cls)}
    _only_known(plugin.name, values, set(types))
    given = {name: value for name, value in values.items() if value != "???"}  # OmegaConf's sign for "not given"
    options = {name: _typed(types[name], value) for name, value in given.items()}
    plugins.check_options(plugin, options)
    return Choice(plugin, label or _label(plugin, options, display), options, display)


def _only_known(place: str, given: Iterable[str], known: set[str]) -> None:
    for name in given:
        if name not in known:
            raise InputError(f"{name}: no option of {place}; {did_you_mean(name, known)}")


def _typed(annotation: Any, value: Any) -> Any:
    if isinstance(value, list) and (get_origin(annotation) is tuple or annotation is tuple):
        return tuple(value)
    wants_path = Path in (annotation, *get_args(annotation))
    return Path(value).expanduser() if wants_path and isinstance(value, str) else value


def _label(plugin: Plugin, options: Mapping[str, Any], display: str) -> str:
    """The plugin's name and every option that is not at its default, but for places on this machine."""
    changed = [
        f"{o.name}={_plain(options[o.name])}"
        for o in plugins.options(plugin.cls)
        if o.name in options and o.default is not MISSING and options[o.name] != o.default
        if not isinstance(options[o.name], Path)
    ]
    if display != plugin.display and plugin.kind == "method":
        changed.append(f"display={display}")
    return ",".join([plugin.name, *changed]).replace(" ", "").replace("/", "_")


def _plain(value: Any) -> Any:
    """As a row or a label keeps it."""
    if isinstance(value, Path):
        return str(value)
    return list(value) if isinstance(value, tuple) else value


def _plain_tree(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain_tree(inner) for key, inner in value.items()}
    return [_plain_tree(inner) for inner in value] if isinstance(value, (list, tuple)) else _plain(value)


def _metrics(values: Mapping[str, Any]) -> tuple[MetricChoice, ...]:
    chosen = []
    for given in values.values():
        variants = tuple(given["variants"])
        choice = _choice("metric", {k: v for k, v in given.items() if k != "variants"})
        chosen.append(MetricChoice(choice, _variants(choice.plugin, variants)))
    if not chosen:
        raise InputError("no metric is chosen; add metrics=[NAME,...], `sucre-bench list metrics` shows what there is")
    return tuple(chosen)


def metric_choices(names: Sequence[str]) -> tuple[MetricChoice, ...]:
    """Read "name", "name:variant" and "name:all", as Python and `sucre-bench score` take them."""
    chosen: dict[str, list[str]] = {}
    for text in names:
        name, _, variant = text.partition(":")
        plugin = plugins.find("metric", name)
        chosen.setdefault(name, []).extend([variant] if variant else plugin.default)
    return _metrics({name: {"name": name, "variants": variants} for name, variants in chosen.items()})


def _variants(plugin: Plugin, names: Sequence[str]) -> tuple[str, ...]:
    if "all" in names:
        return tuple(plugin.variants)
    for name in names:
        if name not in plugin.variants:
            raise InputError(f"{plugin.name}: no variant '{name}'; {did_you_mean(name, plugin.variants)}")
    return tuple(dict.fromkeys(names))


def _view_names(given: Any) -> tuple[str, ...] | None:
    """A list of names, one name, or the path of a text file with one name a line."""
    if given is None:
        return None
    names = [str(n) for n in given] if isinstance(given, list) else [str(given)]
    if len(names) == 1 and names[0].endswith(".txt"):
        path = Path(names[0]).expanduser()
        if not path.is_file():
            raise InputError(f"{path}: no such list of views; give a text file with one view name a line")
        try:
            names = [line.strip() for line in path.read_text(encoding="utf-8").splitlines() if line.strip()]
        except (OSError, UnicodeDecodeError) as fault:
            raise InputError(f"{path}: not a list of views, {one_line(fault)}; save it as UTF-8 text") from fault
    if not names:
        raise InputError("views: an empty list; name some views, or leave views= out for all of them")
    return tuple(names)


@contextmanager
def _hydra() -> Iterator[None]:
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    register()
    GlobalHydra.instance().clear()
    with initialize_config_module(CONF, version_base="1.3"):
        yield


def compose(overrides: Sequence[str]) -> DictConfig:
    """Compose the configuration of one job. Raises InputError in words of ours."""
    with _hydra():
        return _compose(list(overrides))


def jobs(overrides: Sequence[str], multirun: bool) -> Sweep:
    """Read overrides, expand what they sweep over, and validate every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or two jobs of one label.
    """
    with _hydra():
        expanded, multirun = _expand(list(overrides), multirun)
        planned = tuple(Job.of(_compose(one)) for one in expanded)
        launcher = _compose(expanded[0], hydra=True).hydra.launcher
    _distinct(planned)
    return Sweep(planned, tuple(overrides), multirun, str(launcher.get("_target_", "")).endswith("BasicLauncher"))


def _expand(overrides: list[str], multirun: bool) -> tuple[list[list[str]], bool]:
    """The overrides of every job: what the command line and an experiment's own sweep span."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException
    from hydra.types import RunMode

    try:
        parsed = OverridesParser.create().parse_overrides(overrides)
    except HydraException as fault:
        raise InputError(f"{_first_line(fault)}; an override reads key=value") from fault
    for override in parsed:  # Hydra takes a missing experiment for none at all
        if override.key_or_group == "experiment" and not override.is_sweep_override():
            _check_names("experiment", override.value())
    swept = [o for o in parsed if o.is_sweep_override()]
    fixed = [o.input_line or "" for o in parsed if not o.is_sweep_override()]
    # How to sweep is Hydra's and the experiment's to say; the rest may only make sense with the values swept over.
    deciding = [o for o in parsed if o.is_hydra_override() or o.key_or_group == "experiment"]
    base = _compose([o.input_line or "" for o in deciding if not o.is_sweep_override()], hydra=True)
    multirun = multirun or base.hydra.mode == RunMode.MULTIRUN
    if not multirun:
        if swept:
            raise InputError(f"{swept[0].input_line}: several values; add -m to run them all")
        return [fixed], False
    own = [f"{key}={value}" for key, value in (base.hydra.sweeper.get("params") or {}).items()]
    everything = OverridesParser.create().parse_overrides([*own, *overrides])
    try:
        (batch,) = BasicSweeper.split_arguments([o for o in everything if not o.is_hydra_override()], None)
    except HydraException:  # another sweeper decides the values as it goes; only what is fixed can be checked
        return [fixed], True
    settings = [o.input_line or "" for o in everything if o.is_hydra_override()]
    return [settings + one for one in batch], True


def _compose(overrides: list[str], hydra: bool = False) -> DictConfig:
    import hydra as hydra_module
    from hydra.errors import HydraException
    from omegaconf import DictConfig
    from omegaconf.errors import OmegaConfBaseException

    try:
        config = hydra_module.compose("config", overrides=overrides, return_hydra_config=hydra)
    except (HydraException, OmegaConfBaseException) as fault:
        raise _in_our_words(fault, overrides) from fault
    assert isinstance(config, DictConfig)
    return config


def _in_our_words(fault: Exception, overrides: list[str]) -> SucreBenchError:
    """What is wrong with these overrides: the first wrong name, unknown key or wrong type."""
    from hydra.core.override_parser.overrides_parser import OverridesParser

    parsed = [o for o in OverridesParser.create().parse_overrides(overrides) if not o.is_hydra_override()]
    for override in parsed:
        if override.key_or_group in _KINDS:
            try:
                _check_names(override.key_or_group, override.value())
            except SucreBenchError as wrong:
                return wrong
    values = [o for o in parsed if o.key_or_group not in _KINDS]
    groups = [o.input_line or "" for o in parsed if o not in values]
    for override in values:
        if unknown := _unknown_key(override.key_or_group, groups):
            return unknown
    cause = fault.__cause__ or fault
    key = re.search(r"full_key: (\S+)", str(cause))
    return InputError(f"{key[1] + ': ' if key else ''}{_first_line(cause)}; mend the override")


def _check_names(group: str, value: Any) -> None:
    kind = _KINDS[group]
    names = [str(n) for n in (value if isinstance(value, list) else [value])]
    presets = _presets(group)
    for name in names:
        if name in presets or name in ("None", "null"):
            continue
        if kind is None:
            raise InputError(f"no experiment is called '{name}'; {did_you_mean(name, presets)}")
        known = plugins.discover(kind)
        if isinstance(known.get(name), Broken):
            plugins.find(kind, name)  # raises with the reason
        if name not in known:
            raise InputError(f"no {kind} is called '{name}'; {did_you_mean(name, {*known, *presets})}")


def _presets(group: str) -> list[str]:
    """The names of the YAML files of a group, the user's own folders included."""
    from hydra.core.global_hydra import GlobalHydra

    return list(GlobalHydra.instance().config_loader().get_group_options(group))


def _unknown_key(path: str, groups: list[str]) -> InputError | None:
    import hydra as hydra_module
    from omegaconf import DictConfig, OmegaConf

    try:
        node: Any = hydra_module.compose("config", overrides=groups)
    except Exception:
        return None  # something else is wrong, and said elsewhere
    done: list[str] = []
    for part in path.lstrip("+~").split("@")[0].split("."):
        if not isinstance(node, DictConfig):
            return None
        if part not in node:
            place = ".".join(done) or "the configuration"
            known = [str(k) for k in node]
            of = f" of {node.name}" if "name" in node and done else ""
            return InputError(f"{path}: no option '{part}' in {place}{of}; {did_you_mean(part, known)}")
        if OmegaConf.is_missing(node, part):
            return None
        node = node[part]
        done.append(part)
    return None


def _first_line(fault: BaseException) -> str:
    return str(fault).strip().splitlines()[0].rstrip(".")


def _distinct(planned: Sequence[Job]) -> None:
    """Raise InputError where two jobs would write to one place."""
    seen: dict[tuple[str, str], Job] = {}
    for job in planned:
        other = seen.setdefault((file_name(job.dataset.label), file_name(job.method.label)), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                raise InputError(f"two jobs of this sweep would both be '{name}'; leave the labels to the bench")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")
