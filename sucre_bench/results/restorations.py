"""Writes and reads stored restorations: the picture with its mask, its record, and with save=full the arrays (.npz).

A mask says which pixels have a colour. It is a private chunk of the picture's PNG file, which other programs pass over;
a picture without holes has none. With save=full, a metric that is added later is computed from the stored restoration;
the method does not run again.
"""

from __future__ import annotations

import io
import json
import struct
import time
import zlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, Any

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Mask
from sucre_bench.errors import ANY_FAULT, DamagedFileError, InputError, NotApplicableError
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit, to_levels
from sucre_bench.imaging.image_files import (
    PNG_HEADER,
    check_pixels,
    png_chunk,
    read_bgr,
    write_image,
    write_png,
)
from sucre_bench.machine.files import reading, regular, write_atomically
from sucre_bench.machine.records import record_of
from sucre_bench.results import layout
from sucre_bench.results.layout import Place
from sucre_bench.results.reasons import Reason
from sucre_bench.results.rows import Row
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Restoration, View, Water

FILES = (
    "files"  # the name in the record of the sizes in bytes of the files beside it, by suffix
)
_SHOWN_OVER = "shown_over"


@dataclass(frozen=True)
class Measured:
    """A restoration, and what it took."""

    restoration: Restoration

    seconds: float
    """Wall time."""

    peak_mb: float
    """MB of memory above what was held before."""


def write_view(out: Path, place: Place, view: View) -> None:
    """Write the view and its reference, to look at."""
    for plane, path in (("rgb", place.original(out)), ("reference", place.reference(out))):
        if (image := getattr(view, plane)) is not None:
            levels = to_8bit(display(image, "none", view.encoding)[..., ::-1])
            del image  # it may have 1 GB
            write_image(path, levels)


def write_pictures(
    out: Path,
    place: Place,
    method: str,
    restoration: Restoration,
    shown: Array,
    filled: Array | None = None,
    bits: int = 8,
    shown_over: str = "",
) -> None:
    """Write the restored image with its mask, and its record.

    method: the label; shown: the restored image (H, W, 3) in [0, 1], gamma-encoded, NaN = a hole; filled: guessed
    colours of holes, likewise: the picture shows them, and the mask still marks holes; bits: of the restored image;
    shown_over: a hash of the views whose colours decided how it is shown.
    """
    path, started = place.restored(out, method), time.perf_counter()
    picture = shown if filled is None else np.where(np.isnan(shown), filled, shown)
    valid = restoration.valid
    mask = None if valid.all() else valid
    del valid  # 100 MB in a picture of 100 megapixels
    write_masked_png(path, to_levels(picture[..., ::-1], bits), mask)
    files = (path.with_suffix(suffix) for suffix in (".png", ".npz"))
    sizes = {file.suffix: file.stat().st_size for file in files if file.is_file()}
    water = _water_record(restoration.water)
    more = {"write_seconds": time.perf_counter() - started, FILES: sizes}
    more |= {_SHOWN_OVER: shown_over} if shown_over else {}
    # the water first
    text = json.dumps(water | restoration.info | water | more, default=_plain, skipkeys=True)
    record = json.loads(text, parse_constant=lambda _: None)  # JSON knows no NaN
    write_atomically(path.with_suffix(".json"), json.dumps(record, indent=1).encode())


def _plain(value: Any) -> Any:
    """An array as lists, a water by its parameters, anything else as text: `info` may hold any object."""
    if isinstance(value, Water):
        return _water_record(value)
    return value.tolist() if isinstance(value, (np.ndarray, np.generic)) else str(value)


def _water_record(water: Water | None) -> dict[str, Any]:
    """A water by the names that `sucre_bench.results.water_file` reads; empty without one."""
    if water is None:
        return {}
    parameters = {
        "B": water.veiling_light,
        "beta": water.attenuation,
        "gamma": water.backscatter,
    }
    return parameters | {"encoding": water.encoding}


def are_stored(picture: Path, suffixes: Iterable[str], shown_over: str = "") -> bool:
    """Whether a picture's record is there, and its files with these suffixes are, in the size that was written.

    shown_over: see `write_pictures`.
    """
    try:
        record = record_of(picture)
        sizes = record[FILES]
        return record.get(_SHOWN_OVER, "") == shown_over and all(
            regular(picture.with_suffix(suffix)).stat().st_size == sizes[suffix]
            for suffix in suffixes
        )
    except (OSError, InputError, TypeError, KeyError):
        return False


def write_full(path: Path, measured: Measured, base: Row) -> None:
    """Write all of a restoration as .npz: J, the water, the confidence, and what else `read_full` gives back.

    base: identifies options, data and code. If `info` cannot be stored losslessly as JSON, only the arrays are written.
    """
    info = {
        name: value for name, value in measured.restoration.info.items() if name != "true_water"
    }
    about = {
        "of": _identity(base),
        "seconds": measured.seconds,
        "peak_mb": measured.peak_mb,
        "info": info,
    }
    try:
        text = json.dumps(about, default=_as_list)
        np.testing.assert_equal(json.loads(text, object_hook=_as_array), about)
    except (TypeError, ValueError, AssertionError):
        write_arrays(path, measured.restoration)
    else:
        write_arrays(path, measured.restoration, about=np.array(text))


_ARRAY = "array of"


def _as_list(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)) and value.dtype.kind in "biuf":
        return {_ARRAY: value.dtype.str, "values": value.tolist()}
    raise TypeError(f"{type(value)} is not an array of numbers")


def _as_array(value: dict[str, Any]) -> Any:
    return np.array(value["values"], dtype=value[_ARRAY]) if _ARRAY in value else value


def _identity(base: Row) -> list[str]:
    return [base.options_id, base.data_id, base.code]


def write_arrays(path: Path, restoration: Restoration, **more: Any) -> None:
    """Write a restoration's arrays as .npz: image (H, W, 3), and where known B, beta, gamma (3,), confidence (H, W)
    and filled (H, W, 3).
    """
    named = {
        "image": restoration.image,
        "confidence": restoration.confidence,
        "filled": restoration.filled,
        **more,
    }
    named |= _water_record(restoration.water)
    buffer = io.BytesIO()
    np.savez_compressed(
        buffer, **{name: array for name, array in named.items() if array is not None}
    )
    write_atomically(path, buffer.getvalue())


def read_full(path: Path, base: Row) -> Measured | None:
    """Read a restoration that `write_full` wrote; None unless the file is of the same options, data and code."""
    arrays = read_full_arrays(path)
    if "about" not in arrays:
        return None
    about = json.loads(str(arrays["about"]), object_hook=_as_array)
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
    """Return the record of the restoration that a row stands for; empty if there is none.

    row: as `DataFrame.itertuples` gives it. Raises InputError if a .json file beside the picture is damaged.
    """
    pictures = (
        place.restored(out, row.method)
        for place in layout.possible_places(row.dataset, row.scene, row.view)
    )
    return next(filter(None, map(record_of, pictures)), {})


# -- masks and pictures -----------------------------------------------------------------------------------


_CHUNK = b"hoLE"  # by its small and capital letters: may be left out; private; not kept by who changes the picture


def write_masked_png(path: Path, picture: np.ndarray, mask: Mask | None) -> None:
    """Write a picture (H, W, 3), BGR of 8 or 16 bits, with its mask (H, W) if any. Raises OutputError if that fails."""
    chunk = b""
    if mask is not None and not mask.all():
        chunk = png_chunk(_CHUNK + zlib.compress(np.packbits(mask).tobytes()))
    write_png(path, picture, 1, chunk)


def read_mask(path: Path) -> Mask | None:
    """Return the mask (H, W) of a picture that `write_masked_png` wrote; None if it has none.

    Raises MissingFileError or DamagedFileError.
    """
    again = "run its method again with overwrite=always"
    with reading(path, again), regular(path, "repeat its run's command").open("rb") as file:
        return mask_in(file, path)


def mask_in(png: IO[bytes], place: Path) -> Mask | None:
    """Return the mask (H, W) in an opened PNG file; None if it has none. place: of the file, to be named.

    Raises ValueError, struct.error or zlib.error if it is damaged.
    """
    head = png.read(PNG_HEADER + 8)
    if not head.startswith(b"\x89PNG"):
        raise ValueError("no PNG")
    if head[-4:] != _CHUNK:
        return None
    width, height, length = struct.unpack(">8x8xII9xI4x", head)
    check_pixels(str(place), (width, height))
    bits = zlib.decompressobj().decompress(png.read(length), (width * height + 7) // 8)
    flags = np.unpackbits(np.frombuffer(bits, np.uint8), count=width * height)
    return flags.reshape(height, width).astype(np.bool_)


class PictureOnly(Restoration):
    """A restoration of which there are picture and mask, but not the computed image.

    Asking for `image` raises NotApplicableError. mask: (H, W), the pixels with a colour; reason: why it is not there.
    """

    def __init__(self, mask: Mask, reason: Reason = Reason.NOT_STORED) -> None:
        self.__dict__.update(mask=mask, reason=reason, info={})

    def __getattr__(self, name: str) -> Any:
        if name == "image":
            raise NotApplicableError(self.__dict__["reason"].value)
        raise AttributeError(name)

    def at_size(self, shape: tuple[int, ...]) -> PictureOnly:
        """Return the same for a picture of another height and width, where holes are black pixels."""
        return PictureOnly(np.ones(shape, np.bool_), self.__dict__["reason"])

    @property
    def valid(self) -> Mask:
        mask: Mask = self.__dict__["mask"]
        return mask


def stored_picture(
    out: Path, place: Place, method: str, size: tuple[int, ...] = ()
) -> AnyArray:
    """Return a restored image (H, W, 3), RGB, uint8 or uint16 as it is stored, holes black.

    size: (H, W) of its view, if known. Raises MissingFileError, DamagedFileError, or InputError for another size.
    """
    path = regular(place.restored(out, method), "repeat its run's command")
    picture = np.ascontiguousarray(read_bgr(path)[..., ::-1])
    if size and picture.shape[:2] != size:
        height, width = picture.shape[:2]
        fault = f"is {width}x{height}, its view {size[1]}x{size[0]}"
        raise InputError(fault, path, f"run {method} again with overwrite=always")
    return picture


def stored_mask(out: Path, place: Place, base: Row) -> Mask:
    """Return which pixels (H, W) of a restoration with holes have a colour. base: its row, which says how many.

    Raises InputError if the mask is gone or damaged.
    """
    path = place.restored(out, base.method)
    mask = read_mask(path)
    if mask is None or int(mask.sum()) != base.n_pixels:
        remedy = f"run {base.method} again with overwrite=always"
        raise DamagedFileError("has not the mask of its restoration", path, remedy)
    return mask


def stored_restoration(out: Path, place: Place, base: Row, mask: Mask) -> Restoration:
    """Return a restoration with holes outside a mask (H, W); with its computed image if save=full stored it."""
    kept = read_full(place.restored(out, base.method).with_suffix(".npz"), base)
    if kept is None:
        return PictureOnly(mask)
    restored = kept.restoration
    return replace(restored, image=masked(restored.image, mask), filled=None)


def masked(image: Array, mask: Mask) -> Array:
    """Return an image (H, W, 3) as float32 with NaN outside a mask (H, W)."""
    return np.where(mask[..., None], image, np.float32(np.nan)).astype(np.float32)
