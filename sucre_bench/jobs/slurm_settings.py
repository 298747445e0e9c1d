"""The settings of SLURM for each job of a sweep."""

from dataclasses import dataclass, field
from typing import Any


@dataclass
class Settings:
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
