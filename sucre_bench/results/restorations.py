"""Writes and reads stored restorations: picture, mask, record (.json), and with save=full the arrays (.npz).

With save=full, a metric that is added later is computed from the stored restoration; the method does not run again.
"""

import io
import json
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT, DamagedFileError
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import write_image, write_png
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.results import layout
from sucre_bench.results.layout import Place
from sucre_bench.results.masks import write_mask
from sucre_bench.results.rows import Row
from sucre_bench.results.stored_hashes import FILES, described
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Encoding, Restoration, View, Water


@dataclass(frozen=True)
class Measured:
    """A restoration, and what it took: wall seconds, MB of memory above what was held before."""

    restoration: Restoration
    seconds: float
    peak_mb: float


def write_pictures(
    out: Path,
    place: Place,
    method: str,
    view: View,
    restoration: Restoration,
    shown: Array,
    filled: Array | None = None,
) -> None:
    """Write the restored image, its mask, its record, and the view and its reference to look at beside it.

    method: the label; shown: the restored image (H, W, 3) in [0, 1], gamma-encoded, NaN = a hole; filled: guessed
    colours of holes, likewise: the picture shows them, and the mask still marks holes.
    """
    path, started = place.restored(out, method), time.perf_counter()
    _write_to_look_at(place.original(out), view.rgb, view.encoding)
    if view.reference is not None:
        _write_to_look_at(place.reference(out), view.reference, view.encoding)
    picture = shown if filled is None else np.where(np.isnan(shown), filled, shown)
    write_png(path, to_8bit(picture)[..., ::-1], compression=1)
    write_mask(place.mask(out, method), restoration.valid)
    more = {"write_seconds": time.perf_counter() - started, FILES: described(path)}
    write_atomically(path.with_suffix(".json"), _record(restoration, more))


def write_full(path: Path, measured: Measured, base: Row) -> None:
    """Write all of a restoration as .npz: J, the water, the confidence, and what else `read_full` gives back.

    base: identifies options, data and code. If `info` cannot be stored losslessly as JSON, only the arrays are written.
    """
    info = {name: value for name, value in measured.restoration.info.items() if name != "true_water"}
    about = {"of": _identity(base), "seconds": measured.seconds, "peak_mb": measured.peak_mb, "info": info}
    text = _json_if_lossless(about)
    write_arrays(path, measured.restoration, **({"about": np.array(text)} if text else {}))


def write_arrays(path: Path, restoration: Restoration, **more: Any) -> None:
    """Write a restoration's arrays as .npz: image (H, W, 3), and where known B, beta, gamma (3,), confidence (H, W)
    and filled (H, W, 3).
    """
    buffer = io.BytesIO()
    arrays: dict[str, Any] = {"image": restoration.image}
    if restoration.water is not None:
        arrays |= _water_record(restoration.water)
    if restoration.confidence is not None:
        arrays["confidence"] = restoration.confidence
    if restoration.filled is not None:
        arrays["filled"] = restoration.filled
    np.savez_compressed(buffer, **arrays, **more)
    write_atomically(path, buffer.getvalue())


def read_full(path: Path, base: Row) -> Measured | None:
    """Read a restoration that `write_full` wrote; None unless the file is of the same options, data and code."""
    arrays = read_full_arrays(path)
    if "about" not in arrays:
        return None
    about = json.loads(str(arrays["about"]), object_hook=_array)
    if about["of"] != _identity(base):
        return None
    kept = arrays.get("confidence"), about["info"], arrays.get("filled")
    restoration = Restoration(arrays["image"], water_of(arrays, path), *kept)
    return Measured(restoration, about["seconds"], about["peak_mb"])


def read_full_arrays(path: Path, *names: str) -> Mapping[str, Any]:
    """Return the arrays that `write_full` wrote, by name; none if the file does not exist or is damaged.

    names: the wanted ones, as far as the file has them; default all.
    """
    try:
        with regular(path).open("rb") as file, np.load(file, allow_pickle=False) as arrays:
            return {name: arrays[name] for name in arrays.files if not names or name in names}
    except ANY_FAULT:  # unpacking damaged bytes raises errors of many kinds
        return {}


def read_record(row: Any, out: Path) -> dict[str, Any]:
    """Return the record (.json) of the restoration that a row stands for; empty if there is none.

    row: as `DataFrame.itertuples` gives it. Raises InputError if the file is damaged.
    """
    place = layout.find(row.dataset, row.scene, row.view, out)
    path = place.restored(out, row.method).with_suffix(".json") if place else None
    if path is None or not path.is_file():
        return {}
    try:
        content: dict[str, Any] = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as fault:
        raise DamagedFileError(f"cannot be read ({fault})", path, "delete it and run again") from fault
    return content


_ARRAY = "array of"


def _json_if_lossless(values: Mapping[str, Any]) -> str:
    """The values as JSON, or "" if decoding it would not give the same values."""

    def as_list(value: Any) -> Any:
        if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biuf":
            return {_ARRAY: value.dtype.str, "values": value.tolist()}
        raise TypeError(f"{type(value)} is not an array of numbers")

    try:
        text = json.dumps(values, default=as_list)
        np.testing.assert_equal(json.loads(text, object_hook=_array), dict(values))
    except (TypeError, ValueError, AssertionError):
        return ""
    return text


def _array(value: dict[str, Any]) -> Any:
    return np.array(value["values"], dtype=value[_ARRAY]) if _ARRAY in value else value


def _identity(base: Row) -> list[str]:
    return [base.options_id, base.data_id, base.code]


def _write_to_look_at(path: Path, image: Array, encoding: Encoding) -> None:
    """Write a view's image (H, W, 3) in the format of the path's suffix."""
    write_image(path, to_8bit(display(image, "none", encoding))[..., ::-1])


def _water_record(water: Water) -> dict[str, Any]:
    """A water by the names that `sucre_bench.results.water_file` reads."""
    parameters = {"B": water.veiling_light, "beta": water.attenuation, "gamma": water.backscatter}
    return parameters | {"encoding": water.encoding}


def _record(restoration: Restoration, more: Mapping[str, Any]) -> bytes:
    """The water, the method's `info`, the true water where known, and more, as JSON."""
    water = restoration.water
    known = {} if water is None else _water_record(water)
    values = known | restoration.info | known | dict(more)  # the water first
    text = json.dumps(values, default=_plain, skipkeys=True)
    return json.dumps(json.loads(text, parse_constant=lambda _: None), indent=1).encode()  # JSON knows no NaN


def _plain(value: Any) -> Any:
    """An array as lists, a water by its parameters, anything else as text: `info` may hold any object."""
    if isinstance(value, Water):
        return _water_record(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)
