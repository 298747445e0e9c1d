"""Brings a model of arbitrary scale to metres, with one known length.

Photos alone cannot distinguish a large scene from a small, near one. What is known may be the factor, distances between
cameras, a visible length, or the depth below the surface of each photo.
"""

import csv
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import DamagedFileError, InputError, file_error
from sucre_bench.machine.files import regular
from sucre_bench.programs.prepare.registered_photos import Shot

_USUAL_DEPTH = 3.0  # the median depth if no scale is known
_LARGEST_ERROR = 0.1  # greatest relative value of two standard errors of a scale from a depth track


@dataclass(frozen=True, slots=True)
class Length:
    """Two pixels (x, y) of an undistorted image, and the distance of their points in metres."""

    photo: str
    ends: tuple[tuple[float, float], tuple[float, float]]
    metres: float


@dataclass(frozen=True, slots=True)
class Known:
    """What is known of the scale: one of these at most.

    factor: metres per unit; distances: two photos and the metres between their
    cameras; lengths; depth_track: CSV file of image,depth with metres below the surface.

    Raises InputError if more than one is given, or if a length is not above 0.
    """

    factor: float | None = None
    distances: tuple[tuple[str, str, float], ...] = ()
    lengths: tuple[Length, ...] = ()
    depth_track: Path | None = None

    def __post_init__(self) -> None:
        given = [self.factor is not None, bool(self.distances), bool(self.lengths), self.depth_track is not None]
        if sum(given) > 1:
            raise InputError("scale: more than one of --scale, --distance, --length, --depth-track; give one of them")
        metres = [("--scale", self.factor)] if self.factor is not None else []
        metres += [("--distance", m) for *_, m in self.distances] + [("--length", v.metres) for v in self.lengths]
        for option, value in metres:
            if not (math.isfinite(value) and value > 0):
                raise InputError(f"{option}: {value:g} is not above 0; give metres")


@dataclass(frozen=True, slots=True)
class Scale:
    """A scale.

    metres_per_unit: factor for the model; is_metric: False for an arbitrary scale; note: how it was found, and how far
    single measurements differ.
    """

    metres_per_unit: float
    is_metric: bool
    note: str


def find_scale(
    known: Known, shots: Sequence[Shot], output_of: Mapping[str, str], depth_of: Callable[[str], Array]
) -> Scale:
    """Return the scale. output_of: output names by photo; depth_of: an image's depth map (H, W), in the model's unit.

    Raises InputError if a photo is unknown or not registered, or if the input does not determine a scale.
    """
    by_name = {shot.name: shot for shot in shots}

    def placed(photo: str, option: str) -> Shot:
        output = output_of.get(photo, photo)
        if output not in by_name:
            fault = "was not placed" if photo in output_of else "is not a photo of these"
            remedy = _remedy(photo, [name for name, output in output_of.items() if output in by_name])
            raise InputError(f"{option}: {photo} {fault}; {remedy}")
        return by_name[output]

    if known.factor is not None:
        return Scale(known.factor, is_metric=True, note=f"given, {known.factor:g} m per unit")
    if known.distances:
        pairs = [(placed(a, "--distance"), placed(b, "--distance"), m) for a, b, m in known.distances]
        return _ratio(
            [float(np.linalg.norm(a.centre - b.centre)) for a, b, _ in pairs], [m for *_, m in pairs], "--distance"
        )
    if known.lengths:
        units = [_length(placed(length.photo, "--length"), length, depth_of) for length in known.lengths]
        return _ratio(units, [length.metres for length in known.lengths], "--length")
    if known.depth_track is not None:
        track = _read_track(known.depth_track)
        measured = {photo: output for photo, output in output_of.items() if photo in track and output in by_name}
        centres = np.array([by_name[output].centre for output in measured.values()]).reshape(-1, 3)
        return _from_depths(centres, np.array([track[photo] for photo in measured]), known.depth_track)
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    return Scale(_USUAL_DEPTH / float(np.median(depths)), False, f"arbitrary: median depth set to {_USUAL_DEPTH:g}")


def _remedy(photo: str, placed: Sequence[str]) -> str:
    """Suggest the same file in another folder or format: the names of a series are too alike for did-you-mean."""
    same = [p for p in placed if PurePosixPath(p).stem.lower() == PurePosixPath(photo).stem.lower()]
    if same and photo not in same:
        return f"did you mean '{same[0]}'?"
    return f"name one that was, like {', '.join(placed[:3])}"


def _ratio(units: Sequence[float], metres: Sequence[float], option: str) -> Scale:
    """The factor that fits several lengths best, each with the same relative error."""
    if min(units) <= 1e-9:
        raise InputError(f"{option}: the two are at the same place; give two that are apart")
    factors = np.array(metres) / np.array(units)
    factor = float(np.exp(np.log(factors).mean()))
    spread = f"; they differ by up to {100 * (factors.max() / factors.min() - 1):.1f} %" if len(factors) > 1 else ""
    return Scale(factor, True, f"from {len(factors)} x {option}: {factor:.4g} m per unit{spread}")


def _length(shot: Shot, length: Length, depth_of: Callable[[str], Array]) -> float:
    """The distance of two points in the model's unit, by the depth map around their pixels."""
    depth, ends = depth_of(shot.name), []
    for x, y in length.ends:
        column, row = int(x), int(y)
        around = depth[max(0, row - 3) : row + 4, max(0, column - 3) : column + 4]
        if not (0 <= x < shot.camera.width and 0 <= y < shot.camera.height) or not (around > 0).any():
            raise InputError(
                f"--length: {length.photo} has no depth at {x:g},{y:g}; choose a point with texture near it"
            )
        ends.append(np.linalg.inv(shot.camera.K) @ (x, y, 1) * np.median(around[around > 0]))
    return float(np.linalg.norm(ends[0] - ends[1]))


def _read_track(path: Path) -> dict[str, float]:
    try:
        with regular(path).open(newline="", encoding="utf-8-sig") as file:
            return {row["image"].strip(): float(row["depth"]) for row in csv.DictReader(file)}
    except OSError as fault:
        raise file_error(path, fault, "give a CSV file of image,depth") from fault
    except (KeyError, ValueError, TypeError, AttributeError) as fault:
        raise DamagedFileError(
            f"is not a table of image,depth in metres ({fault})", path, "write that header"
        ) from fault


def _from_depths(centres: Array, depths: Array, path: Path) -> Scale:
    """Fit depth = v . C + c: v has the direction of gravity and the length of metres per unit.

    The track must not lie in a plane: else a part of v, and so its length, is unknown.
    """
    if len(depths) < 6:
        raise InputError(f"{path}: names {len(depths)} of the placed photos; give depths of six or more")
    design = np.column_stack([centres - centres.mean(axis=0), np.ones(len(depths))])
    solution, _, rank, _ = np.linalg.lstsq(design, depths, rcond=None)
    rest = depths - design @ solution
    # A depth gauge resolves centimetres at best, however well so few numbers fit.
    noise = max(float(rest @ rest) / (len(depths) - 4), 0.01**2)
    factor = float(np.linalg.norm(solution[:3]))
    error = np.inf
    if rank == 4 and factor > 0:
        along = solution[:3] / factor
        error = float(np.sqrt(noise * along @ np.linalg.inv(design.T @ design)[:3, :3] @ along)) / factor
        # Any error of v across its direction makes it longer.
        error += float(noise * np.trace(np.linalg.inv(design.T @ design)[:3, :3])) / (2 * factor**2)
    if 2 * error > _LARGEST_ERROR:
        fault = "the cameras move too little up, down and sideways for their depths to tell the scale"
        raise InputError(f"{path}: {fault} ({100 * min(error, 9.99):.0f} % standard error); know a length instead")
    accuracy = f"{100 * error:.1f} % standard error, rest {rest.std():.3f} m"
    note = f"from the depths of {len(depths)} photos: {factor:.4g} m per unit, {accuracy}"
    return Scale(factor, True, note)
