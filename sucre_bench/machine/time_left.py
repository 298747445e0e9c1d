"""Estimates the time left from the steps that are done."""

from dataclasses import dataclass

# A step that is done sooner was stored before: it says nothing of those to come.
_WORK_S = 1e-3


@dataclass
class Pace:
    """Steps that are done of a total.

    started: when the work began; this and `now` are seconds of one clock. The first step takes imports and compilers
    besides, so the second is the first to count.
    """

    total: int | None
    started: float
    done: int = 0
    _counted: int = 0
    _first: float | None = None
    _last: float | None = None

    def advance(self, now: float) -> None:
        """Count a step that is done."""
        self.done += 1
        took = now - (self.started if self._last is None else self._last)
        self._last = now
        if took < _WORK_S:
            return
        if self._first is None:
            self._first = now
        else:
            self._counted += 1

    @property
    def left_s(self) -> float | None:
        """Seconds that the remaining steps will take at the pace so far; None while it is unknown."""
        if not (self.total and self._counted) or self._first is None or self._last is None:
            return None
        return (self._last - self._first) / self._counted * (self.total - self.done)


def duration(seconds: float) -> str:
    """Return seconds as text with its unit, two digits or so.

    >>> [duration(s) for s in (0.4, 59, 600, 5000, 200000)]
    ['1 s', '59 s', '10 min', '1 h 23 min', '55 h 33 min']
    """
    if seconds < 90:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
