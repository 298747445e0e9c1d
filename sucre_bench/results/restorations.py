"""What is kept of a restoration: its picture, what the method told of it, and with save=full the whole of it.

What is kept whole is scored again without being restored again, by metrics that were asked for later.
"""

from __future__ import annotations

import io
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT, InputError
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.machine.files import write_atomically
from sucre_bench.results import layout
from sucre_bench.results.layout import Place
from sucre_bench.results.rows import Row
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Restoration, View, Water

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["Measured", "keep", "keep_whole", "kept_arrays", "kept_whole", "restorations", "told"]


def keep(out: Path, place: Place, method: str, view: View, restoration: Restoration, shown: Array) -> None:
    """Keep the restored picture, and the view and its reference to look at beside it.

    method: the label; shown: the picture made of the restoration.
    """
    path, started = place.restored(out, method), time.perf_counter()
    _write_image(place.original(out), display(view.rgb, "none", view.encoding))
    if view.reference is not None:
        _write_image(place.reference(out), display(view.reference, "none", view.encoding))
    _write_image(path, shown)
    write_atomically(path.with_suffix(".json"), _as_json(restoration, time.perf_counter() - started))


def keep_whole(path: Path, measured: Measured, base: Row) -> None:
    """Write all of a restoration: J, the water, the confidence, and what else `kept_whole` gives back.

    base: what its rows say, which tells whence it is. Of a method that tells what no file brings back as it was,
    objects of its own say, only the arrays are kept.
    """
    restoration, buffer = measured.restoration, io.BytesIO()
    arrays: dict[str, Any] = {"image": restoration.image}
    if restoration.water is not None:
        arrays |= _water_record(restoration.water)
    if restoration.confidence is not None:
        arrays["confidence"] = restoration.confidence
    info = {name: value for name, value in restoration.info.items() if name != "true_water"}
    about = {"of": _whence(base), "seconds": measured.seconds, "peak_mb": measured.peak_mb, "info": info}
    if text := _lasting(about):
        arrays["about"] = np.array(text)
    np.savez_compressed(buffer, **arrays)
    write_atomically(path, buffer.getvalue())


def kept_whole(path: Path, base: Row) -> Measured | None:
    """Read a restoration that was kept whole; None unless there is one, of the same options, data and code."""
    arrays = kept_arrays(path)
    if "about" not in arrays:
        return None
    about = json.loads(str(arrays["about"]), object_hook=_array)
    if about["of"] != _whence(base):
        return None
    restoration = Restoration(arrays["image"], water_of(arrays, path), arrays.get("confidence"), about["info"])
    return Measured(restoration, about["seconds"], about["peak_mb"])


def kept_arrays(path: Path, *names: str) -> Mapping[str, Any]:
    """Return the arrays that `keep_whole` wrote, by name; none of a file that is not there or is damaged.

    names: of those that are wanted, as far as there are such; all where none is given.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if not names or name in names}
    except ANY_FAULT:  # of damaged bytes, unpacking raises whatever it comes upon
        return {}


_ARRAY = "array of"


def _lasting(told: Mapping[str, Any]) -> str:
    """What is told as JSON; empty where it would not come back as it was."""

    def listed(value: Any) -> Any:
        if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biuf":
            return {_ARRAY: value.dtype.str, "values": value.tolist()}
        raise TypeError(f"{type(value)} is kept by no file")

    try:
        text = json.dumps(told, default=listed)
        np.testing.assert_equal(json.loads(text, object_hook=_array), dict(told))
    except (TypeError, ValueError, AssertionError):
        return ""
    return text


def _array(found: dict[str, Any]) -> Any:
    return np.array(found["values"], dtype=found[_ARRAY]) if _ARRAY in found else found


def _whence(base: Row) -> list[str]:
    return [base.options_id, base.data_id, base.code]


def _write_image(path: Path, shown: Array) -> None:
    import cv2

    written, encoded = cv2.imencode(path.suffix, to_8bit(shown)[..., ::-1])
    assert written
    write_atomically(path, encoded.tobytes())


def _water_record(water: Water) -> dict[str, Any]:
    """A water by the names that `sucre_bench.results.water_file` reads."""
    parameters = {"B": water.veiling_light, "beta": water.attenuation, "gamma": water.backscatter}
    return parameters | {"encoding": water.encoding}


def _as_json(restoration: Restoration, write_seconds: float) -> bytes:
    """The water, what the method tells of its work, the true water where known, and how long writing took."""
    water = restoration.water
    known = {} if water is None else _water_record(water)
    told = known | restoration.info | known | {"write_seconds": write_seconds}  # what is known of the water comes first
    text = json.dumps(told, default=_plain, skipkeys=True)
    return json.dumps(json.loads(text, parse_constant=lambda _: None), indent=1).encode()  # JSON knows no NaN


def _plain(value: Any) -> Any:
    """An array as lists, a water by its parameters, anything else in words: a method may tell what it likes."""
    if isinstance(value, Water):
        return _water_record(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)


def restorations(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row for each restoration that rows tell of and that ended well: the row of its seconds."""
    return rows[(rows["metric"] == "seconds") & (rows["status"] == "ok") & (rows["view"] != "")]


def told(row: Any, out: Path) -> dict[str, Any]:
    """Return what is kept of the restoration a row is of (as `DataFrame.itertuples` gives rows); empty when nothing is.

    Raises InputError where the file is damaged.
    """
    place = layout.find(row.dataset, row.scene, row.view, out)
    path = place.restored(out, row.method).with_suffix(".json") if place else None
    if path is None or not path.is_file():
        return {}
    try:
        content: dict[str, Any] = json.loads(path.read_bytes())
    except ValueError as fault:
        raise InputError(f"{path}: cannot be read ({fault}); delete it and run again") from fault
    return content


@dataclass(frozen=True)
class Measured:
    """A restoration, and what it took: wall seconds, MB of memory above what was held before."""

    restoration: Restoration
    seconds: float
    peak_mb: float
