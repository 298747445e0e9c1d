"""Ctrl-C at moments at which something would be left behind."""

import signal
from pathlib import Path

import pytest

from sucre_bench.machine import files
from sucre_bench.machine.processes import interrupts_held_back

pytestmark = pytest.mark.short


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
