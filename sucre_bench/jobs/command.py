"""From the words of a command to its jobs: Hydra composes each job's configuration once.

The plugins' own fields are the schema (`sucre_bench.jobs.schema`), so that a wrong name or type is found before any
work.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench import plugins
from sucre_bench.errors import InputError
from sucre_bench.jobs.explain import check_experiment, in_our_words, not_an_override
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.labels import refuse_same_place
from sucre_bench.jobs.schema import CONF, register
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

__all__ = ["Command", "jobs"]


@dataclass(frozen=True)
class Command:
    """What the words of a command ask for.

    words: the overrides, with ~ expanded; is_sweep: whether Hydra's launcher hands out the jobs; settings: the first
    job's configuration with Hydra's own part, `hydra`, which names the launcher and its options; shared_pairs: the
    folder where its jobs share pairs, the same for the same words, empty if they share none.
    """

    jobs: tuple[Job, ...]
    words: tuple[str, ...]
    is_sweep: bool
    settings: DictConfig
    shared_pairs: str


@contextmanager
def _hydra() -> Iterator[None]:
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    register()
    GlobalHydra.instance().clear()
    with initialize_config_module(CONF, version_base="1.3"):
        yield


def jobs(overrides: Sequence[str], multirun: bool) -> Command:
    """Read overrides, expand their sweeps, and check every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    a dataset's option without a dataset, or two jobs with one label.
    """
    overrides = [_expand_home(text) for text in overrides]
    parsed = _parse(overrides)
    _refuse_options_of_no_dataset(parsed)
    for override in parsed:
        if override.key_or_group == "plugins":  # before its plugins can be configured
            files = override.value()
            for file in files if isinstance(files, list) else [files]:
                plugins.load_file(str(file))
    with _hydra():
        check_experiment(parsed)
        composed = _compose_jobs(parsed, multirun)
        planned = [Job.composed(config, composed.swept) for config in composed.configurations]
    refuse_same_place(planned)
    shared_pairs = f"x{fingerprint({'command': overrides})[1]}" if _can_share_pairs(planned) else ""
    return Command(
        jobs=tuple(replace(job, shared_pairs=shared_pairs) for job in planned),
        words=tuple(overrides),
        is_sweep=composed.is_sweep,
        settings=composed.configurations[0],
        shared_pairs=shared_pairs,
    )


@dataclass(frozen=True)
class _Composed:
    """The configuration of every job with Hydra's own part, and the keys that differ between them."""

    configurations: list[DictConfig]
    swept: tuple[str, ...] = ()
    is_sweep: bool = False


def _expand_home(override: str) -> str:
    """Expand a leading ~ of the value; the shell does so only at the start of a word."""
    key, equals, value = override.partition("=")
    bare = value.strip("'\"")
    return f"{key}='{Path(bare).expanduser()}'" if equals and bare.startswith("~/") else override


def _parse(overrides: Sequence[str]) -> list[Override]:
    from hydra.core.override_parser.overrides_parser import OverridesParser
    from hydra.errors import HydraException

    parsed = []
    for text in overrides:
        try:
            parsed.append(OverridesParser.create().parse_override(text))
        except HydraException as fault:
            raise not_an_override(text, fault) from fault
    return parsed


def _refuse_options_of_no_dataset(parsed: Sequence[Override]) -> None:
    """Raise InputError for a dataset's option where no dataset is named: the built-in one would take it."""
    if any(override.key_or_group in ("dataset", "experiment") for override in parsed):
        return
    for override in parsed:
        if override.key_or_group.startswith("dataset."):
            word = override.input_line
            raise InputError(f"{word}: no dataset is named; add dataset=NAME, for example dataset=colmap {word}")


def _texts(overrides: Sequence[Override]) -> list[str]:
    return [override.input_line or "" for override in overrides if not override.is_sweep_override()]


def _compose_jobs(parsed: list[Override], multirun: bool) -> _Composed:
    """Compose what the words and an experiment's own sweep span, each job once."""
    from hydra.types import RunMode

    # An experiment or Hydra's options decide whether this is a sweep. The other words may fit only the swept values.
    deciding = [o for o in parsed if o.is_hydra_override() or o.key_or_group == "experiment"]
    is_one_job = not (multirun or deciding or any(o.is_sweep_override() for o in parsed))
    base = _compose(_texts(parsed if is_one_job else deciding))
    if base.hydra.job.chdir:
        raise InputError("hydra.job.chdir=true: paths are relative to the folder where you are; leave it false")
    if base.hydra.callbacks:
        raise InputError("hydra.callbacks: sucre-bench calls none; leave them out")
    if is_one_job:
        return _Composed([base])
    if not (multirun or base.hydra.mode == RunMode.MULTIRUN):
        for override in parsed:
            if override.is_sweep_override():
                raise InputError(f"{override.input_line}: several values; add -m to run them all")
            if override.key_or_group == "hydra/launcher":
                raise InputError(f"{override.input_line}: hands out the jobs of a sweep; add -m")
        return _Composed([_compose(_texts(parsed))])
    params = base.hydra.sweeper.get("params") or {}
    everything = [*_parse([f"{key}={value}" for key, value in params.items()]), *parsed]
    swept = tuple(dict.fromkeys(o.key_or_group for o in everything if o.is_sweep_override()))
    settings = _texts([o for o in everything if o.is_hydra_override()])
    combinations = _combinations(base, [o for o in everything if not o.is_hydra_override()])
    return _Composed([_compose(settings + one) for one in combinations], swept, is_sweep=True)


def _combinations(base: DictConfig, overrides: list[Override]) -> list[list[str]]:
    """Every combination of the swept values, by Hydra's sweeper."""
    from hydra.utils import get_class

    for override in overrides:
        if override.is_sweep_override() and not override.is_discrete_sweep():
            raise InputError(f"{override.input_line}: no list of values; list them, or write range(start,stop,step)")
    sweeper = get_class(base.hydra.sweeper["_target_"])
    if not hasattr(sweeper, "split_arguments"):
        name = base.hydra.runtime.choices["hydra/sweeper"]
        raise InputError(f"hydra/sweeper={name}: chooses values while jobs run; all jobs are checked before, use basic")
    (combinations,) = sweeper.split_arguments(overrides, None)
    return list(combinations)


def _compose(overrides: list[str]) -> DictConfig:
    import hydra
    from hydra.errors import HydraException
    from omegaconf import DictConfig
    from omegaconf.errors import OmegaConfBaseException

    try:
        config = hydra.compose("config", overrides=overrides, return_hydra_config=True)
    except (HydraException, OmegaConfBaseException, ValueError) as fault:
        raise in_our_words(fault, overrides) from fault
    assert isinstance(config, DictConfig)
    return config


def _can_share_pairs(planned: Sequence[Job]) -> bool:
    """Whether several jobs with methods of several views work on the same views, and may share pairs."""
    pairing = [job for job in planned if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = [(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in pairing]
    return len(set(views)) < len(views)
