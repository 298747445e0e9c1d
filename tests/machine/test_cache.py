"""Arrays that the processes of a run share in files."""

import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from sucre_bench.machine.cache import ArrayStore

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
        found = list(pool.map(lambda _: ArrayStore(tmp_path / "s", 1e9).get("a", make), range(16)))
    assert make.times == 1
    assert all((values == 1.5).all() for values in found)
    assert not found[0].flags.writeable


def test_small_arrays_and_those_larger_than_the_store_are_not_stored(tmp_path: Path):
    for small, most_bytes in ((_Maker(1, 10), 1e9), (_Maker(2), 1000)):
        store = ArrayStore(tmp_path, most_bytes)
        assert store.get("a", small)[0] == store.get("a", small)[0] == small.value
        assert small.times == 2
    assert not list(tmp_path.glob("*.npy"))


def test_a_full_store_drops_what_was_used_longest_ago(tmp_path: Path):
    store, makers = ArrayStore(tmp_path, 2.5 * 8 * N), {name: _Maker(n) for n, name in enumerate("abc")}
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
