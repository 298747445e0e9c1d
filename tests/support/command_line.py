"""The command line: run in this process, as a process of its own, or looked at; the plugins and packages it finds."""

from __future__ import annotations

import contextlib
import fcntl
import functools
import importlib.util
import io
import mmap
import multiprocessing
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import forkserver
from multiprocessing.context import ForkServerContext
from pathlib import Path
from typing import TYPE_CHECKING
from unittest import mock

import click
import pytest
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher

from sucre_bench.cli import cli, main
from sucre_bench.machine import terminal
from sucre_bench.plugins import KINDS, Registry, discover, load_file
from sucre_bench.plugins.registry import using

if TYPE_CHECKING:
    import pandas as pd

    from sucre_bench.engine.run import Outcome

# What no quick answer imports.
HEAVY = {
    "colour",
    "cv2",
    "hydra",
    "jax",
    "mlflow",
    "numba",
    "open3d",
    "pandas",
    "pycolmap",
    "scipy",
    "skimage",
    "torch",
}

# No test waits for the disk: tests kill processes, and never the machine, and what a process has written outlives it.
# Programs that tests start as they are do wait.
os.fsync = lambda fd: None
_compile = Dispatcher.compile


def _compile_alone(self: Dispatcher, signature: object) -> object:
    """Processes of tests that need the same loop compile it once: the others wait, and read it from numba's cache."""
    if global_compiler_lock.is_locked():  # by this thread, for a loop that calls this one
        return _compile(self, signature)
    compiling = (
        Path(tempfile.gettempdir())
        / f"sucre_bench_compiling.{os.getuid()}.{self.py_func.__qualname__}"
    )
    with global_compiler_lock, compiling.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        return _compile(self, signature)


Dispatcher.compile = _compile_alone
PROGRAM = str(Path(sys.executable).with_name("sucre-bench"))
_PROGRESS = re.compile(r": (\d+/\d+(, about .* left)?|\d+ done in [\d.]+ s)$")
WIDTH = 200  # columns, so that no line is folded


@dataclass(frozen=True)
class Done:
    """What a command printed, and its exit code."""

    returncode: int
    stdout: str
    stderr: str

    @property
    def errors(self) -> list[str]:
        """The lines on stderr but for those of progress: whatever takes a second prints one, and on a busy machine
        anything does.
        """
        return [line for line in self.stderr.splitlines() if not _PROGRESS.search(line)]


def run_here(folder: Path, *arguments: str) -> Done:
    """Run `sucre-bench ARGUMENTS` in this process, in a folder, without the plugin files loaded before.

    For one call at a time; what other processes print is not caught.
    """
    out, err = (
        io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2)
    )
    with (
        contextlib.chdir(folder),
        using(registry()),
        mock.patch.dict(os.environ, COLUMNS=str(WIDTH)),
        mock.patch.object(sys, "argv", [PROGRAM, *arguments]),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as ended:
            status = ended.code
    assert isinstance(status, int)
    return Done(status, *(stream.buffer.getvalue().decode() for stream in (out, err)))


def succeeded(folder: Path, *arguments: str) -> Done:
    """Run `sucre-bench ARGUMENTS` as `run_here` does; it must succeed."""
    done = run_here(folder, *arguments)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


class Started:
    """`sucre-bench ARGUMENTS` at work in a process of its own, which leads a group of processes.

    The process is forked from one that has imported the engine already: for tests that kill many.
    dies_at: the change of a file in the folder before which it is killed, counted from 1; 0 for never.
    before: is called in the process first, to take rights or room from it.
    """

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        dies_at: int = 0,
        before: Callable[[], None] | None = None,
    ) -> None:
        self._said = Path(tempfile.mkdtemp())
        self._process = forks().Process(
            target=_run, args=(folder, self._said, arguments, dies_at, before)
        )
        self._process.start()

    def send(self, number: signal.Signals, to_group: bool = False) -> None:
        assert self._process.pid
        (os.killpg if to_group else os.kill)(self._process.pid, number)

    def ended(self, timeout: float = 600) -> Done:
        """Wait for the end. returncode: minus the signal's number where a signal was the end."""
        self._process.join(timeout)
        status = self._process.exitcode
        said = [(self._said / name).read_text(encoding="utf-8") for name in ("out", "err")]
        self.changes = len((self._said / "changes").read_bytes())
        shutil.rmtree(self._said)
        assert status is not None, "the command does not end"
        return Done(status, *said)


_FIRST_ENVIRONMENT = dict(os.environ)


def forks() -> ForkServerContext:
    """Make processes by forking one that has imported the engine, whichever test is the first to ask for one."""
    # Before Python 3.14 it does not look in our sys.path.
    environment = {**_FIRST_ENVIRONMENT, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    with mock.patch.dict(os.environ, environment, clear=True):
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["support.warm", __name__])
        forkserver.ensure_running()
    return context


def _run(
    folder: Path,
    said: Path,
    arguments: tuple[str, ...],
    dies_at: int,
    before: Callable[[], None] | None,
) -> None:
    os.setsid()
    os.chdir(folder)
    _count_changes(folder, said / "changes", dies_at)
    for name, stream in (("out", 1), ("err", 2)):
        os.dup2(os.open(said / name, os.O_WRONLY | os.O_CREAT), stream)
    sys.stdout, sys.stderr = (open(stream, "w", encoding="utf-8") for stream in (1, 2))  # noqa: PTH123, SIM115
    terminal.out.width = terminal.err.width = WIDTH
    sys.argv = [PROGRAM, *arguments]
    if before is not None:
        before()
    main()


def run_bounded(folder: Path, *arguments: str) -> Done:
    """Run `sucre-bench ARGUMENTS` as `Started` does, with little memory and time, to its end."""
    return Started(folder, *arguments, before=_bound).ended()


def _bound() -> None:
    held = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (held + (1 << 30),) * 2)
    resource.setrlimit(resource.RLIMIT_CPU, (100, 100))


_CHANGES = {
    "open",
    "os.link",
    "os.mkdir",
    "os.remove",
    "os.rename",
    "os.rmdir",
    "os.symlink",
    "os.truncate",
}


def _count_changes(folder: Path, told: Path, dies_at: int) -> None:
    """Append a byte to a file for each change of files in a folder; kill this process before one of them.

    Changes by its workers count, too.
    """
    count, counted = mmap.mmap(-1, 4), os.open(told, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    ours = os.getpid()

    def changing(event: str, arguments: tuple[object, ...]) -> None:
        if event not in _CHANGES or not isinstance(arguments[0], str | bytes | Path):
            return
        if event == "open" and not int(str(arguments[2])) & (os.O_WRONLY | os.O_RDWR):
            return
        if (folder / os.fsdecode(arguments[0])).is_relative_to(folder):
            changes = int.from_bytes(count[:]) + 1
            count[:] = changes.to_bytes(4)
            if changes == dies_at:
                os.kill(ours, signal.SIGKILL)
            os.write(counted, b".")

    sys.addaudithook(changing)


def run_program(folder: Path, *arguments: str, **environment: str) -> Done:
    """Run `sucre-bench ARGUMENTS` as a process of its own, in a folder."""
    done = subprocess.run(
        [PROGRAM, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=900,
        env={**os.environ, "COLUMNS": str(WIDTH), **environment},
    )
    return Done(done.returncode, done.stdout, done.stderr)


def commands() -> dict[str, click.Command]:
    """Every command by name."""
    context = click.Context(cli)
    return {
        name: command
        for name in cli.list_commands(context)
        if (command := cli.get_command(context, name))
    }


def install(source: Path, target: Path) -> None:
    """Install the package in `source` into `target`, without what it needs."""
    quietly = ["-q", "--disable-pip-version-check", "--no-compile"]
    alone = ["--no-deps", "--no-build-isolation"]
    command = [
        sys.executable,
        "-m",
        "pip",
        "install",
        *quietly,
        *alone,
        "--target",
        str(target),
        str(source),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def registry(*files: Path) -> Registry:
    """Return a registry of its own with the built-in plugins and those of some files: no other test finds them."""
    return _discovered(*files).copy()


@functools.cache
def _discovered(*files: Path) -> Registry:
    with using(Registry()) as found:
        for file in files:
            load_file(file)
        for kind in KINDS:
            discover(kind)
    return found


def run(out: Path, *overrides: str, multirun: bool = False) -> Outcome:
    """Run the toy plugins in this process, methods and metrics too: another test may have started threads in it.

    Without a page.
    """
    from sucre_bench.engine.hydra_run import run_words as run_jobs

    base = [
        "dataset=toy",
        "method=gain",
        "metrics=[psnr,redness]",
        "tracking.uri=off",
        "workers=0",
        "report=false",
        f"out={out}",
    ]
    return run_jobs([*base, *overrides], multirun)


def but_times(rows: pd.DataFrame) -> pd.DataFrame:
    """A table without how long things took, and the memory that the process happened to hold."""
    times = ["seconds", "peak_mb", "time"]
    rows = rows.drop(columns=times).assign(
        value=rows["value"].where(~rows["metric"].isin(times), 0.0)
    )
    return rows.sort_values(
        ["dataset", "method", "view", "metric", "variant", "region"]
    ).reset_index(drop=True)


def calls(log: Path) -> list[str]:
    """The views that the toy method `gain` has restored."""
    return log.read_text().split() if log.exists() else []


EXTRAS = ("mlflow", "torch", "jax", "open3d", "pycolmap", "onnxruntime", "colour", "mkdocs")


def hide(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Let Python find none of these packages, by import name, for the time of a test.

    names: by default those whose imports take seconds, for tests of `doctor`, which imports what there is.
    """
    names = names or EXTRAS
    find_spec = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util,
        "find_spec",
        lambda name, *more: None if name in names else find_spec(name),
    )
