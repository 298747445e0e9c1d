"""Runs any program or container as a method: in another language or environment, with a licence of its own.

No shell runs the command. It is split into words as a shell would do, and then the placeholders are filled, so no file
name can become a command.
"""

from __future__ import annotations

import functools
import io
import os
import shlex
import shutil
import tempfile
import weakref
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from errno import ENOSPC
from math import nan
from pathlib import Path, PurePosixPath
from typing import IO, Any, Literal

import numpy as np

from sucre_bench import NotApplicableError, Restoration, Scene, SucreBenchError, method
from sucre_bench.arrays import Array
from sucre_bench.errors import DiskFullError, InputError, MissingFileError
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import write_png
from sucre_bench.machine.files import expanded, temporary_folder, write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.methods.doors.precomputed import (
    SUFFIXES,
    FileEncoding,
    Holes,
    ImageFolder,
    Reading,
    check_pattern,
    encoding_of,
    inside,
    placeholders,
    water_beside,
)
from sucre_bench.methods.doors.process import Ended, run_program
from sucre_bench.scene import View

# Names a full disk of temporary files, also where a program that failed was what found it full.

_REMEDY = "free some space there, or name a folder on another disk in TMPDIR"
_IMAGE_BYTES = 3  # of a pixel, in 8 bits without compression


@contextmanager
def full_disk_named() -> Iterator[None]:
    """Inside, the error of a full disk names the folder of temporary files, and how to have another one."""
    try:
        yield
    except DiskFullError as fault:
        raise DiskFullError(f"{tempfile.gettempdir()}: the disk is full; {_REMEDY}") from fault


def want_of_room(place: Path, view: View, said: str) -> str:
    """Return the remedy if a program failed on a full disk, else "".

    place: the program's folder; said: what it printed. The disk counts as full if the program says so, or if a
    restored image might not fit.
    """
    free = shutil.disk_usage(place).free
    is_full = os.strerror(ENOSPC) in said or free < _IMAGE_BYTES * view.rgb[..., 0].size
    return f"{place.parent} has {free / 1e6:.1f} MB free; {_REMEDY}" if is_full else ""


# Writes views to files for a program: images as PNG, depth or distance as 16-bit millimetres or float metres.

DepthFormat = Literal["png", "npy", "tif"]

# What 16 bits of millimetres can say.
_FARTHEST_PNG_M = 65.535


def names_for(views: Sequence[View]) -> dict[str, str]:
    """Return what each view's files are called, by the view's name: its path as PNG, a.jpg.png where a.png is taken.

    Raises InputError for a name that leads out of a folder.
    """
    stems = Counter(inside(view.name).with_suffix("") for view in views)
    return {
        view.name: str(path.with_suffix(".png")) if stems[path.with_suffix("")] == 1 else f"{path}.png"
        for view in views
        for path in [PurePosixPath(view.name)]
    }


@dataclass(frozen=True)
class Handover:
    """What a program is given, in folders of one place: input, depth, distance; and output, for it to fill.

    planes: of "input", "depth" and "distance", those that the program asks for; bits, encoding: of the images.
    """

    place: Path
    planes: frozenset[str]
    bits: int
    encoding: FileEncoding
    depth_format: DepthFormat

    def give(self, view: View, name: str) -> dict[str, Path]:
        """Write a view's files under a name; return where each plane is, and where its output is to be.

        Raises InputError where a depth does not fit its format.
        """
        paths = {plane: self._path(plane, name) for plane in (*self.planes, "output")}
        for path in paths.values():
            path.parent.mkdir(parents=True, exist_ok=True)
        if "input" in self.planes:
            image = converted(view.rgb, view.encoding, encoding_of(self.encoding, view))
            levels = 2**self.bits - 1
            rounded = (image.clip(0, 1) * levels + 0.5).astype(np.uint8 if self.bits == 8 else np.uint16)
            write_png(paths["input"], rounded[..., ::-1])
        if "depth" in self.planes:
            self._write_depth(paths["depth"], view.depth, view.name)
        if "distance" in self.planes:
            self._write_depth(paths["distance"], view.distance, view.name)
        return paths

    def _path(self, plane: str, name: str) -> Path:
        path = self.place / plane / name
        return path.with_suffix(f".{self.depth_format}") if plane in ("depth", "distance") else path

    def _write_depth(self, path: Path, depth: Array, name: str) -> None:
        import tifffile

        if self.depth_format == "npy":
            _written(path, np.save, depth)
        elif self.depth_format == "tif":
            _written(path, tifffile.imwrite, depth)
        elif depth.max(initial=0) > _FARTHEST_PNG_M:
            fault = f"depth up to {depth.max():.1f} m does not fit into 16-bit millimetres"
            raise InputError(f"{name}: {fault}; give command.depth_format=npy or command.depth_format=tif")
        else:
            write_png(path, (depth * 1000 + 0.5).astype(np.uint16))


def _written(path: Path, write: Callable[[IO[bytes], Array], object], depth: Array) -> None:
    content = io.BytesIO()  # because NumPy does not say why it could not write a file
    write(content, depth)
    write_atomically(path, content.getvalue())


_PER_SCENE = ("input", "depth", "distance", "output")
_PER_VIEW = (*_PER_SCENE, "name", "width", "height")


@method(reads=("rests_on",))
@dataclass(frozen=True)
class Command:
    """Run a program that reads an image and writes one, once for each view or once for all views of a scene.

    The program gets no shell and no input, but this process's environment and working folder. If it fails, the view
    fails with the exit code and the last line that it printed. Beside its image a.png it may write the water to a.json:
    B, and beta and gamma if known, three numbers each, and `encoding` if it explains intensities encoded otherwise.
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

    depth_format: DepthFormat = "png"
    """Format of depth and distance, 0 where unknown: png, 16-bit millimetres; npy and tif, 32-bit float metres."""

    output_suffix: str = ".png"
    """Suffix of {output} with per=view; another suffix that the program writes is found too."""

    pattern: str = "{stem}"
    """Name of the output, if the program does not write {output} (per=scene: the input's name). Example:
    '{stem}_out'."""

    encoding: FileEncoding = "view"
    """Encoding of the program's input and output: gamma (sRGB), linear, or view (that of the view's image)."""

    holes: Holes = "alpha"
    """Which pixels have no colour. alpha: fully transparent pixels; black: also exactly black pixels; none: no pixel.
    NaN and infinity are always holes."""

    resize: bool = False
    """Resize an output of another size to the view, by area or linearly; false: another size is an error."""

    rests_on: Path | None = None
    """File or folder of the program or its weights. If it changes, views are restored again."""

    def __post_init__(self) -> None:
        words = self._words
        if not words or shutil.which(words[0]) is None:
            what = f"'{words[0]}' is not found or not executable" if words else "is empty"
            raise InputError(f"command.run: {what}; give a program that is installed, or its path")
        used = placeholders(self.run, _PER_VIEW, "command.run")
        if self.per == "scene" and used - set(_PER_SCENE):
            raise InputError(
                f"command.run: {{{min(used - set(_PER_SCENE))}}} is of one view; use it with command.per=view"
            )
        if "output" not in used:
            raise InputError("command.run: without {output}; put it where the program is told what to write")
        check_pattern(self.pattern, "command.pattern")
        if self.output_suffix not in SUFFIXES:
            raise InputError(f"command.output_suffix: '{self.output_suffix}' is not one of {', '.join(SUFFIXES)}")
        if self.bits not in (8, 16):
            raise InputError(f"command.bits: {self.bits} is neither 8 nor 16")
        if self.timeout is not None and not self.timeout > 0:
            raise InputError(f"command.timeout: {self.timeout} must be positive; null sets no limit")
        if self.rests_on is not None and not self.rests_on.exists():
            raise MissingFileError("no such file or folder", self.rests_on, "mend command.rests_on")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the program's result for the view, in the view's encoding.

        info: "seconds" and "peak_mb" of its process (per=scene: a view's share of the time), "said", the end of what it
        printed. Raises NotApplicableError when the view lacks the depth or camera that the command uses, InputError
        when the program fails or leaves no usable image.
        """
        if lack := self._lack(view):
            raise NotApplicableError(f"{view.name}: {lack}, which the command needs")
        if self.per == "scene":
            batch = _run_batch(scene, self)
            if isinstance(batch, SucreBenchError):
                raise batch
            return self._read(batch, view)
        with full_disk_named(), temporary_folder() as place:
            work = self._handover(place)
            paths = work.give(view, "view.png")
            paths["output"] = paths["output"].with_suffix(self.output_suffix)
            height, width = view.rgb.shape[:2]
            ended = self._run({**paths, "name": view.name, "width": width, "height": height})
            return self._read(_Work(place, self.pattern, {view.name: "view.png"}, {}, ended), view)

    @property
    def _words(self) -> list[str]:
        try:
            return [str(expanded(w)) if w.startswith("~/") else w for w in shlex.split(self.run)]
        except ValueError as fault:
            raise InputError(f"command.run: {fault}; close what was opened, or write \\' for the character") from fault

    @property
    def _program(self) -> str:
        return Path(self._words[0]).name

    @property
    def _planes(self) -> frozenset[str]:
        return placeholders(self.run, _PER_VIEW, "command.run") & {"input", "depth", "distance"}

    def _lack(self, view: View) -> str:
        """What the command asks for and a view has not."""
        if self._planes & {"depth", "distance"} and not view.has_depth:
            return "has no depth map"
        return "has no camera" if "distance" in self._planes and view.camera is None else ""

    def _handover(self, place: Path) -> Handover:
        return Handover(place, self._planes, self.bits, self.encoding, self.depth_format)

    def _run(self, values: Mapping[str, Any]) -> Ended:
        return run_program([word.format_map(values) for word in self._words], self.timeout)

    def _read(self, work: _Work, view: View) -> Restoration:
        """The image that belongs to a view among those a program wrote."""
        if view.name in work.refused:
            raise work.refused[view.name]
        ended, who = work.ended, f"{self._program}: {view.name}"
        about = f"{ended.fault}, saying: {ended.last_words}" if ended.fault and ended.last_words else ended.fault
        printed = _Printed(ended.said) if ended.said else None
        if ended.fault and self.per == "view":
            remedy = want_of_room(work.place, view, ended.said) or "mend the program or its options"
            raise InputError(f"{who}: {about}; {remedy}") from printed
        try:
            path = work.images.find(work.names[view.name], [*work.names.values()])
            image, done = Reading(self.encoding, self.holes, self.resize).image(path, view)
            water = water_beside(path, self.encoding, view)
        except NotApplicableError:
            fault = f"{about or 'ended well'}, but wrote no image"
            remedy = want_of_room(work.place, view, ended.said) or "the program is to write to {output}"
            raise InputError(f"{who}: {fault}; {remedy}") from printed
        except InputError as fault:
            raise InputError(f"{who}: {str(fault).replace(f'{work.place}/', '')}") from (printed or fault)
        info = {**done, "seconds": ended.seconds / len(work.names), "peak_mb": ended.peak_mb, "device": "unknown"}
        told = {"said": ended.said[-2000:], "fault": about}
        return Restoration(image, water, info=info | {key: text for key, text in told.items() if text})


class _Printed(Exception):  # noqa: N818, it is no error: it is kept with the traceback of one
    """What a program printed."""


@dataclass(frozen=True, eq=False)
class _Work:
    """What a program left: place/output holds its images, called as the pattern says.

    names: what each view that it was given is called there, by the view's name; refused: why others were not given.
    """

    place: Path
    pattern: str
    names: Mapping[str, str]
    refused: Mapping[str, Exception]
    ended: Ended

    @functools.cached_property
    def images(self) -> ImageFolder:
        return ImageFolder(self.place / "output", self.pattern)


@functools.lru_cache(maxsize=2)  # every view of the scene asks for it
def _run_batch(scene: Scene, command: Command) -> _Work | SucreBenchError:
    """Run the program on all views of a scene that have what it asks for; or why that failed, which is kept too.

    Its images stay until the process ends or another batch needs the room.
    """
    place = Path(tempfile.mkdtemp(prefix="sucre-bench-"))
    try:
        with full_disk_named():
            work = _hand_all(scene, command, place)
        weakref.finalize(work, shutil.rmtree, place, ignore_errors=True)
        return work
    except SucreBenchError as fault:
        shutil.rmtree(place, ignore_errors=True)
        return fault
    except BaseException:
        shutil.rmtree(place, ignore_errors=True)
        raise


def _hand_all(scene: Scene, command: Command, place: Path) -> _Work:
    handover, names = command._handover(place), names_for(scene.views)
    given: dict[str, str] = {}
    refused: dict[str, Exception] = {}
    for view in track(scene.views, f"writing images for {command._program}"):
        try:
            if not command._lack(view):
                handover.give(view, names[view.name])
                given[view.name] = names[view.name]
        except DiskFullError:
            raise
        except Exception as fault:  # of this view; the others go on
            refused[view.name] = fault
    if not given:
        return _Work(place, command.pattern, given, refused, Ended("", 0, nan, ""))
    ended = command._run({plane: place / plane for plane in _PER_SCENE})
    for plane in command._planes:
        shutil.rmtree(place / plane, ignore_errors=True)
    return _Work(place, command.pattern, given, refused, ended)
