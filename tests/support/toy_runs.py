"""Runs of the toy plugins, methods and metrics too in this process: another test may have started threads in it."""

from __future__ import annotations

from pathlib import Path

from sucre_bench.engine.run import Outcome
from sucre_bench.engine.run import run as run_jobs


def run(out: Path, *overrides: str, multirun: bool = False) -> Outcome:
    base = ["dataset=toy", "method=gain", "metrics=[psnr,redness]", "tracking.uri=off", "workers=0", f"out={out}"]
    return run_jobs([*base, *overrides], multirun)


def calls(log: Path) -> list[str]:
    return log.read_text().split() if log.exists() else []
