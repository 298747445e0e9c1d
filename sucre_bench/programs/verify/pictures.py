"""The pictures of a bundle: restored images with their holes, views and references."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode_bytes
from sucre_bench.results.bundle_format import Bundle
from sucre_bench.results.layout import possible_places
from sucre_bench.results.water_file import water_of
from sucre_bench.scene import Restoration

_PNG, _JPEG = b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff"
_TRUTH = "true_water"  # in a record it is what the bundle says; metrics get that of the data


@dataclass(frozen=True)
class Held:
    """The names in a bundle of a restored image, its record, view and reference; "" for what it lacks."""

    restored: str
    record: str
    view: str
    reference: str


def held(bundle: Bundle, row: Any) -> Held | None:
    """Return what a bundle holds of the restoration that a row stands for; None without the restored image."""
    root = Path()

    def there(path: Path) -> str:
        return path.as_posix() if path.as_posix() in bundle.inside else ""

    for place in possible_places(row.dataset, row.scene, row.view):
        image = place.restored(root, row.method)
        if there(image):
            record, view, reference = image.with_suffix(".json"), place.original(root), place.reference(root)
            return Held(image.as_posix(), there(record), there(view), there(reference))
    return None


def picture(bundle: Bundle, name: str) -> Array:
    """Return a picture of a bundle, (H, W, 3) float32 RGB in [0, 1]. InputError if it is none of ordinary size.

    A restored image is a PNG; views and references may be JPEG files, which are not exact.
    """
    import cv2

    content = bundle.read(name)
    if not content.startswith(_PNG if name.endswith(".png") else (_PNG, _JPEG)):
        raise InputError(f"{name}: is no PNG or JPEG", bundle.path, "ask who made the bundle for another")
    try:
        stored = decode_bytes(content, cv2.IMREAD_COLOR, name)[..., ::-1]
    except InputError as fault:
        raise fault.within(bundle.path) from fault
    return np.asarray(stored, dtype=np.float32) / 255


@dataclass(frozen=True, eq=False)
class Restored:
    """A restoration as far as a bundle holds it.

    restoration: its image is the restored image, NaN = a hole, and its water and `info` are those of the record;
    is_sure: whether it is known which black pixels are holes.
    """

    restoration: Restoration
    is_sure: bool


def restoration_of(bundle: Bundle, names: Held, n_coloured: int) -> Restored:
    """Return a restoration. n_coloured: how many pixels have a colour, as its row says.

    Raises InputError for a picture or record that cannot be read, and for one that does not fit the row.
    """
    image = picture(bundle, names.restored)
    black = (image == 0).all(axis=-1)
    holes = black.size - n_coloured
    if not 0 <= holes <= black.sum():
        raise InputError(
            f"{names.restored}: {black.size - int(black.sum())} pixels have a colour, the score table says "
            f"{n_coloured}",
            bundle.path,
            "ask who made the bundle",
        )
    if holes:
        image = np.where(black[..., None], np.float32(np.nan), image)
    record = _record(bundle, names.record) if names.record else {}
    water = water_of(record, bundle.path / names.record)
    return Restored(
        Restoration(image, water, info={k: v for k, v in record.items() if k != _TRUTH}), holes in (0, int(black.sum()))
    )


def _record(bundle: Bundle, name: str) -> dict[str, Any]:
    try:
        told = json.loads(bundle.read(name))
    except (ValueError, RecursionError) as fault:
        raise InputError(f"{name}: is no JSON", bundle.path, "ask who made the bundle for another") from fault
    return told if isinstance(told, dict) else {}
