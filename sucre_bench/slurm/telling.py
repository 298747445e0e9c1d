"""Telling how the jobs of a sweep stand, and how many views they have done."""

from __future__ import annotations

import time
from pathlib import Path

from sucre_bench import progress, results
from sucre_bench.slurm.waiting import Counts

__all__ = ["Teller"]

_SAY_S = 30.0  # between two lines


class Teller:
    """Says now and then how jobs and views stand."""

    def __init__(self, out: Path) -> None:
        self._parts = out / results.PARTS
        self._before = set(self._parts.glob("*.parquet"))  # a killed command's
        self._known: dict[Path, tuple[int, int]] = {}
        self._said: tuple[Counts | None, float] = None, 0.0

    def __call__(self, counts: Counts) -> None:
        said, when = self._said
        if counts == said or (said and time.monotonic() - when < _SAY_S):
            return
        self._said = counts, time.monotonic()
        jobs = f"{counts.waiting} waiting, {counts.working} at work, {counts.ended} ended"
        progress.say(f"SLURM: {jobs}; {self._views()} views done")

    def _views(self) -> int:
        """How many views the parts hold; of those that did not change, what they held before."""
        import pandas as pd

        for path in self._parts.glob("*.parquet"):
            try:
                changed = path.stat().st_mtime_ns
                if path not in self._before and self._known.get(path, (0, 0))[0] != changed:
                    rows = pd.read_parquet(path, columns=["view", "metric"])
                    self._known[path] = changed, int(((rows["metric"] == "seconds") & (rows["view"] != "")).sum())
            except (OSError, ValueError):  # replaced while it is read
                continue
        return sum(views for _, views in self._known.values())
