"""The clock for the times in rows: UTC, and never a time twice."""

import threading
from contextlib import suppress
from datetime import UTC, datetime, timedelta

_lock = threading.Lock()
_latest = datetime.min.replace(tzinfo=UTC)


def now() -> str:
    """Return the time as rows have it: UTC, ISO 8601, microseconds.

    Each call of a process returns a later time than the one before, and than every time given to `not_before`, even if
    the computer's clock was set back in between.
    """
    global _latest
    with _lock:
        clock = datetime.now(UTC)
        _latest = max(clock, _latest + timedelta(microseconds=1))
        return _latest.isoformat(timespec="microseconds")


def not_before(time: str) -> None:
    """Let `now` return only times later than this one, in its format; anything else changes nothing."""
    global _latest
    with suppress(ValueError), _lock:
        given = datetime.fromisoformat(time)
        _latest = max(_latest, given if given.tzinfo else given.replace(tzinfo=UTC))
