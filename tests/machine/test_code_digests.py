"""Digests of files are computed again only where a file changed."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from sucre_bench.machine.code_digests import KeptDigests

pytestmark = pytest.mark.short


def _written(file: Path, text: str, changed: float) -> Path:
    file.write_text(text)
    os.utime(file, (changed, changed))
    return file


def _content(file: Path) -> list[str]:
    return [file.read_text()]


def _never(file: Path) -> list[str]:
    raise AssertionError(f"{file} is read again")


def test_a_later_process_takes_what_an_earlier_one_found(tmp_path: Path):
    file, cache = _written(tmp_path / "a.py", "one", 1000), tmp_path / "cache" / "kept.json"
    first = KeptDigests(cache, "rule")
    assert first.of(file, _content) == ["one"]
    first.write()
    assert KeptDigests(cache, "rule").of(file, _never) == ["one"]
    assert KeptDigests(cache, "other rule").of(file, _content) == ["one"]


@pytest.mark.parametrize(("text", "changed"), [("two", 2000), ("longer", 1000)])
def test_a_changed_file_is_read_again(tmp_path: Path, text: str, changed: float):
    file, cache = _written(tmp_path / "a.py", "one", 1000), tmp_path / "kept.json"
    first = KeptDigests(cache, "rule")
    first.of(file, _content)
    first.write()
    _written(file, text, changed)
    assert KeptDigests(cache, "rule").of(file, _content) == [text]


def test_a_file_that_may_still_change_is_not_kept(tmp_path: Path):
    file = tmp_path / "a.py"
    file.write_text("one")
    kept = KeptDigests(tmp_path / "kept.json", "rule")
    assert kept.of(file, _content) == ["one"]
    file.write_text("two")
    assert kept.of(file, _content) == ["two"]


def test_a_damaged_cache_is_done_without(tmp_path: Path):
    file, cache = _written(tmp_path / "a.py", "one", 1000), tmp_path / "kept.json"
    for content in (b"", b"[]", b'{"rule": "rule", "files": 3}', b"\xff"):
        cache.write_bytes(content)
        assert KeptDigests(cache, "rule").of(file, _content) == ["one"]
