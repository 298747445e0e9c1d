"""Where the repository lies, the toy plugins, and the data that some tests read where they are at hand."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOYS = Path(__file__).with_name("toy_plugins.py")


def _data() -> Path:
    """The folder shared/data in the checkout, beside it, or beside a folder above it."""
    beside = [folder / "shared" / "data" for folder in (ROOT, *ROOT.parents)]
    return next((folder for folder in beside if folder.is_dir()), beside[1])


DATA = _data()
