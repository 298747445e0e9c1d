"""What a plugin requires: packages of this machine, and what a scene must offer."""

from __future__ import annotations

import importlib
import importlib.util

from sucre_bench.machine.provenance import distribution_of
from sucre_bench.plugins.plugin import Plugin

__all__ = ["missing_needs", "missing_packages"]


def missing_packages(plugin: Plugin) -> str:
    """Return the line that installs what a plugin requires and this machine lacks; empty when nothing is missing."""
    absent = [name for name in plugin.requires if not _is_installed(name)]
    return f"pip install {' '.join(map(distribution_of, absent))}" if absent else ""


def _is_installed(package: str) -> bool:
    try:
        return importlib.util.find_spec(package) is not None
    except ModuleNotFoundError:  # of a package that it is in
        return False


def missing_needs(plugin: Plugin, has: frozenset[str]) -> str:
    """Return what a plugin needs and a scene does not offer, in words; empty when nothing is missing."""
    absent = sorted(plugin.needs - has)
    return f"needs {' and '.join(absent)}, the scene has {', '.join(sorted(has)) or 'only images'}" if absent else ""
