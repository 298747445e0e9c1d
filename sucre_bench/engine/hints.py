"""What a user can type against the faults of restorations: one hint for each method and dataset, from the records."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from sucre_bench.arrays import DataFrame, evenly
from sucre_bench.engine.preflight import Planned
from sucre_bench.errors import InputError
from sucre_bench.results.restorations import read_record
from sucre_bench.results.rows import tuples

_MOST_VIEWS = 50  # whose records are read, evenly chosen
_NUMBER = re.compile(r"\d+(\.\d+)?")


@dataclass(frozen=True)
class Hint:
    """A fault that most of the views have, and what to type. where: dataset and method; n_views: of n_read."""

    where: str
    n_views: int
    n_read: int
    text: str


def hints(planned: Sequence[Planned], restored: DataFrame, out: Path) -> Iterator[Hint]:
    """Yield the most frequent of the "hints" in the records of each method's restorations, if they have any.

    restored: the rows of restored views. Hints that differ by numbers alone are one. "method.fill=true" becomes the
    word for this method in the command, "sucre.fill=true" or that of its label.
    """
    for name, plan in {plan.name: plan for plan in planned}.items():
        job = plan.job
        rows = restored[(restored["dataset"] == job.dataset.label) & (restored["method"] == job.method.label)]
        rows = rows.iloc[evenly(len(rows), _MOST_VIEWS)]
        kinds, first = Counter[str](), dict[str, str]()
        for row in tuples(rows):
            try:
                found = read_record(row, out).get("hints", ())
            except InputError:  # damaged; the picture may be whole
                continue
            of_view = {_NUMBER.sub("", text): text for text in found}
            kinds.update(of_view.keys())
            first = of_view | first
        if kinds:
            kind, n_views = kinds.most_common(1)[0]
            option = re.compile(rf"\b(method|{re.escape(job.method.plugin.name)})\.(?=\w+=)")
            yield Hint(name, n_views, len(rows), option.sub(f"{job.method_word}.", first[kind]))
