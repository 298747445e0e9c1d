"""Hydra's own part of a command, ``hydra.*``: the launcher of a sweep and its options."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sucre_bench.errors import InputError, did_you_mean, unknown_name
from sucre_bench.jobs.words import Word, first_line, resolving

_REMEDY = "leave it out, or write what Hydra's documentation has there"


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

    _target_: str = "sucre_bench.engine.slurm.launch"
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
    submitit_folder: str = "${out}/logs/slurm"


@dataclass
class _OneByOne:
    """Options of the launcher that runs the jobs of a sweep on this machine, `workers` at a time: none."""

    _target_: str = ""


@dataclass(frozen=True)
class HydraWords:
    """What words for Hydra itself say. params: the sweeper's, as overrides; configuration: of all that is Hydra's."""

    params: Sequence[str]
    is_sweep: bool
    configuration: Any

    @resolving(_REMEDY)
    def launcher(self, out: str) -> dict[str, Any]:
        """Return the options of the launcher, with its class as `_target_`; empty for this machine.

        out: the results folder, which options may name as ${out}.
        """
        from omegaconf import OmegaConf, open_dict

        with open_dict(self.configuration):
            self.configuration.out = out
        options = OmegaConf.to_container(self.configuration.hydra.launcher, resolve=True)
        assert isinstance(options, dict)
        return {str(name): value for name, value in options.items()} if options["_target_"] else {}


@resolving(_REMEDY)
def hydra_words(words: Sequence[Word]) -> HydraWords:
    """Compose the words for Hydra itself: groups, such as hydra/launcher=slurm, and their options.

    Raises InputError for a group or option that is unknown, with the nearest, and for what is not followed here.
    """
    from hydra import compose, initialize
    from hydra.core.config_store import ConfigStore
    from hydra.core.global_hydra import GlobalHydra
    from hydra.core.plugins import Plugins
    from hydra.errors import HydraException
    from hydra.types import RunMode
    from omegaconf import DictConfig, OmegaConf
    from omegaconf.errors import OmegaConfBaseException

    Plugins.instance()  # Hydra's own plugins store their settings first; ours replace some
    store = ConfigStore.instance()
    for name, settings in (("basic", _OneByOne), ("slurm", SlurmSettings), ("submitit_slurm", SlurmSettings)):
        store.store(group="hydra/launcher", name=name, node=settings, provider="sucre_bench")
    GlobalHydra.instance().clear()
    with initialize(config_path=None, version_base="1.3"):
        groups = [word for word in words if word.head != "hydra"]
        try:
            made = compose(overrides=[word.text for word in groups], return_hydra_config=True)
        except (HydraException, OmegaConfBaseException, ValueError, TypeError, AttributeError, KeyError) as fault:
            for word in groups:
                known, name = GlobalHydra.instance().config_loader().get_group_options(word.key), str(word.values[0])
                if name not in known:
                    raise InputError(f"no {word.key} is called '{name}'", remedy=did_you_mean(name, known)) from fault
            raise InputError(first_line(fault.__cause__ or fault), remedy=_REMEDY) from fault
    for word in words:
        if word.head == "hydra":
            if isinstance(OmegaConf.select(made, word.key), DictConfig) and not isinstance(word.values[0], dict):
                raise InputError("is a group of options", word.key, _REMEDY)
            try:
                OmegaConf.update(made, word.key, word.values[0], merge=True, force_add=word.text.startswith("+"))
            except (OmegaConfBaseException, ValueError, TypeError, AttributeError, KeyError, AssertionError) as fault:
                parent, _, name = word.key.rpartition(".")
                node = OmegaConf.select(made, parent)
                if isinstance(node, DictConfig) and name not in node:
                    raise unknown_name(word.key, name, [str(one) for one in node if one != "_target_"]) from fault
                raise InputError(first_line(fault), word.key, _REMEDY) from fault
    hydra = made.hydra
    if any(word.key == "hydra.searchpath" for word in words):
        raise InputError("sucre-bench looks nowhere else", "hydra.searchpath", "write presets as methods of a line-up")
    if hydra.job.chdir:
        raise InputError("paths are relative to the folder where you are", "hydra.job.chdir=true", "leave it false")
    if hydra.callbacks:
        raise InputError("sucre-bench calls none", "hydra.callbacks", "leave them out")
    if not hydra.sweeper["_target_"].endswith(".BasicSweeper"):
        text = "chooses values during a run, but all jobs are checked before"
        raise InputError(text, f"hydra/sweeper={hydra.runtime.choices['hydra/sweeper']}", "use basic")
    params = [f"{key}={value}" for key, value in (hydra.sweeper.get("params") or {}).items()]
    return HydraWords(params, hydra.mode == RunMode.MULTIRUN, made)
