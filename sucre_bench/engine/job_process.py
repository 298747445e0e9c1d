"""Runs one job, given as text, in a process of its own, which notes its steps for the process that waits for it."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from sucre_bench.engine.run_job import run_job
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress_display
from sucre_bench.machine.current_step import NoteFile, at_work
from sucre_bench.results.layout import at_work_path
from sucre_bench.results.table import FLUSH_S


def run_text(
    config: str,
    shared_pairs: str = "",
    flush_s: float = FLUSH_S,
    deaths: Mapping[str, str] = MappingProxyType({}),
    start: str = "",
) -> None:
    """Run a job in a process of its own, which shows no progress. config, shared_pairs: of a `Job`.

    The process notes its steps in a file of the output folder, which stays if it dies. deaths, start: see
    `machine.current_step.at_work`.
    """
    with progress_display.plain():
        job = replace(Job.read(config), shared_pairs=shared_pairs)
        path = at_work_path(job.out, config)
        file = NoteFile.at(path)
        try:
            with at_work(file, deaths, start):
                run_job(job, flush_s=flush_s)
        finally:
            file.close()
            remove_note(path)


def remove_note(path: Path) -> None:
    """Remove the note of a process that has ended."""
    path.unlink(missing_ok=True)
    with suppress(OSError):  # another job is at work
        path.parent.rmdir()
