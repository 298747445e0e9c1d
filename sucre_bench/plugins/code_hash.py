"""One short hash of all that a result depends on: its source code, and the files that options name."""

import functools
import inspect
from collections.abc import Iterable, Iterator
from pathlib import Path

from sucre_bench.machine.provenance import hash_of
from sucre_bench.plugins.plugin import Plugin


def source_hash(*used: Plugin, files: Iterable[Path] = ()) -> str:
    """Return a hash of what makes a result: the code of the plugins and of the engine's numerics, and further files.

    Code counts as syntax: comments, docstrings, the module a definition stands in, and which module it is imported
    from change nothing. The versions of the engine and of the libraries it computes with count.

    Of `files`, which may be large, name, size and time of change count. Of a folder, those of all files in it, except
    hidden files and `__pycache__`.
    """
    sources = [(plugin, _source_of(plugin)) for plugin in used]
    typed_in = []  # what there is of a plugin without a file: the compiled code of what its class defines
    for plugin in (plugin for plugin, source in sources if source is None):
        codes = ((name, getattr(value, "__code__", None)) for name, value in sorted(vars(plugin.cls).items()))
        typed_in.append([(name, (code.co_code, repr(code.co_consts), code.co_names)) for name, code in codes if code])
    places = tuple(source for _, source in sources if source)
    stamps = [stamp for place in files for stamp in _stamps(place)]
    packages = {name for plugin in used for name in (*plugin.requires, *plugin.may_use)}
    return hash_of(places, packages, (typed_in, stamps))


def _stamps(place: Path) -> Iterator[tuple[str, int, int]]:
    for path in sorted(place.rglob("*")) if place.is_dir() else [place]:
        within = path.relative_to(place)
        if path.is_file() and not any(part.startswith(".") or part == "__pycache__" for part in within.parts):
            state = path.stat()
            yield str(within), state.st_size, state.st_mtime_ns


def _source_of(plugin: Plugin) -> Path | None:
    """A plugin's file, or its folder where it has one of its own; None for one that was typed into a session."""
    try:
        source = inspect.getsourcefile(plugin.cls)
    except (OSError, TypeError):
        source = None
    return None if source is None else _file_or_folder(source, plugin.kind)


@functools.cache
def _file_or_folder(source: str, kind: str) -> Path:
    file = Path(source)
    shared = (Path(__file__).parent.parent / f"{kind}s").resolve()
    has_folder = file.parent.resolve() != shared and (file.parent / "__init__.py").exists()
    return file.parent if has_folder else file
