"""What a terminal and a pipe each get: escape codes or none, and no complaint when the reader has gone."""

from __future__ import annotations

import os
import pty
import re
import signal
import subprocess
from collections.abc import Callable
from pathlib import Path

import pytest
from support.command_line import PROGRAM, Done

from sucre_bench.machine import files
from sucre_bench.machine.processes import interrupts_held_back
from sucre_bench.machine.text_formats import masked

ESCAPE = "\x1b["
COLOUR = re.compile(r"\x1b\[(?:\d+;)*3\d")
RUN = ("dataset=toy", "method=faulty", "metrics=[redness]", "tracking.uri=off", "report=false")

pytestmark = pytest.mark.short


def in_terminal(*arguments: str, folder: Path, **environment: str) -> str:
    """What a real terminal gets to see."""
    parent, child = pty.openpty()
    unset = ("NO_COLOR", "FORCE_COLOR", "TERM", "COLORTERM")
    env = (
        {k: v for k, v in os.environ.items() if k not in unset}
        | {"TERM": "xterm-256color"}
        | environment
    )
    with subprocess.Popen(
        [PROGRAM, *arguments], stdout=child, stderr=child, stdin=child, cwd=folder, env=env
    ):
        os.close(child)
        said = b""
        while True:
            try:
                chunk = os.read(parent, 65536)
            except OSError:  # how Linux says that the other end has closed
                break
            if not chunk:
                break
            said += chunk
    os.close(parent)
    return said.decode()


def test_colours_are_for_terminals_and_no_color_takes_them_away(tmp_path: Path):
    assert COLOUR.search(in_terminal("mistaken", folder=tmp_path))
    assert not COLOUR.search(in_terminal("mistaken", folder=tmp_path, NO_COLOR="1"))
    assert ESCAPE not in in_terminal("mistaken", folder=tmp_path, TERM="dumb")


def test_force_color_colours_a_log_but_draws_no_bars(program: Callable[..., Done], toys: str):
    done = program("run", "--plugin", toys, *RUN, FORCE_COLOR="1")
    assert COLOUR.search(done.stdout)
    assert "\r" not in done.stderr
    assert "\x1b[?25l" not in done.stderr  # how a bar hides the cursor


def test_a_terminal_gets_bars_that_are_drawn_in_place(toys: str, tmp_path: Path):
    said = in_terminal("run", "--plugin", toys, *RUN, folder=tmp_path)
    assert "\x1b[?25l" in said  # the cursor is hidden while bars are drawn
    assert "\\x1b" not in said  # and their codes are not written out, as those of names are
    assert "\\r" not in said


def test_a_reader_that_has_enough_is_no_fault(tmp_path: Path):
    """As `| head -1`; here the reader is gone before anything is written, which Python does when the command ends."""
    reading, writing = os.pipe()
    os.close(reading)
    env = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    done = subprocess.run(
        [PROGRAM, "run", "--help"],
        stdout=writing,
        stderr=subprocess.PIPE,
        cwd=tmp_path,
        env=env,
    )
    os.close(writing)
    assert (done.stderr, done.returncode) == (b"", 141)


def test_an_interrupt_that_is_held_back_takes_effect_at_the_end_of_the_block():
    seen = list[int]()

    def block() -> None:
        with interrupts_held_back() as held:
            signal.raise_signal(signal.SIGINT)
            seen.extend(held)

    with pytest.raises(KeyboardInterrupt):
        block()
    assert seen == [signal.SIGINT]
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)  # the handler is what it was


def test_an_interrupted_file_is_the_old_one_and_nothing_is_left_beside_it(tmp_path: Path):
    path = tmp_path / "a.txt"
    files.write_atomically(path, b"old")

    def write() -> None:
        with files.open_atomically(path) as file:
            file.write(b"ne")
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(KeyboardInterrupt):
        write()
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    ("address", "shown"),
    [
        ("postgresql://me:pa:ss@host:5432/runs", "postgresql://***@host:5432/runs"),
        ("http://:secret@host", "http://***@host"),
        ("http://token@host:5000", "http://***@host:5000"),
        ("http://me:a/b@c?d#e'f@host:5000", "http://***@host:5000"),
        ("https://host/x?token=abc&page=2", "https://host/x?token=***&page=***"),
        ("https://host/x?abc", "https://host/x?***"),
        ("https://host/x?X-Amz-Signature=a=b;c=d", "https://host/x?X-Amz-Signature=***;c=***"),
        ("https://host/#access_token=abc", "https://host/#access_token=***"),
        ("sqlite:////home/me@lab/mlflow.db", "sqlite:////home/me@lab/mlflow.db"),
        ("http://host:5000/runs", "http://host:5000/runs"),
        (
            "me@host.org, see (https://host:80/a) or b@c",
            "me@host.org, see (https://host:80/a) or b@c",
        ),
    ],
)
def test_a_password_is_masked_and_nothing_else(address: str, shown: str):
    assert masked(address) == shown
    assert masked(f"uri: '{address}'\n") == f"uri: '{shown}'\n"
