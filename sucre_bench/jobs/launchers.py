"""The launcher of a sweep, ``hydra/launcher=NAME``, and its options, ``hydra.launcher.*``, named as Hydra has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.jobs.words import Word
from sucre_bench.plugins.options import checked_options


@dataclass(frozen=True)
class Launcher:
    """Runs the jobs of a sweep on this machine, `workers` at a time."""


@dataclass(frozen=True)
class Joblib(Launcher):
    """Runs n_jobs jobs at once on this machine; -1: as many as there are processors."""

    n_jobs: int = 1


@dataclass(frozen=True)
class Slurm(Launcher):
    """Runs jobs on a SLURM cluster.

    timeout_min: time limit of a job; cpus_per_task: processors of a job, and so its threads; mem_gb: memory of a job,
    default the cluster's; array_parallelism: most jobs at work at once; setup: shell lines before the job;
    additional_parameters: any other parameter of sbatch, by its long name; signal_delay_s: how many seconds before its
    time limit a job gets the signal to stop (at most a quarter of the limit); latency_s: most seconds until a result is
    visible through a shared file system. A job that has ended and has no visible result after that time is lost. The
    others are sbatch's.
    """

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


_LAUNCHERS = {"basic": Launcher, "joblib": Joblib, "slurm": Slurm, "submitit_slurm": Slurm}


def launcher_of(words: Sequence[Word]) -> Launcher:
    """Return the launcher that words choose, with its options. Raises InputError for words that are not of these."""
    name, options = "basic", dict[str, Any]()
    for word in words:
        head, _, option = word.key.rpartition(".")
        if word.key == "hydra/launcher":
            name = str(word.values[0])
        elif head == "hydra.launcher":
            options[option] = word.values[0]
        else:
            remedy = "leave it out: of Hydra's own, hydra/launcher=NAME and hydra.launcher.OPTION=VALUE are followed"
            raise InputError("is not followed here", word.text, remedy)
    if name not in _LAUNCHERS:
        raise InputError(f"no hydra/launcher is called '{name}'", remedy=did_you_mean(name, _LAUNCHERS))
    return _LAUNCHERS[name](**checked_options(_LAUNCHERS[name], options, "hydra.launcher"))
