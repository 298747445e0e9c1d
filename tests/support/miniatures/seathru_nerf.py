"""A reef of the SeaThru-NeRF data in miniature."""

from __future__ import annotations

from pathlib import Path

from support.colmap_folder import to_binary
from support.registered_dive import write_photographs

NAMES = ("MTN_1.png", "MTN_2.png")


def write_reef(place: Path, images: str = "images_wb", sparse: str = "sparse/0", units: float = 1.0) -> Path:
    write_photographs([place / images / name for name in NAMES], place / sparse, NAMES, units)
    to_binary(place / sparse)
    return place
