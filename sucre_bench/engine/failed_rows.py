"""The rows of what failed or was skipped: status and reason, a line on stderr, and the traceback in the log.

Whoever runs a plugin catches what it raises, and takes the row or its reason from here: `run_job` for datasets and
methods, `score` and `score_pairs` for metrics, `rescue_jobs` and `slurm.launcher` for jobs whose process died.
"""

import math
from dataclasses import replace
from pathlib import Path

from sucre_bench.engine.select_views import base_row
from sucre_bench.errors import NotApplicableError, one_line, raise_if_stop
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.records import keep_traceback
from sucre_bench.results.layout import log_path
from sucre_bench.results.rows import RESTORATION, Row, Status


def row_without_value(base: Row, status: Status, reason: str) -> Row:
    """Return a row that says why there is no value."""
    return replace(base, value=math.nan, coverage=0.0, status=status, reason=reason)


def row_of_fault(base: Row, fault: BaseException, log: Path | None, is_said: bool = False) -> Row:
    """Return the row for a fault that is being handled: skipped for NotApplicableError, or else failed.

    The traceback of a failure goes to `log`; is_said: print it as a line, too. A request to stop is raised again.
    """
    if isinstance(fault, NotApplicableError):
        return row_without_value(base, "skipped", one_line(fault))
    return _failed(base, fault, log, is_said)


def kept_reason(fault: BaseException, log: Path | None, where: str) -> str:
    """Return the reason of a failure that is being handled; its traceback goes to `log`, under `where`.

    A request to stop is raised again.
    """
    raise_if_stop(fault)
    keep_traceback(log, where)
    return one_line(fault)


def failed_row(job: Job, fault: BaseException) -> Row:
    """Return the row of a whole job that failed, and print it as a line. A request to stop is raised again."""
    return _failed(base_row(job), fault, log_path(job.out), is_said=True)


def _failed(base: Row, fault: BaseException, log: Path | None, is_said: bool) -> Row:
    metric = "" if base.metric == RESTORATION else f"{base.metric}:{base.variant}"
    where = " / ".join(filter(None, (base.dataset, base.scene, base.view, base.method, metric)))
    reason = kept_reason(fault, log, where)
    if is_said:
        progress.say(f"failed  {where}: {reason}", is_fault=True)
    return row_without_value(base, "failed", reason)
