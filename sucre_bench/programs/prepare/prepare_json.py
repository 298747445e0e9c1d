"""prepare.json: the result and its inputs, for people, for `describe`, and for a repeated command."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.machine.files import write_atomically
from sucre_bench.programs.prepare.scale import Known, Length, Scale

_FILE = "prepare.json"


_MODEL = tuple(f"sparse/{name}.bin" for name in ("cameras", "images", "points3D"))


@dataclass(frozen=True, slots=True)
class Prepared:
    """The result of `prepare`.

    out: its folder; qualities: figures of its images; damaged, unplaced: photos left out, with reason and remedy;
    scale; known: what the scale was found from, see `given`; warnings; keys: of the model and of the depth maps' stage,
    which decide whether a scale and a length are still valid; is_new: False if nothing had to be done; is_kept: whether
    the scale is that of an earlier command.
    """

    out: Path
    qualities: tuple[Quality, ...]
    damaged: dict[str, str]
    unplaced: dict[str, str]
    scale: Scale
    known: dict[str, Any]
    warnings: tuple[str, ...]
    keys: tuple[str, str]
    is_new: bool = True
    is_kept: bool = False

    @property
    def photos(self) -> int:
        """The number of photos."""
        return len(self.qualities) + len(self.damaged) + len(self.unplaced)

    @property
    def is_whole(self) -> bool:
        """Whether all its files exist; a depth map may have any of its formats."""
        depths = (PurePosixPath("depths", q.name) for q in self.qualities if q.coverage)
        stems = (self.out / depth.with_name(f"depth_{depth.stem}") for depth in depths)
        files = (*_MODEL, "quality.html", *(f"images/{q.name}" for q in self.qualities))
        return all((self.out / file).is_file() for file in files) and all(
            any(stem.with_name(stem.name + suffix).is_file() for suffix in (".png", ".tif")) for stem in stems
        )


def given(known: Known) -> dict[str, Any]:
    """Return what is known as plain data for JSON, a depth track with its hash; empty if nothing is known."""
    values: dict[str, Any] = {k: v for k, v in json.loads(json.dumps(asdict(known), default=str)).items() if v}
    if known.factor is not None:
        values["factor"] = known.factor  # not `if factor`: 0 is wrong, but given
    track = known.depth_track
    if track is not None:
        content = track.read_bytes() if track.is_file() else b""
        hashed = hashlib.blake2b(content, digest_size=6).hexdigest()
        values["depth_track"] = {"file": str(track.resolve()), "hash": hashed}
    return values


@dataclass(frozen=True, slots=True)
class Settled:
    """What is known of the scale before there are depth maps.

    scale: None if it has to be found from `known`; is_kept: whether it comes from an earlier command.
    """

    scale: Scale | None
    known: Known
    is_kept: bool = False
    warnings: tuple[str, ...] = ()


def settled_by(before: Prepared | None, known: Known, keys: tuple[str, str]) -> Settled:
    """Return the scale of an earlier result in the same folder. keys: those of the result to be made.

    A newly given scale counts first. Else the scale of the same model is valid. For another model the distances and the
    depth track stay valid; a factor and the pixels of lengths do not.
    """
    values = given(known)
    if before is None:
        return Settled(None, known)
    if values:
        return Settled(before.scale if values == before.known and keys == before.keys else None, known)
    earlier = _known_of(before.known)
    if keys[0] == before.keys[0]:
        return Settled(before.scale, earlier, before.scale.is_metric)
    if earlier.distances or earlier.depth_track:
        return Settled(None, earlier, is_kept=True)
    old = f"the scale of before ({before.scale.note}) was of another model; give it again"
    return Settled(None, known, is_kept=False, warnings=(old,) if before.scale.is_metric else ())


def _known_of(values: Mapping[str, Any]) -> Known:
    """The inverse of `given`."""
    return Known(
        values.get("factor"),
        tuple((a, b, metres) for a, b, metres in values.get("distances", ())),
        tuple(
            Length(v["photo"], (tuple(v["ends"][0]), tuple(v["ends"][1])), v["metres"])
            for v in values.get("lengths", ())
        ),
        Path(values["depth_track"]["file"]) if "depth_track" in values else None,
    )


def write_record(made: Prepared, more: Mapping[str, Any]) -> None:
    """Write the file. more: entries for people only."""
    record = {
        **more,
        "scale": {**asdict(made.scale), "known": made.known},
        "damaged": made.damaged,
        "unplaced": made.unplaced,
        "warnings": list(made.warnings),
        "images": [{k: None if v != v else v for k, v in asdict(q).items()} for q in made.qualities],
        "made_of": dict(zip(("model", "depths"), made.keys, strict=True)),
    }
    write_atomically(made.out / _FILE, (json.dumps(record, indent=1, ensure_ascii=False) + "\n").encode())


def read_record(out: Path) -> Prepared | None:
    """Return the record; None if there is none. Raises InputError if it cannot be read."""
    file = out / _FILE
    if not file.is_file():
        return None
    try:
        record = json.loads(file.read_bytes())
        scale = dict(record["scale"])
        known = scale.pop("known")
        rows: list[dict[str, Any]] = record["images"]
        rows = [{k: float("nan") if v is None else v for k, v in row.items()} for row in rows]
        qualities = tuple(Quality(**row) for row in rows)
        keys = record["made_of"]["model"], record["made_of"]["depths"]
        damaged, unplaced, warnings = dict(record["damaged"]), dict(record["unplaced"]), tuple(record["warnings"])
        return Prepared(out, qualities, damaged, unplaced, Scale(**scale), known, warnings, keys)
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as fault:
        remedy = "remove it, and give the scale again if one was given"
        raise InputError(f"{file}: is not what prepare wrote; {remedy}") from fault


_MILD_COVERAGE, _MILD_ERROR = 0.1, 0.02  # the page marks worse values


@dataclass(frozen=True, slots=True)
class Quality:
    """The quality of one image.

    points: sparse points seen; reprojection_px: their mean distance from where they were found, in
    pixels of the undistorted image, NaN without points; coverage: share of pixels with depth; depth_error: median
    relative difference of the depth map from the sparse points, NaN if none has both; nearest_m, farthest_m: 1 and
    99 % of depths.
    """

    name: str
    points: int
    reprojection_px: float
    coverage: float
    depth_error: float
    nearest_m: float
    farthest_m: float

    @property
    def is_poor(self) -> bool:
        """Whether to check the image before using it."""
        return self.coverage < _MILD_COVERAGE or not self.depth_error <= _MILD_ERROR
