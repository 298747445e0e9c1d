"""Digests of files are computed again only where a file changed."""

import os
import time
from pathlib import Path

import pytest

from sucre_bench.machine import provenance

pytestmark = pytest.mark.short


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(provenance, "user_cache", lambda: tmp_path / "cache")
    return tmp_path / "cache"


@pytest.fixture
def code(tmp_path: Path) -> Path:
    """A folder of two files that were written long ago."""
    (tmp_path / "code").mkdir()
    write(tmp_path / "code" / "a.py", "x = 1")
    write(tmp_path / "code" / "b.py", "y = 1")
    return tmp_path / "code"


def write(file: Path, text: str, changed: float = 1000) -> None:
    file.write_text(text)
    os.utime(file, (changed, changed))


def hash_in_new_process(place: Path) -> str:
    provenance._statements.cache_clear()  # noqa: SLF001 - what another process does not have
    return provenance.hash_of((place,))


def unread(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise AssertionError("a file is parsed again")

    monkeypatch.setattr(provenance.ast, "parse", refuse)


def test_a_later_process_takes_what_an_earlier_one_found(cache: Path, code: Path, monkeypatch: pytest.MonkeyPatch):
    first = hash_in_new_process(code)
    unread(monkeypatch)
    assert hash_in_new_process(code) == first


@pytest.mark.parametrize(("text", "changed"), [("x = 2", 2000), ("x = 10", 1000)])
def test_a_changed_file_is_read_again(cache: Path, code: Path, text: str, changed: float):
    first = hash_in_new_process(code)
    write(code / "a.py", text, changed)
    assert hash_in_new_process(code) != first


def test_a_file_that_may_still_change_is_not_stored(cache: Path, code: Path):
    soon = time.time() + 3600  # as if it was written just now, however long this test takes
    write(code / "a.py", "x = 2", soon)
    first = hash_in_new_process(code)
    write(code / "a.py", "x = 3", soon)
    assert hash_in_new_process(code) != first


@pytest.mark.parametrize("content", [b'{"of": 3}', b"\xff"])
def test_a_damaged_cache_is_made_again(cache: Path, code: Path, monkeypatch: pytest.MonkeyPatch, content: bytes):
    first = hash_in_new_process(code)
    for file in (cache / "code").glob("*.json"):
        file.write_bytes(content)
    assert hash_in_new_process(code) == first
    unread(monkeypatch)
    assert hash_in_new_process(code) == first


def test_without_a_place_to_write_to_code_is_read(cache: Path, code: Path, monkeypatch: pytest.MonkeyPatch):
    first = hash_in_new_process(code)
    monkeypatch.setattr(provenance, "user_cache", lambda: Path("/proc/none"))
    assert hash_in_new_process(code) == first
