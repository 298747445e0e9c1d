"""Checks what a plugin requires: installed packages, and depth, poses and so on of the scene."""

import importlib
import importlib.util
from typing import Literal

from sucre_bench.errors import Lack
from sucre_bench.machine.provenance import distribution_of
from sucre_bench.plugins.plugin import Plugin


def missing_packages(plugin: Plugin) -> str:
    """Return the line that installs what a plugin requires and this machine lacks; empty when nothing is missing."""
    absent = [name for name in plugin.requires if not _is_installed(name)]
    return f"pip install {' '.join(map(distribution_of, absent))}" if absent else ""


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # of a package that it is in
        return False


def missing_needs(plugin: Plugin, has: frozenset[str], of: Literal["scene", "view"] = "scene") -> str:
    """Return what a plugin needs and a scene or view does not have, as the text of a `Lack`; empty if it has all."""
    absent = plugin.needs - has
    return str(Lack(tuple(sorted(absent)), tuple(sorted(has)), of)) if absent else ""
