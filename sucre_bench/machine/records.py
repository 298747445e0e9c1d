"""What rows, logs and files of a run share: times that never go back, text without passwords, JSON without NaN."""

import json
import math
import re
import threading
import traceback
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

_lock = threading.Lock()
_latest = datetime.min.replace(tzinfo=UTC)


def now() -> str:
    """Return the time as rows have it: UTC, ISO 8601, microseconds.

    Each call of a process returns a later time than the one before, and than every time given to `not_before`, even if
    the computer's clock was set back in between.
    """
    global _latest
    with _lock:
        _latest = max(datetime.now(UTC), _latest + timedelta(microseconds=1))
        return _latest.isoformat(timespec="microseconds")


def not_before(time: str) -> None:
    """Let `now` return only times later than this one, in its format; anything else changes nothing."""
    global _latest
    with suppress(ValueError), _lock:
        given = datetime.fromisoformat(time)
        _latest = max(_latest, given if given.tzinfo else given.replace(tzinfo=UTC))


_IN_ADDRESS = re.compile(r"(?<=://)([^\s/@:'\"]*):[^\s/'\"]*@")
_IN_QUERY = re.compile(r"([?&](?:password|passwd|pwd|token|secret|api_?key)=)[^\s&'\"]+", re.IGNORECASE)


def masked(text: str) -> str:
    """Return text with "***" for the password of every address in it.

    >>> masked("postgresql://me:secret@host/runs?token=abc")
    'postgresql://me:***@host/runs?token=***'
    """
    return _IN_QUERY.sub(r"\1***", _IN_ADDRESS.sub(r"\1:***@", text))


def keep_traceback(log: Path | None, where: str) -> None:
    """Append the exception being handled to a log of tracebacks, if there is one."""
    if log is None:
        return
    with suppress(OSError):  # the row has the reason, too
        log.parent.mkdir(parents=True, exist_ok=True)
        with log.open("a", encoding="utf-8") as file:
            file.write(f"--- {now()} {where}\n{masked(traceback.format_exc())}\n")


def json_text(value: Any) -> str:
    """Return a value as indented JSON, with null for NaN and infinity.

    >>> print(json_text({"low": float("nan")}))
    {
     "low": null
    }
    """
    return json.dumps(_plain(value), indent=1)


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
