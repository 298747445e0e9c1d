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
    """Raise InputError unless a file's name has an ending of its kind in `ENDINGS`, in small or capital letters."""
    if path.suffix.lower() not in ENDINGS[kind]:
        noun = "picture" if kind == "contact sheet" else kind
        *others, last = ENDINGS[kind]
        endings = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"has no suffix of a {noun}", path, f"end it in {endings}")
