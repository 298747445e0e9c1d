"""Configuration: Hydra's, with the plugins' own fields as its schema.

Every method, dataset and metric becomes an option of the group of its kind, typed by its dataclass, so that a wrong
name or type is found before any work. `jobs` turns command-line overrides, sweeps included, into validated `Job`s.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sucre_bench import plugins
from sucre_bench.errors import InputError, one_line
from sucre_bench.jobs.explain import check_experiment, in_our_words, not_an_override
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.schema import CONF, register
from sucre_bench.results.layout import file_name
from sucre_bench.results.rows import fingerprint

if TYPE_CHECKING:
    from hydra.core.override_parser.types import Override
    from omegaconf import DictConfig

__all__ = ["Sweep", "jobs"]


@dataclass(frozen=True)
class Sweep:
    """What a command asks for.

    overrides: the command's, as Hydra takes them; told: what the bench tells each job beside them; multirun: whether it
    is a sweep; launcher: the class of Hydra's that runs its jobs; sharing: where its jobs share what they pair, named
    alike for the same command, empty where they do not.
    """

    jobs: tuple[Job, ...]
    overrides: tuple[str, ...]
    told: tuple[str, ...]
    multirun: bool
    launcher: str
    sharing: str

    @property
    def in_process(self) -> bool:
        """Whether its jobs run one by one, here."""
        return self.launcher.endswith("BasicLauncher")


@contextmanager
def _hydra() -> Iterator[None]:
    from hydra import initialize_config_module
    from hydra.core.global_hydra import GlobalHydra

    register()
    GlobalHydra.instance().clear()
    with initialize_config_module(CONF, version_base="1.3"):
        yield


def jobs(overrides: Sequence[str], multirun: bool) -> Sweep:
    """Read overrides, expand what they sweep over, and validate every job.

    Raises InputError for an unknown name or option (with the nearest known), a wrong type, a word that is no choice,
    or two jobs of one label.
    """
    overrides = [_at_home(text) for text in overrides]
    parsed = _parse(overrides)
    for override in parsed:
        if override.key_or_group == "plugins":  # before its plugins can be configured
            files = override.value()
            for file in files if isinstance(files, list) else [files]:
                plugins.load_file(str(file))
    with _hydra():
        check_experiment(parsed)
        expansion = _expand(parsed, multirun)
        told = [f"swept=[{','.join(expansion.swept)}]"] if expansion.swept else []
        planned = tuple(Job.of(_compose([*one, *told])) for one in expansion.jobs)
    _distinct(planned)
    sharing = f"x{fingerprint({'command': overrides})[1]}" if _pair_alike(planned) else ""
    told += [f"sharing={sharing}"] if sharing else []
    return Sweep(planned, tuple(overrides), tuple(told), expansion.multirun, expansion.launcher, sharing)


@dataclass(frozen=True)
class _Expansion:
    """The overrides of every job, the keys that differ between them, and the class of Hydra's that runs them."""

    jobs: list[list[str]]
    swept: tuple[str, ...]
    multirun: bool
    launcher: str


def _at_home(override: str) -> str:
    """An override with a leading ~ expanded; the shell only does that to whole words."""
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


def _expand(parsed: list[Override], multirun: bool) -> _Expansion:
    """What the command line and an experiment's own sweep span."""
    from hydra._internal.core_plugins.basic_sweeper import BasicSweeper
    from hydra.errors import HydraException
    from hydra.types import RunMode

    fixed = [o.input_line or "" for o in parsed if not o.is_sweep_override()]
    # How to sweep is Hydra's and the experiment's to say; the rest may only make sense with the values swept over.
    deciding = [o for o in parsed if o.is_hydra_override() or o.key_or_group == "experiment"]
    base = _compose([o.input_line or "" for o in deciding if not o.is_sweep_override()], hydra=True)
    launcher = str(base.hydra.launcher.get("_target_", ""))
    if base.hydra.job.chdir:
        raise InputError("hydra.job.chdir=true: paths are taken from where you are; leave it false")
    if not (multirun or base.hydra.mode == RunMode.MULTIRUN):
        for override in parsed:
            if override.is_sweep_override():
                raise InputError(f"{override.input_line}: several values; add -m to run them all")
            if override.key_or_group == "hydra/launcher":
                raise InputError(f"{override.input_line}: hands out the jobs of a sweep; add -m")
        return _Expansion([fixed], (), False, launcher)
    everything = [*_parse([f"{k}={v}" for k, v in (base.hydra.sweeper.get("params") or {}).items()]), *parsed]
    swept = tuple(dict.fromkeys(o.key_or_group for o in everything if o.is_sweep_override()))
    try:
        (batch,) = BasicSweeper.split_arguments([o for o in everything if not o.is_hydra_override()], None)
    except HydraException as fault:
        if str(base.hydra.sweeper._target_).endswith("BasicSweeper"):
            raise InputError(f"{one_line(fault)}; list the values, or choose hydra/sweeper=...") from fault
        # Another sweeper decides the values as it goes; only what is fixed can be checked.
        return _Expansion([fixed], swept, True, launcher)
    settings = [o.input_line or "" for o in everything if o.is_hydra_override()]
    return _Expansion([settings + one for one in batch], swept, True, launcher)


def _compose(overrides: list[str], hydra: bool = False) -> DictConfig:
    import hydra as hydra_module
    from hydra.errors import HydraException
    from omegaconf import DictConfig
    from omegaconf.errors import OmegaConfBaseException

    try:
        config = hydra_module.compose("config", overrides=overrides, return_hydra_config=hydra)
    except (HydraException, OmegaConfBaseException, ValueError) as fault:
        raise in_our_words(fault, overrides) from fault
    assert isinstance(config, DictConfig)
    return config


def _pair_alike(planned: Sequence[Job]) -> bool:
    """Whether several methods look at the same views among others, and may have pairs to share."""
    looking = [job for job in planned if "poses" in job.method.plugin.needs and job.pairs_gb > 0]
    views = [(job.dataset.label, job.replicate, job.shard.index, job.shard.count) for job in looking]
    return len(set(views)) < len(views)


def _distinct(planned: Sequence[Job]) -> None:
    """Raise InputError where two jobs would write to one place."""
    seen: dict[tuple[str, str, int, int, int], Job] = {}
    for job in planned:
        part = (job.replicate, job.shard.index, job.shard.count)
        other = seen.setdefault((file_name(job.dataset.label), file_name(job.method.label), *part), job)
        if other is not job:
            name = f"{job.dataset.label} / {job.method.label}"
            if (other.method, other.dataset) != (job.method, job.dataset):
                of = "method" if other.dataset == job.dataset else "dataset"
                raise InputError(f"two jobs of this sweep would both be '{name}'; tell them apart with {of}.label=...")
            raise InputError(f"two jobs of this sweep are the same, '{name}'; sweep over datasets, methods or options")
