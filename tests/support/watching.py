"""A watcher of progress that keeps the lines."""

from __future__ import annotations

import threading


class Lines:
    """Keeps every line. has_one: set when there is one."""

    def __init__(self) -> None:
        self.lines: list[str] = []
        self.has_one = threading.Event()

    def started(self, what: str, total: int | None) -> int:
        return 0

    def advanced(self, line: int) -> None: ...

    def finished(self, line: int) -> None: ...

    def tick(self) -> None: ...

    def said(self, text: str, is_fault: bool) -> None:
        self.lines.append(text)
        self.has_one.set()
