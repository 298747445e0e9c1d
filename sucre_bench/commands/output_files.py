"""The check that every output file of a command passes before any work: what is there must be safe to replace."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from sucre_bench.errors import InputError, NotAFileError
from sucre_bench.machine.files import is_file, regular

ENDINGS: Mapping[str, tuple[str, ...]] = {
    "bundle": (".zip",),
    "contact sheet": (".png", ".jpg", ".jpeg"),
    "line-up": (".yaml", ".yml"),
    "numbers": (".json",),
    "page": (".html", ".htm"),
    "picture": (".png",),
    "surface": (".ply", ".glb"),
    "table": (".csv",),
    "video": (".mp4", ".webm"),
}


def check_output(path: Path, kind: str, inputs: Iterable[Path] = ()) -> None:
    """Raise InputError if a command must not write to a path.

    kind: a key of `ENDINGS`, one of which the name must have, in small or capital letters; inputs: the files that the
    command reads. Also refused: a path where something is that is no regular file, and a part of a results folder.
    """
    from sucre_bench.results.layout import is_own_part

    if path.is_dir():
        example = path / f"{kind.split()[-1]}{ENDINGS[kind][0]}"
        raise InputError("is a folder", path, f"give a file, for example {example}")
    if path.suffix.lower() not in ENDINGS[kind]:
        noun = "picture" if kind == "contact sheet" else kind
        *others, last = ENDINGS[kind]
        endings = f"{', '.join(others)} or {last}" if others else last
        raise InputError(f"has no suffix of a {noun}", path, f"end it in {endings}")
    try:
        regular(path)
    except FileNotFoundError:
        return
    except NotAFileError as fault:
        raise InputError(fault.fault, path, "give another file") from fault
    if is_own_part(path):
        raise InputError("is a part of a results folder", path, "give a file elsewhere")
    if any(is_file(one) and path.samefile(one) for one in inputs):
        raise InputError("is an input of this command", path, "give another file")
