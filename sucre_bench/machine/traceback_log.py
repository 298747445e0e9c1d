"""The log of tracebacks, `logs/failures.log` of a results folder."""

import traceback
from contextlib import suppress
from pathlib import Path

from sucre_bench.machine.clock import now
from sucre_bench.machine.secrets import masked


def keep_traceback(log: Path | None, where: str) -> None:
    """Append the exception being handled to a log, if there is one."""
    if log is None:
        return
    with suppress(OSError):  # the row has the reason, too
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as file:
            file.write(f"--- {now()} {where}\n{masked(traceback.format_exc())}\n")
