"""A year of Eiffel Tower dives in miniature."""

from __future__ import annotations

from pathlib import Path

from support.registered_dive import write_photographs

NAMES = ("20150412T093000.png", "20150412T093005.png")


def write_year(root: Path, year: str = "2015", names: tuple[str, str] = NAMES) -> Path:
    place = root / year
    write_photographs([place / "images" / name for name in names], place / "sfm", names)
    return root
