"""Where the made scene is stored, and when it is made again: once for each combination of options."""

import hashlib
import json
import shutil
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from sucre_bench.datasets.demo.made_scene import MadeScene
from sucre_bench.datasets.demo.write_made_scene import LAST, write_made_scene
from sucre_bench.errors import OutputError
from sucre_bench.imaging.chart_kinds import KINDS
from sucre_bench.machine.files import user_cache

VERSION = 1  # to be raised whenever equal options make another scene than before


def scene_id(options: Mapping[str, Any]) -> str:
    """Return a hash of the options that decide the scene's files; it names their folder and identifies the scene."""
    content = json.dumps([VERSION, options, repr(KINDS)], sort_keys=True)
    return hashlib.blake2b(content.encode(), digest_size=6).hexdigest()


def scene_folder(root: Path | None, options: Mapping[str, Any]) -> Path:
    """Return the folder of a scene below `root`, or else in the user's cache. It may not be there yet."""
    return (user_cache() / "demo" if root is None else Path(root)) / f"{options['water']}-{scene_id(options)}"


def make_once(folder: Path, make: Callable[[], MadeScene]) -> Path:
    """Return the folder of a made scene, making it where it is not there or not finished.

    The scene is written beside its place, and moved there when it is complete. So a killed process leaves no half
    scene. If two processes write at once, the later one discards its own.
    """
    if (folder / LAST).is_file():
        return folder
    made = make()
    folder.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=f".{folder.name}-", dir=folder.parent, ignore_cleanup_errors=True) as work:
        try:
            write_made_scene(made, Path(work) / "scene")
        except OutputError as fault:
            scene = Path(work) / "scene"
            if not Path(fault.place).is_relative_to(scene):
                raise
            there = folder / Path(fault.place).relative_to(scene)  # the folder of the work is gone when the user looks
            raise type(fault)(fault.fault, there, fault.remedy) from fault
        if folder.exists() and not (folder / LAST).is_file():
            shutil.rmtree(folder)
        try:
            (Path(work) / "scene").replace(folder)
        except OSError:  # a folder that is not empty is never replaced
            if not (folder / LAST).is_file():
                raise
    return folder
