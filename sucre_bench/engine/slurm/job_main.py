"""The main function of a SLURM job."""

import signal
from dataclasses import replace

from sucre_bench.engine.job import JobAtWork
from sucre_bench.engine.slurm.waiting import WORDS
from sucre_bench.engine.workers import run_works
from sucre_bench.errors import DiskFullError, StopRequest
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress_display


class _TimeIsUp(StopRequest):
    """The queue's warning before it ends a job; no fault of a method, so nothing may take it for one."""


def work(config: str, shared_pairs: str) -> str:
    """Run one job of a sweep in a job of the queue; return why it stopped early, if it did.

    config, shared_pairs: of a `Job`.

    Both of SLURM's signals end the work as Ctrl-C would, with every row written. The warning before the time limit
    gives a result that says so. SIGTERM gives none, since it may also mean that the job will start again.
    """
    from submitit import JobEnvironment

    def time_is_up(*_: object) -> None:
        raise _TimeIsUp

    def terminated(*_: object) -> None:
        raise KeyboardInterrupt

    # submitit's own would raise an error that looks like the method's, and go on.
    signal.signal(getattr(signal, f"SIG{JobEnvironment.USR_SIG}"), time_is_up)
    signal.signal(signal.SIGTERM, terminated)
    try:
        with progress_display.plain():
            job = replace(Job.read(config), shared_pairs=shared_pairs)
            run_works([JobAtWork(job)], job.workers)
    except _TimeIsUp:
        return WORDS["TIMEOUT"]
    except DiskFullError as fault:
        return str(fault)
    return ""
