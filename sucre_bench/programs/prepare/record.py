"""prepare.json: what was made and of what, for people, for `describe`, and for the same command given again."""

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

__all__ = ["Prepared", "Quality", "Settled", "given", "read_record", "settled_by", "write_record"]

_FILE = "prepare.json"


_MODEL = tuple(f"sparse/{name}.bin" for name in ("cameras", "images", "points3D"))


@dataclass(frozen=True, slots=True)
class Prepared:
    """What came out.

    out: its folder; qualities: figures of its images; damaged, unplaced: names of photos that were left out, with
    reason and remedy; scale: and known: what it was found by, see `given`; warnings: what to beware of; keys: of the
    model and of the depth maps' stage, which tell whether a scale and a length still hold; is_new: False where all was
    there already; is_kept: whether the scale is the one of an earlier command.
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
        """How many there were."""
        return len(self.qualities) + len(self.damaged) + len(self.unplaced)

    @property
    def is_whole(self) -> bool:
        """Whether all its files are there still; a depth map may have any of its formats."""
        depths = (PurePosixPath("depths", q.name) for q in self.qualities if q.coverage)
        stems = (self.out / depth.with_name(f"depth_{depth.stem}") for depth in depths)
        files = (*_MODEL, "quality.html", *(f"images/{q.name}" for q in self.qualities))
        return all((self.out / file).is_file() for file in files) and all(
            any(stem.with_name(stem.name + suffix).is_file() for suffix in (".png", ".tif")) for stem in stems
        )


def given(known: Known) -> dict[str, Any]:
    """Return what is known as JSON has it, a depth track with the hash of its content; empty where nothing is."""
    values: dict[str, Any] = {k: v for k, v in json.loads(json.dumps(asdict(known), default=str)).items() if v}
    if known.factor is not None:
        values["factor"] = known.factor  # 0 is given, if wrong
    track = known.depth_track
    if track is not None:
        content = track.read_bytes() if track.is_file() else b""
        hashed = hashlib.blake2b(content, digest_size=6).hexdigest()
        values["depth_track"] = {"file": str(track.resolve()), "hash": hashed}
    return values


@dataclass(frozen=True, slots=True)
class Settled:
    """What is settled of the scale before any depth map is there.

    scale: None where it is to be found by what is known; is_kept: whether an earlier command knew it.
    """

    scale: Scale | None
    known: Known
    is_kept: bool = False
    warnings: tuple[str, ...] = ()


def settled_by(before: Prepared | None, known: Known, keys: tuple[str, str]) -> Settled:
    """Return what an earlier result in the same folder says of the scale. keys: those of the result to be made.

    What is given anew counts. Else a scale found for the same model holds; for another model its distances and depth
    track do, while a factor is of the old one, and so are the pixels of lengths.
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
        return Settled(None, earlier, True)
    old = f"the scale of before ({before.scale.note}) was of another model; give it again"
    return Settled(None, known, False, (old,) if before.scale.is_metric else ())


def _known_of(values: Mapping[str, Any]) -> Known:
    """What `given` was made of."""
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
    """Write the file. more: what is for people only."""
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
    """Return what the file says, None where there is none. Raises InputError where it cannot be read."""
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
    except (OSError, ValueError, KeyError, TypeError) as fault:
        remedy = "remove it, and give the scale again if one was given"
        raise InputError(f"{file}: is not what prepare wrote; {remedy}") from fault


_MILD_COVERAGE, _MILD_ERROR = 0.1, 0.02  # worse is marked on the page


@dataclass(frozen=True, slots=True)
class Quality:
    """Of one image. points: sparse points seen; reprojection_px: their mean distance from where they were found, in
    pixels of the undistorted image, NaN without points; coverage: share of pixels with depth; depth_error: median
    relative difference of the depth map from the sparse points, NaN where none has both; nearest_m, farthest_m: 1 and
    99 % of depths."""

    name: str
    points: int
    reprojection_px: float
    coverage: float
    depth_error: float
    nearest_m: float
    farthest_m: float

    @property
    def is_poor(self) -> bool:
        """Whether one should look at it before using it."""
        return self.coverage < _MILD_COVERAGE or not self.depth_error <= _MILD_ERROR
