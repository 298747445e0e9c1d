"""A configuration that Hydra composed, as a job: run from Python, or by a launcher of Hydra."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from sucre_bench import plugins, results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.preflight import check
from sucre_bench.engine.run import Outcome, Watch, run
from sucre_bench.engine.workers import run_jobs
from sucre_bench.errors import InputError
from sucre_bench.jobs.compose_jobs import Command, job_of
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress

if TYPE_CHECKING:
    from hydra.core.utils import JobReturn
    from hydra.types import HydraContext
    from omegaconf import DictConfig


def run_config(config: DictConfig) -> DataFrame:
    """Restore and score what a configuration of Hydra chooses, and return the rows of it.

    - config: what `hydra.compose("config", [...])` returns, with `sucre_bench.conf` as Hydra's config module.

    >>> import hydra
    >>> with hydra.initialize_config_module("sucre_bench.conf", version_base=None):
    ...     words = ["dataset=demo", "dataset.views=2", "method=gray_world", "metrics=[psnr]", "tracking.uri=off"]
    ...     config = hydra.compose("config", words)
    >>> rows = run_config(config)
    >>> rows["method"].unique().tolist()
    ['gray_world']

    The results folder is `out`, as of `sucre-bench run`; what is stored there is not computed again.

    Raises InputError for a value that does not fit, ProblemsError for data that are not as expected.
    """
    with progress.live():
        return run(Command((job_of(config),), (), False, config, ((),))).requested_rows


def run_as_job(
    command: Command, context: HydraContext, watch: Watch | None
) -> tuple[Outcome, JobReturn]:
    """Run a command as one job of Hydra, with its logging, environment and callbacks. Raises as `engine.run.run`."""
    from hydra.core.utils import JobStatus, run_job

    returned = run_job(
        task_function=lambda _: run(command, watch),
        config=command.config,
        job_dir_key="hydra.run.dir",
        job_subdir_key=None,
        hydra_context=context,
    )
    # The public property would print the fault, which the command says in one line.
    outcome = returned._return_value  # noqa: SLF001
    if returned.status != JobStatus.COMPLETED:
        raise outcome
    assert isinstance(outcome, Outcome)
    return outcome, returned


def run_launched(config: DictConfig) -> float | None:
    """Run one job of a sweep where a launcher of Hydra wants it, and return its objective, if it has one.

    Its rows are written as parts of the score table; the command that launched it merges them.
    """
    from hydra.core.hydra_config import HydraConfig

    for file in config.plugins:
        plugins.load_file(str(file))
    ours = HydraConfig.get()
    keys = [word.lstrip("+").partition("=")[0] for word in ours.overrides.task]
    # Our sweeper gives labels. Jobs of other sweepers are told apart by what was set.
    shared = ours.job.config.override_dirname.exclude_keys
    is_labelled = "method.label" in keys
    swept = () if is_labelled else [key for key in keys if "." in key and key not in shared]
    job = job_of(config, swept)
    with progress.live(plain=True):
        run_jobs(check(Command((job,), (), True, config, ((),))), job.workers)
    return _objective(job) if job.objective else None


def _objective(job: Job) -> float:
    """The mean of the job's objective over its views. InputError if it has none."""
    metric, _, variant = job.objective.replace(":", ".", 1).partition(".")
    rows: Any = results.read(job.out, dataset=job.dataset.label, method=job.method.label)
    rows = rows[(rows["metric"] == metric) & (rows["status"] == "ok") & (rows["region"] == "image")]
    values = rows[rows["variant"] == variant]["value"] if variant else rows["value"]
    if values.empty:
        raise InputError(
            "has no value", f"objective={job.objective}", "give METRIC.VARIANT of metrics=[...]"
        )
    return float(values.mean())
