"""What runs in a job of the queue."""

from __future__ import annotations

import signal
from collections.abc import Callable
from typing import Any

from sucre_bench.engine.slurm.waiting import WORDS

__all__ = ["work"]


class _TimeIsUp(BaseException):
    """The queue's warning before it ends a job; no fault of a method, so nothing may take it for one."""


def work(task: Callable[[Any], Any], configuration: str) -> str:
    """Do one job of a sweep, in a job of the queue; return why it stopped early, if it did.

    Both of SLURM's signals end the work as Ctrl-C would, with every row written: the warning before the time limit with
    a result that says so; SIGTERM, which may also mean that the job will start anew, without one.
    """
    import yaml
    from omegaconf import OmegaConf
    from submitit import JobEnvironment

    def time_is_up(*_: object) -> None:
        raise _TimeIsUp

    def terminated(*_: object) -> None:
        raise KeyboardInterrupt

    # submitit's own would raise an error that looks like the method's, and go on.
    signal.signal(getattr(signal, f"SIG{JobEnvironment.USR_SIG}"), time_is_up)
    signal.signal(signal.SIGTERM, terminated)
    try:
        task(OmegaConf.create(yaml.safe_load(configuration)))
    except _TimeIsUp:
        return WORDS["TIMEOUT"]
    return ""
