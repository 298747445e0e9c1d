"""Registries of plugins: what a test loads into its own, no other test finds."""

from __future__ import annotations

import functools
from pathlib import Path

from sucre_bench.plugins import KINDS, Registry


def registry(*files: Path) -> Registry:
    """Return a registry of its own with the built-in plugins and those of some files."""
    return _discovered(*files).copy()


@functools.cache
def _discovered(*files: Path) -> Registry:
    found = Registry()
    for file in files:
        found.load_file(file)
    for kind in KINDS:
        found.discover(kind)
    return found
