"""Digests of code that comments, docstrings and the place of a definition do not change."""

from __future__ import annotations

import ast
import atexit
import functools
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from sucre_bench.errors import OutputError
from sucre_bench.machine.files import user_cache, write_atomically
from sucre_bench.machine.provenance import distribution_of, version_of

# The rooms whose code decides a result, each with all its files. A hash adds the code of the plugins.
_NUMERICS = ("arrays", "camera", "degrade", "imaging", "loading", "multiview", "restored_pair", "scene")


# Libraries that the numerics compute with, or plugins for some value of an option. Those in `requires` come on top.
_LIBRARIES = ("cv2", "jax", "numba", "numpy", "scipy", "skimage")

# A file that changed less than so many seconds ago may change again without a new time stamp.
_SETTLED_S = 2.0


def engine_hash() -> str:
    """Return a hash of the engine's numerics, its version, and the libraries it computes with: 12 hex digits."""
    return hash_of(())


def hash_of(places: tuple[Path, ...], libraries: Iterable[str] = (), more: object = None) -> str:
    """Return a hash of the engine's numerics and of further code: 12 hex digits.

    places: Python files, or folders of them; libraries: import names whose versions count too; more: anything else
    that counts, by its repr. Raises FileNotFoundError if a room of the numerics is not there.
    """
    versions = [(name, version_of(distribution_of(name))) for name in sorted({*_LIBRARIES, *libraries})]
    code = {digest for place in (*places, *_numerics()) for digest in _statements(place)}
    made_of = (sorted(code), version_of("sucre-bench"), versions, more)
    return hashlib.blake2b(repr(made_of).encode(), digest_size=6).hexdigest()


@functools.cache
def _numerics() -> tuple[Path, ...]:
    """Return the files and folders of the engine's numerics. Raises FileNotFoundError if one of them is not there."""
    engine = Path(__file__).parent.parent
    modules = ((engine / f"{name}.py", engine / name) for name in _NUMERICS)
    places = tuple(module if module.is_file() else package for module, package in modules)
    for place in places:
        place.stat()
    return places


@functools.cache
def _statements(place: Path) -> frozenset[bytes]:
    """Digests of every top-level statement of a file, or of a folder's Python files, and of the tables (.csv) there."""
    files = list(place.rglob("*")) if place.is_dir() else [place]
    code = (digest for file in files if file.suffix == ".py" for digest in _kept().of(file, _digests_of))
    return frozenset([*map(bytes.fromhex, code), *(_digest(f.read_bytes()) for f in files if f.suffix == ".csv")])


@functools.cache
def _kept() -> KeptDigests:
    """The digests of earlier processes, as long as this file made them."""
    rule = _digest(Path(__file__).read_bytes()).hex()
    kept = KeptDigests(user_cache() / "code_digests.json", rule)
    atexit.register(kept.write)
    return kept


def _digests_of(file: Path) -> list[str]:
    return [digest.hex() for digest in _statements_of(file.read_bytes())]


def _statements_of(content: bytes) -> Iterator[bytes]:
    """A digest for each top-level statement but imports of this package; of the file if it does not parse."""
    try:
        body = ast.parse(content).body
    except (SyntaxError, ValueError):
        yield _digest(content)
        return
    for statement in body:
        if not (_is_prose(statement) or _is_our_import(statement) or _is_export_list(statement)):
            yield _digest(repr(_syntax(statement)).encode())


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=8).digest()


def _syntax(node: object) -> object:
    """A syntax tree as nested tuples, without positions, docstrings, imports from this package and empty fields.

    `ast.dump` is not used: its output differs between versions of Python.
    """
    if isinstance(node, ast.AST):
        fields = ((name, _syntax(value)) for name, value in ast.iter_fields(node) if name not in ("kind", "ctx"))
        return (type(node).__name__, *((name, value) for name, value in fields if value not in (None, ())))
    if isinstance(node, list):
        return tuple(_syntax(item) for item in node if not (_is_prose(item) or _is_our_import(item)))
    return node if isinstance(node, (str, bytes, int, float, complex, type(None))) else repr(node)


def _is_prose(node: object) -> bool:
    """Whether a statement is a bare string: a docstring, or the help of a field."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_our_import(node: object) -> bool:
    if isinstance(node, ast.ImportFrom):
        return bool(node.level) or (node.module or "").split(".")[0] in ("sucre_bench", "__future__")
    return isinstance(node, ast.Import) and all(name.name.split(".")[0] == "sucre_bench" for name in node.names)


def _is_export_list(node: object) -> bool:
    return isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)


class KeptDigests:
    """Digests by file, kept as JSON. A cache that cannot be read or written is done without.

    path: of the cache; rule: names what `compute` does; digests of another rule are not taken.
    """

    def __init__(self, path: Path, rule: str) -> None:
        self._path, self._rule = path, rule
        self._known = _read(path, rule)
        self._is_new = False

    def of(self, file: Path, compute: Callable[[Path], list[str]]) -> list[str]:
        """Return `compute(file)`, from the cache if the file's size and time of change are as they were."""
        state = file.stat()
        stamp = [state.st_size, state.st_mtime_ns]
        found = self._known.get(str(file))
        if found is not None and found[0] == stamp:
            return [str(digest) for digest in found[1]]
        digests = compute(file)
        if time.time() - state.st_mtime > _SETTLED_S:
            self._known[str(file)] = [stamp, digests]
            self._is_new = True
        return digests

    def write(self) -> None:
        """Write the cache if it has anything new. Files that no longer exist are left out."""
        if self._is_new:
            kept = {file: entry for file, entry in self._known.items() if Path(file).exists()}
            with suppress(OutputError):
                write_atomically(self._path, json.dumps({"rule": self._rule, "files": kept}).encode())


def _read(path: Path, rule: str) -> dict[str, Any]:
    with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
        content = json.loads(path.read_bytes())
        return dict(content["files"].items()) if content["rule"] == rule else {}
    return {}
