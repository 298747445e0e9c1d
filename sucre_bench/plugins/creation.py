"""Makes a plugin of its options, and finds the files and folders that they name and results rest on."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError
from sucre_bench.machine.files import expanded, fault_of
from sucre_bench.plugins import registry
from sucre_bench.plugins.options import Option, check_options, options_of, typed

if TYPE_CHECKING:
    from sucre_bench.plugins.plugin import Plugin


def create(plugin: Plugin, values: Mapping[str, Any], out: Path | None = None) -> Any:
    """Make the plugin with these options. Raises what `check_options` and the plugin's own __post_init__ raise.

    A path may be given as text, a tuple as a list. An option that the plugin `reads` must lead to a file or folder.
    out: the folder of results of a command that is about to run; what is to lie in it may be made by an earlier job.
    """
    check_options(plugin, values)
    types = {o.name: o.type for o in options_of(plugin.cls)}
    made = plugin.cls(**{name: typed(types[name], value) for name, value in values.items()})
    _check_paths(plugin, values, out)
    return made


def given_to_read(plugin: Plugin, values: Mapping[str, Any]) -> Iterator[tuple[Option, str | Path]]:
    """Yield the options that name files to read, with their paths. Words with a meaning of their own are left out."""
    for option in options_of(plugin.cls):
        value = values.get(option.name, "")
        if option.name in plugin.reads and isinstance(value, (str, Path)) and value not in ("", *option.choices):
            yield option, value


def read_files(plugin: Plugin, values: Mapping[str, Any]) -> Iterator[tuple[Option, Path]]:
    """Yield the paths that options of these values name; the name of another method is none."""
    given = list(given_to_read(plugin, values))
    methods = registry.discover("method") if given else {}
    yield from ((option, expanded(value)) for option, value in given if value not in methods)


def _check_paths(plugin: Plugin, values: Mapping[str, Any], out: Path | None) -> None:
    """Raise InputError for the first option that names neither a regular file nor a folder. No file is opened."""
    for option, path in read_files(plugin, values):
        if out is not None and _may_be_made_in(out, path):
            continue
        if (fault := fault_of(path)) and not path.is_dir():
            words = f", or one of {', '.join(option.choices)}" * bool(option.choices)
            raise InputError(f"{path}: {fault}; give a path that exists in {plugin.kind}.{option.name}{words}")


def _may_be_made_in(out: Path, path: Path) -> bool:
    """Whether nothing is there yet, and a path leads into the folder."""
    return not os.path.lexists(path) and Path(os.path.abspath(path)).is_relative_to(os.path.abspath(out))  # noqa: PTH100
