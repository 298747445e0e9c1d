"""Reads a restored image that another program wrote, and the water beside it.

8- and 16-bit files are divided by 255 and 65535; floating ones, .npy, .npz and .tif, are taken as they are. Arrays are
(H, W, 3) in RGB order, those with a fourth channel have their transparency there; an .npz holds one, or several and
one called "image".
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.errors import InputError
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.image_files import decode, read_array, read_tiff, same_shape, size_of_only_page
from sucre_bench.results.water_file import read_water
from sucre_bench.scene import Encoding, View, Water

FileEncoding = Literal["view", "gamma", "linear"]
Holes = Literal["alpha", "black", "none"]

# A restoration may exceed 1, but half of its values do not exceed 2; those of 0 to 255 do.
_MOST_MEDIAN = 2.0


@dataclass(frozen=True)
class Reading:
    """How restored images are to be read; each of its options means what `Precomputed` says of it."""

    encoding: FileEncoding
    holes: Holes
    resize: bool

    def image(self, path: Path, view: View) -> tuple[Array, dict[str, Any]]:
        """Return a view's restored image, (H, W, 3) float32 in the view's encoding, NaN in holes, and what was done.

        Raises InputError where it cannot be read, has no pixel with a colour, or is not of the view's size.
        """
        if (found := size_of_only_page(path)) is not None:
            self._check_size(view, found, path)
        image, transparent = _colours(path)
        holes = ~np.isfinite(image).all(axis=-1)
        if self.holes != "none":
            holes |= transparent
        if self.holes == "black":
            holes |= (image == 0).all(axis=-1)
        if holes.all():
            raise InputError(f"{path}: no pixel has a colour; see method.holes, {self.holes} here")
        image[holes] = np.nan
        image = converted(image, encoding_of(self.encoding, view), view.encoding).astype(np.float32)
        return self._at_size_of(view, image, path)

    def _at_size_of(self, view: View, image: Array, path: Path) -> tuple[Array, dict[str, Any]]:
        import cv2

        height, width = view.rgb.shape[:2]
        found = (image.shape[1], image.shape[0])
        if found == (width, height):
            return image, {}
        self._check_size(view, found, path)
        # A pixel that is mixed from a hole and its neighbours becomes a hole too: NaN spreads.
        how = cv2.INTER_AREA if found[0] > width else cv2.INTER_LINEAR
        return np.asarray(cv2.resize(image, (width, height), interpolation=how)), {"resized_from": list(found)}

    def _check_size(self, view: View, found: tuple[int, int], path: Path) -> None:
        """Raise InputError unless an image of its own size (width, height) is of the view's size, or may be resized."""
        height, width = view.rgb.shape[:2]
        sizes = f"is {found[0]}x{found[1]}, the view is {width}x{height}"
        if not same_shape(found, (width, height)):
            raise InputError(f"{path}: {sizes}, another shape; restore the view as it is, uncropped")
        if found != (width, height) and not self.resize:
            raise InputError(f"{path}: {sizes}; restore it at that size, or give method.resize=true")


def encoding_of(encoding: FileEncoding, view: View) -> Encoding:
    """Return the encoding of a view's files."""
    return view.encoding if encoding == "view" else encoding


def water_beside(path: Path, files: FileEncoding, view: View) -> Water | None:
    """Return the water that ``a.json`` beside ``a.png`` holds as B and, if known, beta and gamma; None without.

    It explains intensities of the "encoding" that it names, as the files are encoded where it names none.
    Raises what `read_water` raises.
    """
    beside = path.with_suffix(".json")
    water = read_water(beside) if beside.is_file() else None
    return water and replace(water, encoding=water.encoding or encoding_of(files, view))


def _colours(path: Path) -> tuple[Array, Mask]:
    """An image file as (H, W, 3) float32, RGB, and where it is transparent."""
    stored = _stored(path)
    if stored.ndim == 2:
        stored = stored[..., None]
    if stored.ndim != 3 or stored.shape[2] not in (1, 3, 4) or not stored.size:
        shape = "x".join(map(str, stored.shape))
        raise InputError(f"{path}: is an array of {shape}; expected height x width x 3, colours in RGB order")
    if stored.dtype.kind == "f":
        with np.errstate(over="ignore"):  # what float32 cannot hold is a hole
            values = stored.astype(np.float32)
        some = values[..., :3].reshape(-1)[:: max(1, values.size // 1_000_000)]
        if (some > _MOST_MEDIAN).sum() > some.size / 2:
            raise InputError(f"{path}: half of its values exceed {_MOST_MEDIAN:g}; divide them so that white is 1")
    elif stored.dtype in (np.uint8, np.uint16):
        values = stored.astype(np.float32) / np.float32(np.iinfo(stored.dtype).max)
    else:
        raise InputError(f"{path}: is {stored.dtype}; save it with 8 or 16 bits a channel, or as floats")
    transparent = values[..., 3] == 0 if values.shape[2] == 4 else np.zeros(values.shape[:2], dtype=bool)
    colours = values.repeat(3, axis=2) if values.shape[2] == 1 else values[..., :3].copy()
    return colours, transparent


def _stored(path: Path) -> np.ndarray:
    """What a file holds, channels in RGB order."""
    import cv2

    suffix = path.suffix.lower()
    if suffix in (".npy", ".npz"):
        return _array(path)
    if suffix in (".tif", ".tiff") and (values := _tiff(path)) is not None:
        return values
    values = decode(path, cv2.IMREAD_UNCHANGED)
    return values if values.ndim == 2 else values[..., [2, 1, 0, 3][: values.shape[2]]]


def _array(path: Path) -> np.ndarray:
    return read_array(path, lambda names: "image" if "image" in names or len(names) != 1 else names[0])


def _tiff(path: Path) -> np.ndarray | None:
    """What a TIFF holds; None where another reader is to try, or to say what is wrong.

    OpenCV multiplies 8-bit colours by their transparency, and splits float images into pages.
    """
    try:
        return read_tiff(path)
    except InputError:
        raise
    except Exception:  # of any kind: each of its decoders has its own
        return None
