"""How the names of output files may end, for every command. Others are refused before any work."""

from collections.abc import Mapping
from pathlib import Path

from sucre_bench.errors import InputError

ENDINGS: Mapping[str, tuple[str, ...]] = {
    "bundle": (".zip",),
    "contact sheet": (".png", ".jpg", ".jpeg"),
    "picture": (".png",),
    "surface": (".ply", ".glb"),
    "video": (".mp4", ".webm"),
}


def check_ending(path: Path, kind: str) -> None:
    """Raise InputError unless a file's name ends as ENDINGS has it for its kind; capital letters are the same."""
    if path.suffix.lower() not in ENDINGS[kind]:
        raise InputError(f"has no suffix of a {kind}", path, f"end it in {' or '.join(ENDINGS[kind])}")
