"""A watcher of progress that keeps the lines."""

from __future__ import annotations

import threading
from collections import Counter


class Lines:
    """Keeps every line that is said, and counts the steps of each line of work. has_one: set when a line is said."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.has_one = threading.Event()
        self.works: dict[str, tuple[str, int | None]] = {}
        self.steps: Counter[str] = Counter()

    def __call__(self, event: str, *values: object) -> None:
        if event == "said":
            self.lines.append(str(values[0]))
            self.has_one.set()
        elif event == "started":
            number, what, total = values
            self.works[str(number)] = str(what), total if isinstance(total, int) else None
        elif event == "advanced":
            self.steps[self.works[str(values[0])][0]] += 1
