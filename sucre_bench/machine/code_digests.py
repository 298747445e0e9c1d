"""Digests of code that comments, docstrings and the place of a definition do not change."""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import os
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from sucre_bench.machine.cache import get_or_make
from sucre_bench.machine.files import user_cache
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
    code = _statements(*_numerics()).union(*map(_statements, places))
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
def _statements(*places: Path) -> frozenset[bytes]:
    """Digests of every top-level statement of files, or of folders' Python files, and of the tables (.csv) there.

    They are stored in the user's cache, with size and time of change of the files; not those of a user's own file.
    """
    inside = (place.rglob("*") if place.is_dir() else [place] for place in places)
    files = sorted(file for found in inside for file in found if file.suffix in (".py", ".csv"))
    if len(files) == 1 and not files[0].resolve().is_relative_to(Path(__file__).resolve().parent.parent.parent):
        return frozenset(_digests_of(files[0]))
    states = [file.stat() for file in files]
    rule = _digest(Path(__file__).read_bytes()).hex()  # digests of another rule are not taken
    of = [rule, *([str(file), state.st_size, state.st_mtime_ns] for file, state in zip(files, states, strict=True))]

    def read(path: Path) -> frozenset[bytes] | None:
        with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
            stored = json.loads(path.read_bytes())
            return frozenset(map(bytes.fromhex, stored["digests"])) if stored["of"] == of else None
        return None

    def make(path: Path) -> frozenset[bytes]:
        digests = frozenset(digest for file in files for digest in _digests_of(file))
        if time.time() - max((state.st_mtime for state in states), default=0) > _SETTLED_S:
            path.write_text(json.dumps({"of": of, "digests": sorted(digest.hex() for digest in digests)}))
        return digests

    try:
        return get_or_make(user_cache() / "code" / f"{_digest(repr(places).encode()).hex()}.json", read, make)
    except OSError:  # no place to write to
        return make(Path(os.devnull))


def _digests_of(file: Path) -> Iterator[bytes]:
    return iter([_digest(file.read_bytes())]) if file.suffix == ".csv" else _statements_of(file.read_bytes())


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
