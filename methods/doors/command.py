"""Runs any program or container as a method: in another language or environment, with a licence of its own.

No shell runs the command. It is split into words as a shell would do, and then the placeholders are filled, so no file
name can become a command.
"""

from __future__ import annotations

import functools
import io
import os
import re
import shlex
import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from errno import ENOSPC
from itertools import pairwise
from math import nan
from pathlib import Path, PurePosixPath
from typing import Any, Literal

import numpy as np

from sucre_bench import (
    InputError,
    NotApplicableError,
    Restoration,
    Scene,
    SucreBenchError,
    View,
    method,
    track,
)
from sucre_bench.arrays import Array
from sucre_bench.errors import DiskFullError, MissingFileError
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import write_png
from sucre_bench.machine.files import expanded, temporary_folder, write_atomically
from sucre_bench.methods.doors.precomputed import (
    SUFFIXES,
    ImageFolder,
    RestoredElsewhere,
    check_pattern,
    inside,
    placeholders,
)
from sucre_bench.methods.doors.process import Ended, Environment, Printed, run_program
from sucre_bench.plugins.options import check_ranges

_PER_SCENE = ("input", "depth", "distance", "output")
_PER_VIEW = (*_PER_SCENE, "name", "width", "height")

_FARTHEST_PNG_M = 65.535  # what 16 bits of millimetres can say
_PLAIN = re.compile("[\\w ./@%+=:,-]*")  # a name that no shell or interpreter obeys
_TAKES_CODE = re.compile(r"-\w*[ce]|--eval")  # the next word is code: sh -c, perl -e
# what may stand beside {name} in a word: an option, a part of a path
_NO_CODE = re.compile("[\\w./@%+=:,-]*")
_IMAGE_BYTES = 3  # of a pixel, in 8 bits without compression


@method(reads=("rests_on",))
@dataclass(frozen=True)
class Command(RestoredElsewhere):
    """Run a program that reads an image and writes one, once for each view or once for all views of a scene.

    The program gets no shell and no input, but this process's environment and working folder. If it fails, the view
    fails with the exit code and the last line that it printed. Beside its image a.png it may write the water to a.json.
    That is B, and beta and gamma if known, three numbers each, and `encoding` if it explains intensities encoded
    otherwise.
    """

    run: str
    """The command: 'python3 restore.py {input} {output}'. Placeholders: {input}, {output}, {depth} (along the optical
    axis), {distance} (from the camera), and with per=view {name}, {width}, {height}; {{ and }} are braces."""

    per: Literal["view", "scene"] = "view"
    """view: one process for each image, placeholders are files; scene: one process for all images of the scene,
    placeholders are folders with files of the same names."""

    timeout: float | None = 600.0
    """Seconds after which a process is stopped; null sets no limit."""

    bits: int = 8
    """Bits a channel of the input, a PNG: 8 or 16."""

    depth_format: Literal["png", "npy", "tif"] = "png"
    """Format of depth and distance, 0 where unknown: png, 16-bit millimetres; npy and tif, 32-bit float metres."""

    output_suffix: str = ".png"
    """Suffix of {output} with per=view; another suffix that the program writes is found too."""

    pattern: str = "{stem}"
    """Name of the output, if the program does not write {output} (per=scene: the input's name). Example:
    '{stem}_out'."""

    rests_on: Path | None = None
    """File or folder of the program or its weights. If it changes, views are restored again. A container sees it."""

    env: str = ""
    """Environment of the program: uv:FILE (requirements.txt, pylock.toml or uv.lock), conda:NAME, or
    docker:IMAGE@sha256:DIGEST; empty: this one. Rows have it with the digest of the file or of conda's list of
    packages. If you give such a digest, @sha256:..., it is checked."""

    @staticmethod
    def pinned(options: Mapping[str, Any]) -> dict[str, Any]:
        """Return options with the digest of their environment: what rows and configurations record."""
        environment = Environment.of(options["env"]) if options.get("env") else None
        return {**options, **({"env": str(environment.pinned)} if environment else {})}

    @staticmethod
    def moved(options: Mapping[str, Any], seen: Callable[[str], str]) -> dict[str, str]:
        """Return the option whose environment is a file or folder, with its path as `seen` has it."""
        tool, _, name = str(options.get("env") or "").partition(":")
        if not name or not (tool == "uv" or (tool == "conda" and "/" in name)):
            return {}
        path = seen(name)
        bare = tool == "conda" and "/" not in path  # which conda takes for a name
        return {"env": f"{tool}:{'./' * bare}{path}"}

    def __post_init__(self) -> None:
        words = self._words
        if self._environment:
            self._environment.check()
        if not words or (not self._environment and shutil.which(words[0]) is None):
            what = f"'{words[0]}' is not found or not executable" if words else "is empty"
            raise InputError(
                f"method.run: {what}; give a program that is installed, or its path"
            )
        used = placeholders(self.run, _PER_VIEW, "method.run")
        if self.per == "scene" and used - set(_PER_SCENE):
            raise InputError(
                f"method.run: {{{min(used - set(_PER_SCENE))}}} is of one view; use it with method.per=view"
            )
        if "output" not in used:
            raise InputError(
                "method.run: without {output}; put it where the program is told what to write"
            )
        check_pattern(self.pattern, "method.pattern")
        if self.output_suffix not in SUFFIXES:
            raise InputError(
                f"method.output_suffix: '{self.output_suffix}' is not one of {', '.join(SUFFIXES)}"
            )
        if self.bits not in (8, 16):
            raise InputError(f"method.bits: {self.bits} is neither 8 nor 16")
        check_ranges(self, timeout="(0, inf)")
        if self.rests_on is not None and not self.rests_on.exists():
            raise MissingFileError(
                "no such file or folder", self.rests_on, "mend method.rests_on"
            )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the program's result for the view, in the view's encoding.

        info: "seconds" and "peak_mb" of its process (per=scene: a view's share of the time), "said", the end of what it
        printed. Raises NotApplicableError when the view lacks the depth or camera that the command uses, InputError
        when the program fails or leaves no usable image.
        """
        if lack := self._lack(view):
            raise NotApplicableError(f"{view.name}: {lack}, which the command needs")
        if self.per == "view":
            with temporary_folder() as place:
                return self._read(self._run(place, [view]), view)
        batch = _run_batch(scene, self)
        if isinstance(batch, SucreBenchError):
            raise batch
        return self._read(batch, view)

    @property
    def sees_whole_scene(self) -> bool:
        """Whether one process of the program restores all views of a scene."""
        return self.per == "scene"

    def warm_up(self) -> None:
        """Make the environment, so that the first view's time is not that of downloads."""
        if self._environment:
            self._environment.make()

    @functools.cached_property
    def _environment(self) -> Environment | None:
        return Environment.of(self.env) if self.env else None

    @property
    def _words(self) -> list[str]:
        try:
            return [
                str(expanded(w)) if w.startswith("~/") else w for w in shlex.split(self.run)
            ]
        except ValueError as fault:
            raise InputError(
                f"method.run: {fault}; close what was opened, or write \\' for the character"
            ) from fault

    @property
    def _planes(self) -> frozenset[str]:
        """Which of input, depth and distance the program asks for."""
        return placeholders(self.run, _PER_VIEW, "method.run") & {"input", "depth", "distance"}

    def _lack(self, view: View) -> str:
        """What the command asks for and a view has not."""
        if self._planes & {"depth", "distance"} and not view.has_depth:
            return "has no depth map"
        return "has no camera" if "distance" in self._planes and view.camera is None else ""

    def _refuse_code(self, name: str) -> None:
        """Raise InputError if a view's name has signs that a program or a shell could take for code."""
        named = (
            (before, word)
            for before, word in pairwise(("", *self._words))
            if "name" in placeholders(word, _PER_VIEW, "method.run")
        )
        codes = (
            word
            for before, word in named
            if _TAKES_CODE.fullmatch(before)
            or not _NO_CODE.fullmatch(re.sub(r"\{\w+\}", "", word))
        )
        if not _PLAIN.fullmatch(name) and (word := next(codes, "")):
            remedy = "rename the view, or write {name} as a word of its own"
            raise InputError(f"has signs that '{word}' may obey", name, remedy)

    def _run(self, place: Path, views: Sequence[View]) -> _Work:
        """Write the files of views into a folder and run the program on them. A view that cannot be written is refused.

        Files are called as their views, a.jpg.png where a.png is taken; with per=view, view.png.
        """
        stems = Counter(PurePosixPath(view.name).with_suffix("") for view in views)
        work = _Work(
            place, ImageFolder(place / "output", self.pattern), {}, {}, Ended("", 0, nan, "")
        )
        values: dict[str, Any] = {plane: place / plane for plane in _PER_SCENE}
        for view in (
            track(views, f"writing images for {Path(self._words[0]).name}")
            if len(views) > 1
            else views
        ):
            if self._lack(view):
                continue
            try:
                if self.per == "view":
                    name = "view.png"
                    height, width = view.rgb.shape[:2]
                    self._refuse_code(view.name)
                    output = (place / "output" / name).with_suffix(self.output_suffix)
                    values = {
                        "output": output,
                        "name": view.name,
                        "width": width,
                        "height": height,
                    }
                else:
                    path = inside(view.name)
                    name = (
                        f"{path}.png"
                        if stems[path.with_suffix("")] > 1
                        else str(path.with_suffix(".png"))
                    )
                # Depth first: where it does not fit, the program gets no image without one.
                files = {
                    plane: self._write(place / plane / name, plane, view)
                    for plane in sorted(self._planes)
                }
                (place / "output" / name).parent.mkdir(parents=True, exist_ok=True)
            except DiskFullError:
                raise
            except Exception as fault:  # of this view; the others go on
                work.refused[view.name] = fault
                continue
            values |= files if self.per == "view" else {}
            work.names[view.name] = name
        if work.names:
            words = [word.format_map(values) for word in self._words]
            if self._environment:
                words = self._environment.command(
                    words, [place], [self.rests_on] if self.rests_on else []
                )
            work.ended = run_program(words, self.timeout)
        for plane in self._planes:
            shutil.rmtree(place / plane, ignore_errors=True)
        return work

    def _write(self, path: Path, plane: str, view: View) -> Path:
        """Write the input, depth or distance of a view; return where. InputError where a depth does not fit."""
        if plane == "input":
            image = converted(view.rgb, view.encoding, self.encoding_of(view))
            rounded = image.clip(0, 1) * (2**self.bits - 1) + 0.5
            write_png(
                path, rounded[..., ::-1].astype(np.uint8 if self.bits == 8 else np.uint16)
            )
            return path
        metres: Array = getattr(view, plane)
        if self.depth_format == "png":
            if (farthest := metres.max(initial=0)) > _FARTHEST_PNG_M:
                fault = f"depth up to {farthest:.1f} m does not fit into 16-bit millimetres"
                raise InputError(
                    f"{view.name}: {fault}; give method.depth_format=npy or method.depth_format=tif"
                )
            write_png(path, (metres * 1000 + 0.5).astype(np.uint16))
            return path
        import tifffile

        content, path = io.BytesIO(), path.with_suffix(f".{self.depth_format}")
        (np.save if self.depth_format == "npy" else tifffile.imwrite)(content, metres)
        write_atomically(path, content.getvalue())
        return path

    def _read(self, work: _Work, view: View) -> Restoration:
        """The image that belongs to a view among those a program wrote."""
        if view.name in work.refused:
            raise work.refused[view.name]
        ended = work.ended
        who = f"{Path(self._words[0]).name}: {view.name}"
        about = (
            f"{ended.fault}, saying: {ended.last_words}"
            if ended.fault and ended.last_words
            else ended.fault
        )
        printed = Printed(ended.said) if ended.said else None
        try:
            if about and self.per == "view":
                raise NotApplicableError(about)
            path = work.images.find(work.names[view.name], [*work.names.values()])
            restored = self.read(path, view)
        except NotApplicableError:
            remedy = "mend the program or its options: it is to write to {output}"
            free = shutil.disk_usage(work.place).free
            if os.strerror(ENOSPC) in ended.said or free < _IMAGE_BYTES * view.rgb[..., 0].size:
                room = f"{work.place.parent} has {free / 1e6:.1f} MB free"
                remedy = (
                    f"{room}; free some space there, or name a folder on another disk in TMPDIR"
                )
            raise InputError(
                f"{who}: {about or 'ended well, but wrote no image'}; {remedy}"
            ) from printed
        except InputError as fault:
            raise InputError(f"{who}: {str(fault).replace(f'{work.place}/', '')}") from (
                printed or fault
            )
        told = {"said": ended.said[-2000:], "fault": about}
        told["environment"] = str(self._environment.pinned) if self._environment else ""
        info = {
            "seconds": ended.seconds / len(work.names),
            "peak_mb": ended.peak_mb,
            "device": "unknown",
        }
        return replace(
            restored,
            info=restored.info | info | {key: text for key, text in told.items() if text},
        )


@dataclass(eq=False)
class _Work:
    """What a program left in place/output."""

    place: Path
    images: ImageFolder

    names: dict[str, str]
    """The name of its file for each view, by the view's name."""

    refused: dict[str, Exception]
    """Why it was not given other views, by the view's name."""

    ended: Ended


@functools.lru_cache(maxsize=2)  # every view of the scene asks for it
def _run_batch(scene: Scene, command: Command) -> _Work | SucreBenchError:
    """Run the program on all views of a scene that have what it asks for; or why that failed, which is kept too.

    Its images stay until the process ends or another batch needs the room.
    """
    place = Path(tempfile.mkdtemp(prefix="sucre-bench-"))
    try:
        work = command._run(place, scene.views)
    except BaseException as fault:
        shutil.rmtree(place, ignore_errors=True)
        if isinstance(fault, SucreBenchError):
            return fault
        raise
    weakref.finalize(work, shutil.rmtree, place, ignore_errors=True)
    return work
