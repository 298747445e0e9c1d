"""Brings a model of arbitrary scale to metres, with one known length.

Photos alone cannot distinguish a large scene from a small, near one. What is known may be the factor, distances between
cameras, a visible length, or the depth below the surface of each photo.
"""

import csv
import hashlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, check_number
from sucre_bench.machine.files import reading, regular
from sucre_bench.programs.prepare.shots import Shot

_USUAL_DEPTH = 3.0  # the median depth if no scale is known
# greatest relative value of two standard errors of a scale from a depth track
_LARGEST_ERROR = 0.1

# What is known of the scale, as prepare.json holds it: one entry of those that `known_scale` makes, or none.
Known = Mapping[str, Any]


def known_scale(
    factor: float | None = None,
    distances: Sequence[tuple[str, str, float]] = (),
    lengths: Sequence[tuple[str, float, float, float, float, float]] = (),
    depth_track: Path | None = None,
) -> Known:
    """Return what is known of the scale as plain data, a depth track with its hash.

    factor: metres per unit; distances: two photos and the metres between their cameras; lengths: an undistorted image,
    x, y, x, y of two of its pixels, and the metres between their points; depth_track: CSV file of image,depth with
    metres below the surface.
    Raises InputError if more than one is given, or if a length is not above 0.
    """
    metres = [("--scale", factor)] if factor is not None else []
    metres += [("--distance", m) for *_, m in distances] + [
        ("--length", m) for *_, m in lengths
    ]
    for option, value in metres:
        check_number(option, value, "(0, inf)")
    for pixel in (pixel for _, *ends, _ in lengths for pixel in ends):
        check_number("--length", pixel, "[0, inf)")
    known: dict[str, Any] = {"factor": factor} if factor is not None else {}
    given = {"distances": distances, "lengths": lengths}
    known |= {name: [list(row) for row in rows] for name, rows in given.items() if rows}
    if depth_track is not None:
        content = depth_track.read_bytes() if depth_track.is_file() else b""
        hashed = hashlib.blake2b(content, digest_size=6).hexdigest()
        known["depth_track"] = {"file": str(depth_track.resolve()), "hash": hashed}
    if len(known) > 1:
        fault = "more than one of --scale, --distance, --length, --depth-track"
        raise InputError(fault, "scale", "give one of them")
    return known


@dataclass(frozen=True, slots=True)
class Scale:
    """A scale."""

    metres_per_unit: float
    """Factor for the model."""

    is_metric: bool
    """False for an arbitrary scale."""

    note: str
    """How it was found, and how far single measurements differ."""


def find_scale(
    known: Known,
    shots: Sequence[Shot],
    output_of: Mapping[str, str],
    depth_of: Callable[[Shot], Array],
    is_given: bool = False,
) -> Scale:
    """Return the scale. output_of: output names by photo; depth_of: a shot's depth map (H, W), in the model's unit.

    is_given: the model is of another program, so its unit stays unless something is known.
    Raises InputError if a photo is unknown or not registered, or if the input does not determine a scale.
    """
    by_name = {shot.name: shot for shot in shots}
    placed = {
        photo: by_name[output] for photo, output in output_of.items() if output in by_name
    }

    def find(photo: str, option: str) -> Shot:
        if photo in placed or photo in by_name:
            return placed[photo] if photo in placed else by_name[photo]
        # Names of a series are too alike for did-you-mean, but the same file may be in another folder or format.
        stem = PurePosixPath(photo).stem.lower()
        same = [p for p in placed if p != photo and PurePosixPath(p).stem.lower() == stem]
        remedy = (
            f"did you mean '{same[0]}'?"
            if same
            else f"name one that was, like {', '.join(list(placed)[:3])}"
        )
        fault = "was not placed" if photo in output_of else "is not a photo of these"
        raise InputError(f"{photo} {fault}", option, remedy)

    match known:
        case {"factor": factor}:
            return Scale(factor, is_metric=True, note=f"given, {factor:g} m per unit")
        case {"distances": distances}:
            pairs = [(find(a, "--distance"), find(b, "--distance")) for a, b, _ in distances]
            units = [float(np.linalg.norm(a.centre - b.centre)) for a, b in pairs]
            return _ratio(units, [metres for *_, metres in distances], "--distance")
        case {"lengths": lengths}:
            units = [
                _length(name, find(name, "--length"), ends, depth_of)
                for name, *ends, _ in lengths
            ]
            return _ratio(units, [metres for *_, metres in lengths], "--length")
        case {"depth_track": {"file": file}}:
            return _from_track(Path(file), placed)
    if is_given:
        return Scale(
            1.0, False, "the unit of the given model; if that is the metre, add --scale 1"
        )
    depths = np.concatenate([shot.seen_points()[1] for shot in shots])
    note = f"arbitrary, median depth {_USUAL_DEPTH:g}: no metres, beta and gamma not 1/m, colours right all the same"
    remedy = (
        "for metres give `sucre-bench prepare` --distance, --length, --depth-track or --scale"
    )
    return Scale(_USUAL_DEPTH / float(np.median(depths)), False, f"{note}; {remedy}")


def _ratio(units: Sequence[float], metres: Sequence[float], option: str) -> Scale:
    """The factor that fits several lengths best, each with the same relative error."""
    if min(units) <= 1e-9:
        raise InputError("the two are at the same place", option, "give two that are apart")
    factors = np.array(metres) / np.array(units)
    factor = float(np.exp(np.log(factors).mean()))
    spread = (
        f"; they differ by up to {100 * (factors.max() / factors.min() - 1):.1f} %"
        if len(factors) > 1
        else ""
    )
    return Scale(
        factor, True, f"from {len(factors)} x {option}: {factor:.4g} m per unit{spread}"
    )


def _length(
    name: str, shot: Shot, pixels: Sequence[float], depth_of: Callable[[Shot], Array]
) -> float:
    """The distance of two points in the model's unit, by the depth map around their pixels x, y, x, y."""
    depth = depth_of(shot)
    ends = []
    for x, y in (pixels[:2], pixels[2:]):
        column, row = int(x), int(y)
        around = depth[max(0, row - 3) : row + 4, max(0, column - 3) : column + 4]
        if (
            not (0 <= x < shot.camera.width and 0 <= y < shot.camera.height)
            or not (around > 0).any()
        ):
            fault = f"{name} has no depth at {x:g},{y:g}"
            raise InputError(fault, "--length", "choose a point with texture near it")
        ends.append(np.linalg.inv(shot.camera.K) @ (x, y, 1) * np.median(around[around > 0]))
    return float(np.linalg.norm(ends[0] - ends[1]))


def _from_track(path: Path, placed: Mapping[str, Shot]) -> Scale:
    """Fit depth = v . C + c to the depths of a file: v has the direction of gravity and the length of metres per unit.

    The track must not lie in a plane: else a part of v, and so its length, is unknown.
    """
    with reading(path, "give a CSV file with the header image,depth, in metres"):
        rows = csv.DictReader(regular(path).read_text(encoding="utf-8-sig").splitlines())
        track = {row["image"].strip(): float(row["depth"]) for row in rows}
    shots = {photo: shot for photo, shot in placed.items() if photo in track}
    if len(shots) < 6:
        raise InputError(
            f"names {len(shots)} of the placed photos", path, "give depths of six or more"
        )
    centres, depths = (
        np.array([s.centre for s in shots.values()]),
        np.array([track[photo] for photo in shots]),
    )
    design = np.column_stack([centres - centres.mean(axis=0), np.ones(len(depths))])
    solution, _, rank, _ = np.linalg.lstsq(design, depths, rcond=None)
    rest = depths - design @ solution
    # A depth gauge resolves centimetres at best, however well so few numbers fit.
    noise = max(float(rest @ rest) / (len(depths) - 4), 0.01**2)
    factor = float(np.linalg.norm(solution[:3]))
    error = np.inf
    if rank == 4 and factor > 0:
        along = solution[:3] / factor
        error = (
            float(np.sqrt(noise * along @ np.linalg.inv(design.T @ design)[:3, :3] @ along))
            / factor
        )
        # Any error of v across its direction makes it longer.
        error += float(noise * np.trace(np.linalg.inv(design.T @ design)[:3, :3])) / (
            2 * factor**2
        )
    if 2 * error > _LARGEST_ERROR:
        what = "the cameras move too little up, down and sideways for their depths to tell the scale"
        raise InputError(
            f"{what} ({100 * min(error, 9.99):.0f} % standard error)",
            path,
            "know a length instead",
        )
    accuracy = f"{100 * error:.1f} % standard error, rest {rest.std():.3f} m"
    note = f"from the depths of {len(depths)} photos: {factor:.4g} m per unit, {accuracy}"
    return Scale(factor, True, note)
