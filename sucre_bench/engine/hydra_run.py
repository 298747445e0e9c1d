"""`sucre-bench run` as a program of Hydra: its configuration, callbacks, sweeper and launcher.

A configuration that Hydra composed is also run from Python, and by a launcher of Hydra.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from enum import Enum
from typing import TYPE_CHECKING, Any

from sucre_bench import results
from sucre_bench.arrays import DataFrame
from sucre_bench.engine.preflight import check
from sucre_bench.engine.run import Outcome, Watch, outcome_of, run
from sucre_bench.engine.workers import run_jobs
from sucre_bench.errors import InputError, unknown_name
from sucre_bench.jobs import hydra_configs
from sucre_bench.jobs.compose_jobs import Command, command_of, job_of, lines_of
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.read_words import read, reading_experiment
from sucre_bench.jobs.word_syntax import parse, value_of
from sucre_bench.machine import progress
from sucre_bench.machine.text_formats import now
from sucre_bench.plugins.plugin import Better
from sucre_bench.results.rows import wide

if TYPE_CHECKING:
    from hydra.core.utils import JobReturn
    from hydra.types import HydraContext
    from omegaconf import DictConfig


def run_words(words: Sequence[str], multirun: bool, watch: Watch | None = None) -> Outcome:
    """Run what the words of a command ask for.

    Raises InputError for a mistake in the words, and what `engine.run.run` raises.
    """
    from hydra.core.plugins import Plugins
    from hydra.core.utils import configure_log
    from omegaconf import open_dict

    with reading_experiment(words) as words:
        asked = read(words, multirun)
        if asked.config is None:
            return _run_single(command_of(asked), watch)
        config = asked.config
        lines = [word.line for word in asked.typed]
        swept = [*words]
        job: Job | None = None
        if asked.choice("hydra/sweeper") != "pairs":
            # what all jobs share is not among what tells them apart
            lines = lines_of(asked)
            config = hydra_configs.composed(lines, is_sweep=True)
            parsed = zip(lines, parse(lines, hydra_configs.loader()), strict=True)
            swept = [line for line, word in parsed if word.is_swept]
            shared = [line for line in lines if line not in swept]
            keys = [line.lstrip("+").partition("=")[0] for line in shared]
            unnamed = f"hydra.job.config.override_dirname.exclude_keys={value_of(keys)}"
            with open_dict(config):
                config.hydra.overrides.hydra = [*shared, unnamed]
                config.hydra.overrides.task = swept
                job = job_of(config)
                if job.objective:
                    _set_direction(config.hydra.sweeper, job)
        _check_hydra(config)
        configure_log(config.hydra.hydra_logging, config.hydra.verbose)
        context = _context(config)
        context.callbacks.on_multirun_start(
            config=config, config_name=hydra_configs.config_name()
        )
        with hydra_configs.faults_of_hydra(lines):
            sweeper: Any = Plugins.instance().instantiate_sweeper(
                config=config, hydra_context=context, task_function=run_launched
            )
            started = now()
            sweeper.asked = asked
            sweeper.watch = watch
            if watch and job:
                watch.start(job)
                watch.before(())
            outcome = sweeper.sweep(arguments=swept)
        context.callbacks.on_multirun_end(
            config=config, config_name=hydra_configs.config_name()
        )
        if isinstance(outcome, Outcome):
            return outcome
        # another sweeper's jobs: what the score table has since then
        return outcome_of(job_of(config), started)


def _check_hydra(config: DictConfig) -> None:
    """Refuse another working folder, and a launcher of SLURM where sbatch is not there. Raises InputError."""
    if config.hydra.job.chdir:
        fault = "paths of a command are relative to the folder where it runs"
        raise InputError(fault, "hydra.job.chdir=true", "leave it out")
    launcher = config.hydra.runtime.choices["hydra/launcher"]
    if launcher in ("slurm", "submitit_slurm") and not shutil.which("sbatch"):
        remedy = "start it on a login node of the cluster, or leave the launcher out"
        fault = "sbatch is not on this machine"
        raise InputError(fault, f"hydra/launcher={launcher}", remedy)


def _context(config: DictConfig) -> HydraContext:
    from hydra._internal.callbacks import Callbacks
    from hydra.types import HydraContext

    return HydraContext(config_loader=hydra_configs.loader(), callbacks=Callbacks(config))


def _run_single(command: Command, watch: Watch | None) -> Outcome:
    """Run the job of a command that is no sweep, as `hydra.main` does."""
    config = command.config
    _check_hydra(config)
    context = _context(config)
    context.callbacks.on_run_start(config=config, config_name=hydra_configs.config_name())
    outcome, returned = run_as_job(command, context, watch)
    context.callbacks.on_run_end(
        config=config, config_name=hydra_configs.config_name(), job_return=returned
    )
    return outcome


# -- a configuration that Hydra composed -----------------------------------------------------------------------


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
        return run(Command((job_of(config),), config)).requested_rows


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

    ours = HydraConfig.get()
    keys = [word.lstrip("+").partition("=")[0] for word in ours.overrides.task]
    # Another sweeper gives a job no label: the options that it sets make one.
    shared = ours.job.config.override_dirname.exclude_keys
    is_labelled = "method.label" in keys
    swept = () if is_labelled else [key for key in keys if "." in key and key not in shared]
    job = job_of(config, swept)
    with progress.live(plain=True):
        run_jobs(check(Command((job,), config)), job.workers)
    return _objective(job) if job.objective else None


def _objective_of(job: Job) -> tuple[str, str, Better]:
    """The metric, the variant and the better direction of a job's objective. InputError if it is not computed."""
    known: dict[str, tuple[str, str, Better]] = {
        "seconds.wall": ("seconds", "wall", "lower"),
        "peak_mb.resident": ("peak_mb", "resident", "lower"),
    }
    for one in job.metrics:
        name = one.plugin.name
        for variant in one.variants:
            known[f"{name}.{variant}"] = (name, variant, one.plugin.better_of(variant))
    asked = job.objective.replace(":", ".", 1)
    meant = [key for key in known if asked in (key, key.partition(".")[0])]
    if not meant:
        raise unknown_name("objective", asked, known, "score of this run")
    if len(meant) > 1:
        remedy = f"give one of {', '.join(meant)}"
        raise InputError("has several variants", f"objective={asked}", remedy)
    return known[meant[0]]


def _set_direction(sweeper: DictConfig, job: Job) -> None:
    """Let optuna look for the better values of the objective, unless the user gave a direction."""
    from omegaconf import read_write

    better = _objective_of(job)[2]
    if not isinstance(sweeper.get("direction"), Enum):  # what a user writes is text
        return
    if better == "none":
        fault = "neither high nor low values are better"
        remedy = "give hydra.sweeper.direction=maximize or minimize"
        raise InputError(fault, f"objective={job.objective}", remedy)
    with read_write(sweeper):
        sweeper.direction = "maximize" if better == "higher" else "minimize"


def _objective(job: Job) -> float:
    """The mean of the job's objective over its views. InputError if no view has one."""
    metric, variant, _ = _objective_of(job)
    rows = results.read(job.out, dataset=job.dataset.label, method=job.method.label)
    scores = wide(rows[(rows["metric"] == metric) & (rows["variant"] == variant)])
    if metric not in scores or scores[metric].isna().all():
        remedy = f"`sucre-bench compare {job.out}` says why"
        raise InputError("no view has this score", f"objective={job.objective}", remedy)
    return float(scores[metric].mean())
