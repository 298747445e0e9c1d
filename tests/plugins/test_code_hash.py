"""The hash of what a result rests on."""

from pathlib import Path

import pytest

from sucre_bench.machine import provenance
from sucre_bench.plugins.options import source_hash
from sucre_bench.plugins.registry import find

METHOD = '''
from dataclasses import dataclass
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Typed:
    """Nothing."""
    def restore(self, scene, view):
        return Restoration(view.rgb * {factor})
'''


def test_it_follows_the_plugins_own_file():
    assert source_hash(find("method", "gray_world")) != source_hash(
        find("method", "underwater")
    )


def test_it_follows_files_and_what_is_in_folders_wherever_they_lie(tmp_path: Path):
    weights = tmp_path / "a" / "w.pth"
    weights.parent.mkdir()
    weights.write_bytes(b"1")
    file, folder = source_hash(files=[weights]), source_hash(files=[weights.parent])
    assert len({source_hash(), file, folder}) == 3
    moved = weights.parent.rename(tmp_path / "b")
    assert source_hash(files=[moved]) == folder
    (moved / "w.pth").write_bytes(b"12")
    assert source_hash(files=[moved]) != folder


def test_it_follows_the_libraries_that_compute(monkeypatch: pytest.MonkeyPatch):
    """Of a method's own libraries and of the engine's; what only draws or logs does not count."""
    gray_world, sucre = find("method", "gray_world"), find("method", "sucre")
    installed = provenance.version_of

    def with_other(name: str):
        monkeypatch.setattr(
            provenance,
            "version_of",
            lambda package: "0.0" if package == name else installed(package),
        )
        return source_hash(gray_world), source_hash(sucre)

    before = with_other("")
    assert all(a != b for a, b in zip(with_other("numpy"), before, strict=True))
    assert [a != b for a, b in zip(with_other("torch"), before, strict=True)] == [False, True]
    assert with_other("mlflow") == before


def test_what_python_compiles_and_hidden_files_do_not_count(tmp_path: Path):
    """A program's first run must not make its second one restore everything again."""
    (tmp_path / "program.py").write_text("1")
    before = source_hash(files=[tmp_path])
    for name in ("__pycache__", ".git"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "x").write_text("1")
    assert source_hash(files=[tmp_path]) == before


def test_a_class_typed_into_a_session_has_a_hash_of_its_own():
    """As in a notebook, where no file holds it."""

    def typed(factor: float) -> object:
        space: dict = {"__name__": "typed_into_a_session"}
        exec(compile(METHOD.format(factor=factor), "<input>", "exec"), space)
        return space["Typed"].__plugin__

    assert source_hash(typed(0.5)) == source_hash(typed(0.5)) != source_hash(typed(0.7))


def test_a_changed_file_of_a_folder_counts_and_a_moved_one_does_not(tmp_path: Path):
    """Stored results outlive a module moved, not a changed constant."""

    def hash_now() -> str:
        provenance._digests.cache_clear()  # noqa: SLF001 - what another process does not have
        return provenance.hash_of((tmp_path,))

    (tmp_path / "a.py").write_text("x = 1")
    (tmp_path / "b.csv").write_text("1,2")
    before = hash_now()
    (tmp_path / "inner").mkdir()
    (tmp_path / "a.py").rename(tmp_path / "inner" / "c.py")
    assert hash_now() == before
    (tmp_path / "b.csv").write_text("1,3")
    assert hash_now() != before
