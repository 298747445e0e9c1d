"""Recognises the dataset of a folder by the files that each dataset declares."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from sucre_bench import plugins
from sucre_bench.errors import InputError, MissingFileError
from sucre_bench.jobs.words import quoted
from sucre_bench.machine import progress
from sucre_bench.plugins.plugin import Plugin

_MOST_FOLDERS = 100  # that are looked into for a hint


@dataclass(frozen=True)
class _Fit:
    """A dataset that a folder may be, and the file or folder that says so."""

    plugin: Plugin
    sign: Path

    @property
    def command(self) -> str:
        return f"dataset={self.plugin.name}"


def is_path(name: str) -> bool:
    """Whether a dataset's name is the path of a folder: no plugin's name has a slash or is made of dots."""
    return "/" in name or "\\" in name or name in (".", "..")


def recognised(folder: Path) -> str:
    """Return the name of the dataset that a folder is, and say which in a line.

    Raises InputError when it is no folder, when no dataset fits, with what was looked for, or when several fit.
    """
    place = f"dataset={_typed(folder)}"
    if not folder.is_dir():
        if folder.exists():
            raise InputError("is a file", place, "give its folder")
        raise MissingFileError("no such folder", place, "correct the path")
    fits = _likely(folder)
    root = f"dataset.root={quoted(str(folder))}"
    if len(fits) > 1:
        either = " or ".join(f"{fit.command} (for {fit.sign.relative_to(folder)})" for fit in fits)
        raise InputError("fits several datasets", place, f"give {root} and {either}")
    if not fits:
        raise InputError(_looked_for(), place, _hint(folder))
    (fit,) = fits
    progress.say(f"{folder} is {fit.command} {root}, for it holds {fit.sign.relative_to(folder)}")
    return fit.plugin.name


def _typed(folder: Path) -> str:
    """A folder as the value of `dataset=` that is read as a path."""
    return quoted(str(folder) if is_path(str(folder)) else f"./{folder}")


def _likely(folder: Path) -> list[_Fit]:
    """The datasets that fit; those with poses before single images, which lie in many folders."""
    fits = list(_fits(folder))
    return [fit for fit in fits if "poses" in fit.plugin.has] or fits


def _fits(folder: Path) -> Iterator[_Fit]:
    for plugin in _with_signs():
        found = (path for sign in plugin.signs for path in sorted(folder.glob(sign)))
        if (path := next(found, None)) is not None:
            yield _Fit(plugin, path)


def _with_signs() -> list[Plugin]:
    return [plugin for plugin in plugins.usable("dataset").values() if plugin.signs]


def _looked_for() -> str:
    """What a folder lacks that no dataset fits."""
    of_users = [plugin for plugin in _with_signs() if not plugin.licence]  # those with a licence are published data
    looked_for = ", ".join(f"{plugin.signs[0]} ({plugin.name})" for plugin in of_users)
    return f"holds none of {looked_for}, and no published dataset"


def _hint(folder: Path) -> str:
    """What to write for a folder that no dataset fits: a folder below that one fits, if there is one."""
    below = sorted(path for path in folder.iterdir() if path.is_dir())[:_MOST_FOLDERS]
    inner = next((path for path in below if _likely(path)), None)
    return f"give dataset={_typed(inner)}" if inner else "name the dataset: dataset=NAME dataset.root=DIR"
