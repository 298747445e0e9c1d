"""Collects the hints of a method about its views, and shows each hint once with method and dataset."""

import re
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress

_NUMBER = re.compile(r"\d+(\.\d+)?")


@contextmanager
def hints_of(job: Job, views: Iterable[str]) -> Iterator[None]:
    """Inside, the line "a.png: red: 19% ..." becomes "sucre on demo: a.png: red: 19% ...". Lines about no view stay
    unchanged.

    A hint that differs from an earlier one by its numbers alone is only counted, and the count is said at the end.
    "method.physical=true" becomes the word for this method in the command, "sucre.physical=true" or that of its label.
    """
    where, known = f"{job.method.label} on {job.dataset.label}", set(views)
    option = re.compile(rf"\b(method|{re.escape(job.method.plugin.name)})\.(?=\w+=)")
    first: dict[str, str] = {}
    left_out: dict[str, set[str]] = {}

    def said(text: str) -> str | None:
        view, colon, hint = text.partition(": ")
        if not colon or view not in known:
            return text
        kind = _NUMBER.sub("", hint)
        if kind in first:
            left_out.setdefault(kind, set()).add(view)
            return None
        first[kind] = view
        return f"{where}: {view}: {option.sub(f'{job.method_word}.', hint)}"

    try:
        with progress.said_through(said):
            yield
    finally:
        others = {view for kind, of_kind in left_out.items() for view in of_kind - {first[kind]}}
        if others:
            progress.say(f"{where}: {len(others)} more view{'s' * (len(others) > 1)} with such a hint")
