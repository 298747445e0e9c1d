"""What a result rests on, as one short hash: the source that made it, and the files that options name."""

from __future__ import annotations

import ast
import functools
import hashlib
import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

import sucre_bench
from sucre_bench.plugins import Plugin, distribution_of
from sucre_bench.provenance import version_of

__all__ = ["source_hash"]

# The engine's numerics: modules and packages of sucre_bench, each with all that lies in it.
_NUMERICS = (
    "scene",
    "restoring",
    "colour",
    "charts",
    "chart_kinds",
    "cielab",
    "images",
    "multiview",
    "steps",
    "loading",
    "degrade",
)


# What the engine's numerics, or plugins by choice of an option, compute with, beside what plugins require.
_LIBRARIES = ("cv2", "jax", "numba", "numpy", "scipy", "skimage")


def source_hash(*used: Plugin, files: Iterable[Path] = ()) -> str:
    """Return a hash of what makes a result: the code of the plugins and of the engine's numerics, and further files.

    Code counts as syntax: comments, docstrings, the module a definition stands in, and which module it is imported
    from change nothing. The versions of the engine and of the libraries it computes with count.

    Of `files`, which may be large, name, size and time of change count; of a folder, those of all files in it, except
    hidden files and `__pycache__`.
    """
    typed_in = [_typed_in(plugin) for plugin in used if _source_of(plugin) is None]
    files_of = tuple(file for plugin in used if (file := _source_of(plugin)))
    source = sorted(_statements((*files_of, *_numerics())))
    libraries = sorted({*_LIBRARIES, *(name for plugin in used for name in plugin.requires)})
    versions = [(name, version_of(distribution_of(name))) for name in libraries]
    stamps = [stamp for place in files for stamp in _stamps(place)]
    made_of = (source, typed_in, sucre_bench.__version__, versions, stamps)
    return hashlib.blake2b(repr(made_of).encode(), digest_size=6).hexdigest()


def _stamps(place: Path) -> Iterator[tuple[str, int, int]]:
    for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
        within = path.relative_to(place)
        if path.is_file() and not any(part.startswith(".") or part == "__pycache__" for part in within.parts):
            state = path.stat()
            yield str(within), state.st_size, state.st_mtime_ns


def _source_of(plugin: Plugin) -> Path | None:
    """A plugin's file, or its folder where it has one of its own; None for one that was typed into a session."""
    try:
        file = Path(inspect.getsourcefile(plugin.cls) or __file__)
    except (OSError, TypeError):
        return None
    shared = (Path(__file__).parent / f"{plugin.kind}s").resolve()
    has_folder = file.parent.resolve() != shared and (file.parent / "__init__.py").exists()
    return file.parent if has_folder else file


def _typed_in(plugin: Plugin) -> list[tuple[str, object]]:
    """What there is of a plugin without a file: the compiled code of what its class defines."""
    codes = ((name, getattr(value, "__code__", None)) for name, value in sorted(vars(plugin.cls).items()))
    return [(name, (code.co_code, repr(code.co_consts), code.co_names)) for name, code in codes if code]


@functools.cache
def _numerics() -> tuple[Path, ...]:
    """The files and folders of the engine's numerics. Raises FileNotFoundError if one of them is not there."""
    engine = Path(__file__).parent
    places = tuple(module if (module := engine / f"{name}.py").is_file() else engine / name for name in _NUMERICS)
    for place in places:
        place.stat()
    return places


@functools.cache
def _statements(places: tuple[Path, ...]) -> frozenset[bytes]:
    """Digests of every top-level statement in the Python files of `places`, and of the tables (.csv) beside them."""
    files = [file for place in places for file in (place.rglob("*") if place.is_dir() else [place])]
    code = (digest for file in files if file.suffix == ".py" for digest in _statements_of(file))
    return frozenset([*code, *(_digest(file.read_bytes()) for file in files if file.suffix == ".csv")])


def _statements_of(file: Path) -> Iterator[bytes]:
    """A digest for each top-level statement of a file but imports from this package; the whole file if it is broken."""
    content = file.read_bytes()
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

    `ast.dump` is not used: what it writes differs between versions of Python.
    """
    if isinstance(node, ast.AST):
        fields = ((name, _syntax(value)) for name, value in ast.iter_fields(node) if name not in ("kind", "ctx"))
        return (type(node).__name__, *((name, value) for name, value in fields if value not in (None, ())))
    if isinstance(node, list):
        return tuple(_syntax(item) for item in node if not (_is_prose(item) or _is_our_import(item)))
    return node if isinstance(node, (str, bytes, int, float, complex, type(None))) else repr(node)


def _is_prose(node: object) -> bool:
    """Whether a statement is a string that nothing uses: a docstring, or the help of a field."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _is_our_import(node: object) -> bool:
    if isinstance(node, ast.ImportFrom):
        return bool(node.level) or (node.module or "").split(".")[0] in ("sucre_bench", "__future__")
    return isinstance(node, ast.Import) and all(name.name.split(".")[0] == "sucre_bench" for name in node.names)


def _is_export_list(node: object) -> bool:
    return isinstance(node, ast.Assign) and any(isinstance(t, ast.Name) and t.id == "__all__" for t in node.targets)
