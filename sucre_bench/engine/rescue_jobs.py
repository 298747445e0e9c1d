"""Runs jobs again that were lost when a worker process died."""

from collections.abc import Sequence
from multiprocessing import get_context
from pathlib import Path

from sucre_bench import results
from sucre_bench.engine.failed_rows import failed_row
from sucre_bench.engine.job_process import remove_note, run_text
from sucre_bench.engine.preflight import Planned, states
from sucre_bench.errors import PluginError
from sucre_bench.jobs.job import Job
from sucre_bench.machine import progress
from sucre_bench.machine.current_step import Note, NoteFile
from sucre_bench.machine.supervisor import how_it_ended
from sucre_bench.results.layout import at_work_path, file_name


def rescue(planned: Sequence[Planned], started: str) -> None:
    """Run the jobs that a dead worker of this machine left undone, each in a process of its own.

    A view or score that ends its process again gets a row that says so, and the job goes on in the next process.
    """
    for plan in planned:  # all workers end with one: the notes of the others say nothing
        remove_note(at_work_path(plan.job.out, plan.job.config))
    progress.say("a worker process died; its unfinished jobs run again, each in a process of its own")
    for plan in planned:
        rows = results.merge(plan.job.out)
        if all(state.status != "missing" for state in states(rows, plan, started)):
            continue
        _run_alone(plan.job, started)


def _run_alone(job: Job, started: str) -> None:
    """Run a job in a process of its own; if that dies at a step, in the next, without the step."""
    path, deaths = at_work_path(job.out, job.config), dict[str, str]()
    while (status := _status_of(job, deaths, started)) != 0:
        note = _left_note(path)
        how = how_it_ended(status, note)
        if not note.step or note.step in deaths:
            fault = PluginError(f"the job's process died ({how}); try smaller images")
            results.write_rows(job.out, file_name(job.method.label), [failed_row(job, fault)])
            return
        deaths[note.step] = how


def _status_of(job: Job, deaths: dict[str, str], started: str) -> int:
    """Run a job in a new process; return its exit code, or minus the number of the signal that ended it."""
    # Every view is written at once: the next one may end the process.
    arguments = (job.config, job.shared_pairs, 0.0, deaths, started)
    process = get_context("spawn").Process(target=run_text, args=arguments)
    process.start()
    try:
        process.join()
    finally:
        if process.is_alive():
            process.terminate()
            process.join()
    assert process.exitcode is not None
    return process.exitcode


def _left_note(path: Path) -> Note:
    """Take the note that a process has left."""
    file = NoteFile.at(path)
    note = file.read()
    file.close()
    remove_note(path)
    return note
