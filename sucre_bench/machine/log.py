"""The log of what went wrong: tracebacks, for whoever mends a plugin; people are told in one line elsewhere."""

from __future__ import annotations

import traceback
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path

__all__ = ["keep_traceback", "now"]


def keep_traceback(log: Path | None, where: str) -> None:
    """Append the exception being handled to a log, if there is one."""
    if log is None:
        return
    with suppress(OSError):  # the log is a courtesy: the row has the reason
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as file:
            file.write(f"--- {now()} {where}\n{traceback.format_exc()}\n")


def now() -> str:
    """The time as rows keep it."""
    return datetime.now(UTC).isoformat(timespec="microseconds")
