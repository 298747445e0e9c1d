"""Arrays that the processes of a run share in files."""

from __future__ import annotations

import errno
import os
import runpy
import subprocess
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sucre_bench.errors import InputError
from sucre_bench.machine.cache import ArrayStore, waited_lock
from sucre_bench.machine.compute import compiled

pytestmark = pytest.mark.short
N = 100_000  # float64: 800 kB


class _Maker:
    """Makes an array, and counts how often."""

    def __init__(self, value: float, n: int = N) -> None:
        self.value, self.n, self.times = value, n, 0

    def __call__(self) -> np.ndarray:
        self.times += 1
        return np.full(self.n, self.value)


def test_an_array_is_made_once_for_all_threads_and_processes(tmp_path: Path):
    make = _Maker(1.5)
    with ThreadPoolExecutor(8) as pool:
        found = list(
            pool.map(lambda _: ArrayStore(tmp_path / "s", 1e9).get("a", make), range(16))
        )
    assert make.times == 1
    assert all((values == 1.5).all() for values in found)
    assert not found[0].flags.writeable


def test_a_full_store_drops_what_was_used_longest_ago(tmp_path: Path):
    store, makers = (
        ArrayStore(tmp_path, 2.5 * 8 * N),
        {name: _Maker(n) for n, name in enumerate("abc")},
    )
    a = store.get("a", makers["a"])
    for n, file in enumerate(sorted(tmp_path.glob("*.npy"))):
        os.utime(file, (1000 + n, 1000 + n))
    for name in "bac":  # a is used again, b is the older one
        store.get(name, makers[name])
        if name == "b":
            newest = max(tmp_path.glob("*.npy"), key=lambda file: file.stat().st_mtime)
            os.utime(newest, (2000, 2000))
    for name in "ac":
        store.get(name, makers[name])
    assert [makers[name].times for name in "abc"] == [1, 1, 1]
    store.get("b", makers["b"])
    assert makers["b"].times == 2
    assert (a == 0).all()  # mapped arrays outlive their file


def test_a_damaged_file_is_made_again(tmp_path: Path):
    store, make = ArrayStore(tmp_path, 1e9), _Maker(3)
    store.get("a", make)
    (file,) = tmp_path.glob("*.npy")
    for content in (b"", file.read_bytes()[:-1000], b"x" * 500):
        file.write_bytes(content)
        assert (store.get("a", make) == 3).all()
    assert make.times == 4


def test_without_a_place_to_write_to_arrays_are_made(tmp_path: Path):
    (tmp_path / "file").write_text("in the way")
    make = _Maker(4)
    assert (ArrayStore(tmp_path / "file", 1e9).get("a", make) == 4).all()


@pytest.mark.parametrize(
    "code", [errno.ENOSYS, errno.ENOLCK, errno.EOPNOTSUPP], ids=errno.errorcode.get
)
def test_one_process_at_a_time_holds_a_lock_where_the_file_system_has_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
):
    def refuse(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr("fcntl.flock", refuse)
    held = {"patience_s": 0.0, "silent_s": 0.1}
    for _ in range(2):
        first, second = (waited_lock(tmp_path / "lock", **held) for _ in range(2))
        with first, pytest.raises(InputError, match="lock"), second:
            pass


_SCRIPT = """
import sys
from sucre_bench.machine.compute import compiled
from loops import double
assert compiled(double)(2) == 4
assert "torch" not in sys.modules
"""


def test_compiling_is_announced_once_on_a_machine(tmp_path: Path):
    (tmp_path / "loops.py").write_text("def double(x):\n    return 2 * x\n")

    def told() -> str:
        here = {**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])}
        ran = subprocess.run(
            [sys.executable, "-c", _SCRIPT],
            env=here,
            capture_output=True,
            text=True,
            check=True,
        )
        return ran.stderr

    assert "compiling" in told()
    assert told() == ""


def test_a_loop_is_compiled_where_no_place_can_keep_it():
    """As for a user who can write neither the package's folder nor a home: numba refuses to cache such a function."""
    names: dict[str, Any] = {}
    # has no file, so numba finds no place beside it
    exec("def double(x):\n    return 2 * x\n", names)
    assert compiled(names["double"])(21) == 42


DAMAGES: dict[str, Callable[[bytes], bytes]] = {
    "cut": lambda content: content[: len(content) // 2],
    "empty": lambda content: b"",
    "zeros": lambda content: bytes(len(content)),
    "a bit near its end": lambda content: (
        content[:-40] + bytes([content[-40] ^ 1]) + content[-39:]
    ),
}


def test_damaged_files_of_compiled_code_are_made_again(tmp_path: Path):
    (tmp_path / "loops.py").write_text("def double(x):\n    return 2 * x\n")

    def doubled() -> tuple[float, bool]:
        """What a loop of a new process gives, and whether its code was read from the disk."""
        loop: Any = compiled(runpy.run_path(str(tmp_path / "loops.py"))["double"])
        return loop(21.0), bool(loop.stats.cache_hits)

    assert doubled() == (42, False)
    assert doubled() == (42, True)
    files = [path for path in tmp_path.rglob("*") if path.suffix in (".nbi", ".nbc")]
    assert len(files) == 2
    for file in files:
        for damage in DAMAGES.values():
            file.write_bytes(damage(file.read_bytes()))
            assert doubled() == (42, False)
            assert doubled() == (42, True)
