"""Writes views to files for a program: images as PNG, depth or distance as 16-bit millimetres or float metres."""

import io
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import write_png
from sucre_bench.machine.files import write_atomically
from sucre_bench.methods.doors.pattern import inside
from sucre_bench.methods.doors.read_picture import FileEncoding, encoding_of
from sucre_bench.scene import View

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
