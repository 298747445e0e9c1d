"""Runs of the toy plugins in this process."""

from __future__ import annotations

from pathlib import Path

from sucre_bench.engine import sweep
from sucre_bench.engine.outcome import Outcome


def run(out: Path, *overrides: str, multirun: bool = False) -> Outcome:
    base = ["dataset=toy", "method=gain", "metrics=[psnr,redness]", "tracking.uri=off", f"out={out}"]
    return sweep.run([*base, *overrides], multirun)


def calls(log: Path) -> list[str]:
    return log.read_text().split() if log.exists() else []
