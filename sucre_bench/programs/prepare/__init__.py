"""Makes a scene of a folder of photos, on the CPU.

In: photos and one known length; poses, a mesh or depth maps of other programs. Out: undistorted images, a COLMAP model,
depth maps, a page and prepare.json.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from sucre_bench.errors import InputError, MissingFileError

Matching = Literal["auto", "exhaustive", "sequential"]
CameraModel = Literal[
    "SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "OPENCV_FISHEYE"
]
Cameras = Literal["single", "folder", "image"]
Surface = Literal["auto", "dense", "sparse"]


@dataclass(frozen=True, slots=True)
class Options:
    """The options of `prepare`.

    Raises InputError for a focal length that no camera has, for options that exclude each other, and for a path that
    does not exist.
    """

    masks: Path | None = None
    """Folder of masks, white where a photo is used."""

    matching: Matching = "auto"
    """Which pairs of photos are matched, by the number of photos if "auto"."""

    camera: CameraModel = "SIMPLE_RADIAL"
    """COLMAP's camera model."""

    cameras: Cameras = "single"
    """Which photos share a camera."""

    focal: float | None = None
    """Focal length that is held, in longer sides of a photo; None: it is found."""

    max_size: int = 0
    """Longest side in pixels that photos are shrunk to; 0: not at all."""

    surface: Surface = "auto"
    """Plane sweep or relief of the sparse points, by the number of placed photos if "auto"."""

    depth_size: int = 800
    """Longest side in pixels of swept images."""

    model: Path | None = None
    """Of another program, whose poses are kept."""

    mesh: Path | None = None
    """In the frame of `model`, for the depths."""

    depth: Path | None = None
    """Folder of depth or disparity maps of the photos, in any unit."""

    def __post_init__(self) -> None:
        if self.focal is not None and not 0.2 <= self.focal <= 10:
            # fields of view of 136 and 6 degrees
            remedy = "divide pixels by the photo's longer side, or a 35 mm equivalent in millimetres by 36"
            raise InputError(f"{self.focal:g} is not from 0.2 to 10 widths", "--focal", remedy)
        if self.focal and self.model:
            raise InputError(
                "is part of the model that --model gives", "--focal", "give one of them"
            )
        if self.mesh and self.depth:
            raise InputError("gives depths, as --depth does", "--mesh", "give one of them")
        if self.mesh and not self.model:
            fault = "is in the frame of a model, and a new model of the photos has another one"
            raise InputError(
                fault, "--mesh", "add --model with the model that it was made with"
            )
        for option, path in (
            ("--model", self.model),
            ("--mesh", self.mesh),
            ("--depth", self.depth),
        ):
            if path is not None and not path.exists():
                raise MissingFileError("no such file or folder", path, f"correct {option}")
