"""`hydra/launcher=slurm`: the SLURM launcher of hydra-submitit-launcher, under which a lost job loses itself only.

submitit's own gives up all jobs at the first that was killed. Jobs wait in the queue, so the same command with the
same `out` goes on where views are missing.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

from hydra.core.singleton import Singleton
from hydra.core.utils import JobReturn, JobStatus
from omegaconf import OmegaConf

with suppress(ImportError):
    from hydra_plugins.hydra_submitit_launcher.config import BaseQueueConf
    from hydra_plugins.hydra_submitit_launcher.submitit_launcher import SlurmLauncher as _Slurm

    class SlurmLauncher(_Slurm):  # type: ignore[misc]
        """Submits jobs in arrays, and waits for all of them."""

        def launch(
            self, job_overrides: Sequence[Sequence[str]], initial_job_idx: int
        ) -> Sequence[JobReturn]:
            """Return how each job ended."""
            import submitit

            params = {name: value for name, value in self.params.items() if value is not None}
            folder, retries = params.pop("submitit_folder"), params.pop("max_num_timeout", 0)
            cpus = params.get("cpus_per_task", 1)
            threads = (
                f"export {name}_NUM_THREADS={cpus}"
                for name in ("OMP", "OPENBLAS", "MKL", "NUMBA")
            )
            params["setup"] = [*threads, *params.get("setup", ())]
            # srun does not take over sbatch's, since SLURM 22.05
            params["srun_args"] = [f"--cpus-per-task={cpus}"]
            common = OmegaConf.structured(BaseQueueConf).keys()
            executor = submitit.AutoExecutor(
                folder, cluster="slurm", slurm_max_num_timeout=retries
            )
            named = {
                name if name in common else f"slurm_{name}": value
                for name, value in params.items()
            }
            # submitit's default is not known to every cluster
            executor.update_parameters(**named, slurm_wckey=None)
            state, jobs = Singleton.get_state(), list[Any]()
            asked = [
                (
                    [*words],
                    "hydra.sweep.dir",
                    initial_job_idx + k,
                    f"job_id_for_{initial_job_idx + k}",
                    state,
                )
                for k, words in enumerate(job_overrides)
            ]
            try:
                for start in range(0, len(asked), most := _largest_array()):
                    with _in_no_job():
                        jobs += executor.map_array(
                            self, *zip(*asked[start : start + most], strict=True)
                        )
                return [_result(job) for job in jobs]
            except BaseException:
                for job in jobs:
                    job.cancel(check=False)
                raise


def _result(job: Any) -> JobReturn:
    """Wait for a job, and return its result, or how it was lost."""
    try:
        returned: JobReturn = job.results()[0]
        return returned
    except Exception as fault:
        last = next(
            (line for line in reversed(str(fault).splitlines()) if line.strip()),
            type(fault).__name__,
        )
        reason = {
            "TIMEOUT": "reached its time limit; give hydra.launcher.timeout_min= or more shards",
            "OUT_OF_MEMORY": "ran out of memory; give more with hydra.launcher.mem_gb=",
        }.get(state := str(job.state).partition(" ")[0], f"was lost ({state}): {last.strip()}")
        lost = RuntimeError(f"SLURM job {job.job_id} {reason}; log: {job.paths.stderr}")
        return JobReturn(status=JobStatus.FAILED, _return_value=lost)


def _largest_array() -> int:
    """Return how many jobs one array may hold here; a cluster that does not say so takes SLURM's usual 1001."""
    answer = subprocess.run(
        ["scontrol", "show", "config"], capture_output=True, text=True, check=False
    ).stdout
    found = re.search(r"^MaxArraySize\s*=\s*(\d+)", answer, re.MULTILINE)
    return max(1, int(found[1])) if found else 1001


@contextmanager
def _in_no_job() -> Iterator[None]:
    """Unset SLURM's variables, in case this process runs in a job; what users tell sbatch (SBATCH_...) stays."""
    hidden = {
        name: os.environ.pop(name)
        for name in [*os.environ]
        if name.startswith(("SLURM_", "SLURMD_", "SRUN_"))
    }
    os.environ |= {name: value for name, value in hidden.items() if name == "SLURM_CONF"}
    try:
        yield
    finally:
        os.environ.update(hidden)
