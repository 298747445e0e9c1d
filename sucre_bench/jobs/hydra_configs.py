"""What Hydra composes: configurations of conf/, of a user's own folders, and of the plugins.

A Hydra file may name code (`_target_`). So of a user's folders only those that a command names are read.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import ANY_FAULT, InputError, did_you_mean, unknown_name
from sucre_bench.jobs.word_syntax import first_line

if TYPE_CHECKING:
    from hydra._internal.hydra import Hydra
    from omegaconf import DictConfig

CONFIGS = "pkg://sucre_bench.conf"
# The places of configs before conf/, and the name of the configuration to begin with.
_search: ContextVar[tuple[tuple[str, ...], str]] = ContextVar("search", default=((), "config"))


@contextmanager
def searching(*places: str, config: str = "") -> Iterator[None]:
    """Search these places, "file://FOLDER" or "experiment://FILE.yaml", before conf/ in this block.

    config: the name of the configuration to begin with.
    """
    before, name = _search.get()
    token = _search.set(((*places, *before), config or name))
    try:
        yield
    finally:
        _search.reset(token)


def config_name() -> str:
    """Return the name of the configuration to begin with."""
    return _search.get()[1]


def hydra_app() -> Hydra:
    """Return Hydra as its own programs have it, with the search path of this command."""
    return _hydra_app(_search.get()[0])


def loader() -> Any:
    """Return what Hydra composes configurations with."""
    return hydra_app().config_loader


@functools.cache
def _hydra_app(places: tuple[str, ...]) -> Hydra:
    from hydra import version
    from hydra._internal.config_loader_impl import ConfigLoaderImpl
    from hydra._internal.config_search_path_impl import ConfigSearchPathImpl
    from hydra._internal.hydra import Hydra
    from hydra._internal.utils import create_config_search_path

    version.setbase("1.3")
    path = create_config_search_path(CONFIGS)
    assert isinstance(path, ConfigSearchPathImpl)
    for place in reversed(places):
        path.prepend("command-line", place, "main")
    return Hydra(task_name="sucre_bench", config_loader=ConfigLoaderImpl(path))


def names(group: str) -> list[str]:
    """Return what can be chosen of a group: plugins, and files of conf/ and of the user's own folders."""
    found: list[str] = loader().get_group_options(group)
    return found


def composed(overrides: Sequence[str], is_sweep: bool = False, config: str = "") -> DictConfig:
    """Return what Hydra composes of overrides. is_sweep: leave out the words with several values.

    Raises InputError for what Hydra refuses, with the nearest names where it knows them.
    """
    from hydra.types import RunMode

    mode = RunMode.MULTIRUN if is_sweep else RunMode.RUN
    with faults_of_hydra(overrides):
        try:
            made: DictConfig = loader().load_configuration(
                config or config_name(), [*overrides], mode
            )
            return made
        except (
            AssertionError,
            AttributeError,
            LookupError,
            RecursionError,
            TypeError,
            ValueError,
        ) as fault:
            # of words of odd types, or a file with too many brackets
            raise _explained(fault, overrides) from fault


# What installs launchers and sweepers of others.
_INSTALLS = dict.fromkeys(
    ("slurm", "submitit_local", "submitit_slurm"), "pip install 'sucre-bench[slurm]'"
)
_INSTALLS |= {name: f"pip install 'sucre-bench[{name}]'" for name in ("joblib", "optuna")}


@contextmanager
def faults_of_hydra(overrides: Sequence[str]) -> Iterator[None]:
    """Raise what Hydra refuses in this block as one InputError: an unknown name with the nearest."""
    import yaml
    from hydra.errors import HydraException

    try:
        yield
    except yaml.YAMLError as fault:
        mark = getattr(fault, "problem_mark", None)
        line = f"line {mark.line + 1}: " if mark else ""
        problem = getattr(fault, "problem", None) or first_line(fault)
        raise InputError(f"{line}is no plain YAML, {problem}", "", "mend it") from fault
    except HydraException as fault:
        raise _explained(fault, overrides) from fault


def _explained(fault: Exception, overrides: Sequence[str]) -> InputError:
    """A fault of Hydra as one line."""
    from hydra.errors import MissingConfigException

    if isinstance(fault, MissingConfigException) and fault.missing_cfg_file:
        group, _, name = str(fault.missing_cfg_file).rpartition("/")
        options = fault.options or names(group)
        remedy = did_you_mean(name.partition(":")[0], options)
        if group.startswith("hydra"):
            remedy = _INSTALLS.get(name) or f"{remedy}; or install the package that has it"
        kind = group.removesuffix("s") or "configuration"
        return InputError(f"no {kind} is called '{name}'", remedy=remedy)
    is_vague = not str(fault) or str(fault).startswith("Error merging override")
    text = first_line((is_vague and fault.__cause__) or fault)
    key = text.partition("'")[2].partition("'")[0]
    group, _, name = key.rpartition(".")
    others = [word for word in overrides if not word.lstrip("+").startswith(f"{key}=")]
    if group and text.startswith("Could not override '") and len(others) < len(overrides):
        known = selected(composed(others, is_sweep=True), group)
        if known:
            return unknown_name(key, name, known)
        return InputError(text, key, f"write +{key}=VALUE to add it")
    place = next((word for word in overrides if key and key in word), "")
    return InputError(text, place, "`sucre-bench run --cfg all` shows what there is")


def selected(config: DictConfig, key: str) -> Any:
    """Return what stands at a key, "hydra.launcher" for example, as plain data; None where nothing does."""
    from omegaconf import OmegaConf

    value = OmegaConf.select(config, key, throw_on_missing=False)
    return OmegaConf.to_container(value, resolve=True) if OmegaConf.is_config(value) else value


def written(name: str, key: str) -> Any:
    """Return what stands at a key of one config, before Hydra composes it.

    None where nothing does, and for a config that cannot be read: composing says why.
    """
    try:
        found = loader().repository.load_config(name)
        return selected(found.config, key) if found else None
    except ANY_FAULT:
        return None


def plain(config: DictConfig) -> dict[str, Any]:
    """Return a job's part of a configuration, without Hydra's, as plain data; nothing in it is resolved."""
    from omegaconf import OmegaConf

    values = OmegaConf.to_container(config, resolve=False)
    assert isinstance(values, dict)
    return {
        str(key): value for key, value in values.items() if key not in ("hydra", "experiment")
    }


@contextmanager
def current(config: DictConfig) -> Iterator[None]:
    """Let ${hydra:...} mean this configuration in this block."""
    from hydra.core.hydra_config import HydraConfig

    known = HydraConfig.instance()
    before = known.cfg
    known.set_config(config)
    try:
        yield
    finally:
        known.cfg = before


def choices() -> dict[str, str]:
    """Return what the configuration that Hydra begins with, and those in its defaults list, choose of each group."""
    return _choices(_search.get())


@functools.cache
def _choices(search: tuple[tuple[str, ...], str]) -> dict[str, str]:
    from hydra.types import RunMode

    is_ours = search == ((), "config")
    without_metrics = ["metrics=[]"] if is_ours else []  # Hydra would import each
    with faults_of_hydra(()):
        found = loader().compute_defaults_list(search[1], without_metrics, RunMode.RUN)
    return {group: str(chosen) for group, chosen in found.overrides.known_choices.items()}


def metrics_of_every_run() -> set[str]:
    """Return the names in the defaults list of conf/metrics/default. Nothing of it is imported."""
    found = loader().repository.load_config("metrics/default").defaults_list
    return {one.path.partition(":")[0] for one in found} - {"_self_"}


def preset(group: str, name: str) -> dict[str, Any] | None:
    """Return what a file of a group, `method/sucre_exact` for example, comes to; None where there is no such file."""
    return _preset(_search.get()[0], group, name)


@functools.cache
def _preset(_: tuple[str, ...], group: str, name: str) -> dict[str, Any] | None:
    from omegaconf import OmegaConf

    try:
        is_there = name and loader().repository.config_exists(f"{group}/{name}")
    except OSError:
        # no file can have this name
        is_there = False
    if not is_there:
        return None
    with warnings.catch_warnings(action="ignore"):
        # that _self_ is not in its defaults: it is last
        config = composed([], config=f"{group}/{name}")
    values = OmegaConf.to_container(config, resolve=False)
    assert isinstance(values, dict)
    return values.get(group)


@functools.cache
def descriptions(group: str) -> dict[str, str]:
    """Return the files of a folder of conf/ by name, with the first comment of each."""
    made = {}
    for file in sorted((Path(__file__).parent.parent / "conf" / group).glob("*.yaml")):
        lines = file.read_text(encoding="utf-8").splitlines()
        comments = (line[2:] for line in lines if line.startswith("# ") and line[2] != "@")
        made[file.stem] = next(comments, "")
    return made
