"""The command line: run in this process, as a process of its own, or looked at."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from unittest import mock

import click
from rich.console import Console

from sucre_bench.cli import cli, main
from sucre_bench.machine import terminal
from sucre_bench.plugins.registry import only_built_in

PROGRAM = str(Path(sys.executable).with_name("sucre-bench"))
WIDTH = 200  # columns, so that no line is folded


@dataclass(frozen=True)
class Done:
    """What a command printed, and its exit code."""

    returncode: int
    stdout: str
    stderr: str


@contextlib.contextmanager
def _wide(console: Console) -> Iterator[None]:
    before = console.width
    console.width = WIDTH
    try:
        yield
    finally:
        console.width = before


def run_here(folder: Path, *arguments: str) -> Done:
    """Run `sucre-bench ARGUMENTS` in this process, in a folder, without the plugin files loaded before.

    For one call at a time; what other processes print is not caught.
    """
    out, err = (io.TextIOWrapper(io.BytesIO(), encoding="utf-8", write_through=True) for _ in range(2))
    with (
        contextlib.chdir(folder),
        only_built_in(),
        mock.patch.dict(os.environ, COLUMNS=str(WIDTH)),
        mock.patch.object(sys, "argv", [PROGRAM, *arguments]),
        _wide(terminal.out),
        _wide(terminal.err),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
        except SystemExit as ended:
            status = ended.code
    assert isinstance(status, int)
    return Done(status, *(stream.buffer.getvalue().decode() for stream in (out, err)))  # type: ignore[attr-defined]


def run_program(folder: Path, *arguments: str, **environment: str) -> Done:
    """Run `sucre-bench ARGUMENTS` as a process of its own, in a folder."""
    done = subprocess.run(
        [PROGRAM, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        env={**os.environ, "COLUMNS": str(WIDTH), **environment},
    )
    return Done(done.returncode, done.stdout, done.stderr)


def commands() -> dict[str, click.Command]:
    """Every command by name."""
    context = click.Context(cli)
    return {name: command for name in cli.list_commands(context) if (command := cli.get_command(context, name))}
