"""What a result rests on, as one short hash: the source that made it, and the files that options name."""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

import sucre_bench
from sucre_bench.plugins import Plugin, distribution_of
from sucre_bench.provenance import version_of

__all__ = ["source_hash"]

_ENGINE = (
    "scene.py",
    "restoring.py",
    "colour.py",
    "charts.py",
    "chart_kinds.py",
    "cielab.py",
    "images.py",
    "multiview",
    "steps",
    "loading",
    "degrade",
)


# What the engine's numerics, or plugins by choice of an option, compute with, beside what plugins require.
_LIBRARIES = ("cv2", "jax", "numba", "numpy", "scipy", "skimage")


def source_hash(*used: Plugin, files: Iterable[Path] = ()) -> str:
    """Return a hash of what makes a result: the plugins' files or folders, the engine's numerics, and further files.

    The version of the engine counts, and those of the libraries that it and the plugins compute with.

    Of `files`, which may be large, name, size and time of change count; of a folder, those of all files in it, but for
    hidden ones and what Python compiles.
    """
    engine = Path(__file__).parent
    typed_in = [_typed_in(plugin) for plugin in used if _source_of(plugin) is None]
    files_of = [file for plugin in used if (file := _source_of(plugin))]
    source = _hash_files((*files_of, *(engine / name for name in _ENGINE)))
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
def _hash_files(places: tuple[Path, ...]) -> str:
    digest = hashlib.blake2b(digest_size=6)
    for place in places:
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            digest.update(path.read_bytes())
    return digest.hexdigest()
