"""Reads images, 8- or 16-bit PNG, TIFF or JPEG, to RGB in [0, 1], and arrays in .npy, .npz and TIFF; writes images.

The pixels are taken as they lie in the file, as COLMAP does: `orientation` turns one of a pair. Sizes are read
from headers first, so that a wrong or hostile file of a few bytes does not fill the memory.
"""

import io
import itertools
import logging
import math
import os
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np

from sucre_bench.arrays import AnyArray, Array, Size
from sucre_bench.errors import DamagedFileError, InputError, file_error, in_words
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.machine.files import (
    frames_of,
    open_atomically,
    reading,
    regular,
    write_atomically,
)
from sucre_bench.machine.progress import say

# of what is taken for an image in a folder
SUFFIXES = (
    ".png",
    ".jpg",
    ".jpeg",
    ".tif",
    ".tiff",
    ".bmp",
    ".webp",
)

PICTURE_READERS = ("cv2", "PIL", "tifffile")  # the packages that read these files

# The environment variable of the most megapixels that a picture may have, and its default: two of the largest cameras'
# pictures. The most bytes a pixel: four channels of 32 bits.
_LIMIT = "SUCRE_BENCH_MAX_MEGAPIXELS"
_MEGAPIXELS = 250.0
_BYTES = 16

_JPEG = b"\xff\xd8"  # its first bytes
# a JPEG's further pictures are previews, or the second lens of a camera
_ANIMATED = (
    "PNG",
    "WEBP",
)
_REDUCED_OR_MASK = 1 | 4  # bits of a TIFF page's NewSubfileType
_ALPHA = (1, 2)  # multiplied and straight, in a TIFF's ExtraSamples
# channels of gray (0 is black) and of RGB, by a TIFF's PhotometricInterpretation
_COLOURS = {
    1: 1,
    2: 3,
}
_PLANES = 2  # a TIFF's PlanarConfiguration
_ICC = 34675  # the tag of a TIFF
_FEW_BITS = 14  # of raw converters


def png_chunk(content: bytes) -> bytes:
    """Return a part of a PNG file. content: its type, four letters, and its data."""
    return (
        struct.pack(">I", len(content) - 4) + content + struct.pack(">I", zlib.crc32(content))
    )


# bytes at the beginning of a PNG file, up to its first chunk that may be left out
PNG_HEADER = 33
OF_JPEG = png_chunk(b"tEXtSource\0JPEG")  # of a picture that was decoded from a JPEG file


def image_size(file: Path | bytes) -> Size | None:
    """Return (width, height) from the header of a file or its content; None where decoding will say what is wrong."""
    try:
        with (
            io.BytesIO(file) if isinstance(file, bytes) else regular(file).open("rb") as opened
        ):
            header = _header(opened)
    except (OSError, InputError):
        return None
    return header.size if header else None


def first_size(files: Iterable[Path]) -> Size | None:
    """Return the size (width, height) of the first file whose header can be read; None if none can."""
    return next((size for file in files if (size := image_size(file))), None)


def is_jpeg(path: Path) -> bool:
    """Whether a file is a JPEG, whatever its suffix, or a PNG that says it was made of one.

    False where it cannot be read, which decoding will explain.
    """
    try:
        with regular(path).open("rb") as file:
            head = file.read(PNG_HEADER + len(OF_JPEG))
            return head.startswith(_JPEG) or head[PNG_HEADER:] == OF_JPEG
    except (OSError, InputError):
        return False


def same_shape(one: Size, other: Size) -> bool:
    """Whether two sizes (width, height) differ by scale only: to 1 % of the aspect ratio, or to a pixel's rounding.

    A pixel's rounding is at most an eighth of a height: a picture of one pixel has no shape.
    """
    (width, height), (wide, high) = sorted((one, other))
    return abs(high * width / wide - height) <= max(min(1.0, height / 8), 0.01 * height)


def check_pixels(place: object, shape: Sequence[int], channels: int = 1) -> None:
    """Raise InputError if an array of a shape has more values than so many channels of the largest picture.

    The largest picture has SUCRE_BENCH_MAX_MEGAPIXELS of the environment, by default 250 megapixels.
    """
    n = math.prod(shape)
    if n > channels * _most_pixels():
        needed = -(-n // channels // 1_000_000)
        raise InputError(
            f"is {'x'.join(map(str, shape))}, more than {_most_pixels() / 1e6:g} megapixels",
            place,
            f"if that is right, set {_LIMIT}={needed} before the command",
        )


def _most_pixels() -> int:
    """Raises InputError if the environment's limit is no number above 0."""
    text = os.environ.get(_LIMIT, "")
    try:
        limit = float(text or _MEGAPIXELS)
    except ValueError:
        limit = 0
    if not limit > 0:
        raise InputError(
            f"{_LIMIT}: '{text}' is no number above 0; give megapixels, for example 1000"
        )
    return int(min(limit, 1e9) * 1e6)


def read_bgr(path: Path) -> AnyArray:
    """Return an image (H, W, 3) uint8 or uint16, BGR. Raises InputError if it cannot be read, or has other bits."""
    import cv2

    stored = decode(
        path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION
    )
    if stored.dtype not in (np.uint8, np.uint16):
        raise InputError(f"is {stored.dtype}", path, "save it with 8 or 16 bits a channel")
    return stored


def read_bgr_8bit(path: Path) -> AnyArray:
    """Return an image (H, W, 3) uint8, BGR, of 16 bits rounded. Raises as `read_bgr`."""
    stored = read_bgr(path)
    return stored if stored.dtype == np.uint8 else to_8bit(to_unit(stored))


def read_rgb(path: Path, size: Size | None = None) -> Array:
    """Return an image (H, W, 3) float32 RGB in [0, 1], shrunk to `size` (width, height) by area if one is given.

    Gray is repeated over the channels, transparency dropped. Raises InputError if the file cannot be read, does not
    have 8 or 16 bits, or has a size that does not shrink to `size`.
    """
    stored = read_bgr(path)
    if stored.dtype == np.uint16 and 0 < (largest := int(stored.max(initial=0))) < 2**_FEW_BITS:
        fault = f"no value of {path.name} is above {largest}, of 65535, so it is read as dark"
        remedy = f"if the camera has {_FEW_BITS} bits or fewer, scale its values to 16 bits"
        say_once_a_folder(path, "bits", f"{fault}; {remedy}")
    return resized(to_unit(stored[..., ::-1]), size, path)


def to_unit(levels: AnyArray) -> Array:
    """Return an image of uint8 or uint16 as float32 in [0, 1], its rows one after the other in memory."""
    return np.divide(levels, np.float32(np.iinfo(levels.dtype).max), order="C")


def resized(image: Array, size: Size | None, path: Path) -> Array:
    """Return an image (H, W, 3), shrunk to `size` (width, height) by area if one is given. Raises as `read_rgb`."""
    import cv2

    height, width = image.shape[:2]
    if size is None or (width, height) == size:
        return image
    if width < size[0] or height < size[1] or not same_shape((width, height), size):
        raise InputError(
            f"is {width}x{height}, expected {size[0]}x{size[1]}",
            path,
            "resize it or the others",
        )
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def decode(path: Path, flags: int) -> np.ndarray:
    """Return what OpenCV makes of a file by its flags, channels in BGR order. A JPEG always has 8 bits, and three
    channels unless gray is asked for. FileError when it is unreadable, DamagedFileError when it is incomplete.
    """
    try:
        if regular(path).stat().st_size > _BYTES * _most_pixels():
            raise InputError(
                f"is larger than any image of {_most_pixels() / 1e6:g} megapixels",
                path,
                "copy it again",
            )
        data = path.read_bytes()
    except OSError as fault:
        raise file_error(path, fault, "copy the file again") from fault
    return decode_bytes(data, flags, str(path))


def decode_bytes(data: bytes, flags: int, place: str) -> np.ndarray:
    """Return what `decode` does, of a file's content. place: the file's name, for errors."""
    import cv2

    header = _header(io.BytesIO(data))
    if header is None:  # OpenCV might still allocate what a damaged header says
        raise DamagedFileError(
            "cannot be read, damaged or not an image",
            place,
            frames_of(place) or "copy it again",
        )
    check_pixels(place, header.size)
    if header.has_more:
        raise InputError(
            "holds several pictures", place, "save the wanted one as a file of its own"
        )
    wants_colours = bool(flags & cv2.IMREAD_COLOR)  # IMREAD_UNCHANGED has it, too
    try:
        data = _unturned(data) if header.is_tiff else data
        stored = np.frombuffer(data, np.uint8)
        if data.startswith(_JPEG):  # OpenCV may fill up a cut JPEG with gray, Pillow does not
            with _pillow().open(io.BytesIO(data)) as image:
                mode = "RGB" if wants_colours else "L"
                values = np.asarray(image if image.mode == mode else image.convert(mode))
                return values[..., ::-1] if wants_colours else values
        if data.startswith(b"\x89PNG") and b"IEND" not in data[-4096:]:
            raise ValueError("cut short")
        decoded: Any = None
        if wants_colours and flags != cv2.IMREAD_UNCHANGED and header.is_changed:
            decoded = (
                _tiff_colours(data, place)
                if header.is_tiff
                else cv2.imdecode(stored, cv2.IMREAD_UNCHANGED)
            )
            decoded = (
                _without_alpha(decoded, place)
                if header.is_tiff or decoded.shape[2:] == (4,)
                else None
            )
        decoded = cv2.imdecode(stored, flags) if decoded is None else decoded
        if decoded is None:
            raise ValueError("damaged")
    except InputError:
        raise
    except Exception as fault:  # each of the decoders has its own
        raise DamagedFileError(
            f"cannot be read, {in_words(fault)}", place, "copy the file again"
        ) from fault
    return np.asarray(decoded)


def _unturned(data: bytes) -> bytes:
    """A TIFF without its orientation: OpenCV turns the pixels of a TIFF, whatever its flags."""
    with _tiff_file(io.BytesIO(data)) as file:
        tag = file.pages.first.tags.get("Orientation")
        if tag is None or tag.value == 1:
            return data
        upright = (1).to_bytes(2, "little" if file.byteorder == "<" else "big")
        return data[: tag.valueoffset] + upright + data[tag.valueoffset + 2 :]


def _tiff_colours(data: bytes, place: str) -> AnyArray:
    """A TIFF's (H, W, 3 or 4): BGR as it is stored, and its alpha if it has one. Raises InputError if it has none."""
    with _tiff_file(io.BytesIO(data)) as file:
        page = file.pages.first
        check_pixels(place, page.shape, channels=4)
        try:
            values = np.asarray(page.asarray())
            values = (
                np.moveaxis(values, 0, -1)
                if page.planarconfig == _PLANES and values.ndim == 3
                else values
            )
            values = values.reshape(page.imagelength, page.imagewidth, page.samplesperpixel)
            n = _COLOURS[page.photometric]
        except Exception as fault:
            # a compression that needs another package, LZW say, or a damaged file
            form = "has transparency or planes in a form that cannot be read"
            raise InputError(form, place, "save it without transparency, or as PNG") from fault
        alpha = [i for i, kind in enumerate(page.extrasamples, n) if kind in _ALPHA][:1]
        return values[..., ([2, 1, 0] if n == 3 else [0, 0, 0]) + alpha]


def _without_alpha(stored: AnyArray, place: str) -> AnyArray:
    """BGR without the alpha that OpenCV would multiply by."""
    bgr, alpha = stored[..., :3], stored[..., 3:]
    if alpha.dtype.kind == "u" and (n := int((alpha < np.iinfo(alpha.dtype).max).sum())):
        fault = f"{n} pixels of {Path(place).name} are transparent, and read with the colours stored there"
        say_once_a_folder(
            Path(place),
            "alpha",
            f"{fault}; save it without transparency if these are not right",
        )
    return bgr


_said: set[tuple[Path, str]] = set()


def say_once_a_folder(path: Path, about: str, text: str) -> None:
    """Say what may not be as the owner of a folder's images means it."""
    if (path.parent, about) not in _said:
        _said.add((path.parent, about))
        say(f"{path.parent}: {text}")


@dataclass(frozen=True, slots=True)
class _Header:
    """What the header of an image file says."""

    size: Size
    """Width and height of the first picture."""

    has_more: bool
    """Whether there are other pictures, besides thumbnails and masks."""

    is_tiff: bool

    is_changed: bool
    """Whether OpenCV would change its colours, which have alpha or separate planes."""


def _header(file: IO[bytes]) -> _Header | None:
    """What the header of an open file says; None where it cannot be read."""
    try:
        is_tiff = file.read(2) in (b"II", b"MM")
        file.seek(0)
        if not is_tiff:
            with _pillow().open(file) as image:
                has_more = image.format in _ANIMATED and getattr(image, "n_frames", 1) > 1
                has_alpha = "A" in image.mode or "transparency" in image.info
                return _Header(image.size, has_more, False, has_alpha)
        with _tiff_file(file) as tiff:  # not by Pillow, which does not know 16-bit colour there
            first, *others = itertools.islice(tiff.pages, 100)
            width, height = first.imagewidth, first.imagelength
            has_more = bool(others and first.subfiletype & _REDUCED_OR_MASK) or any(
                not (
                    page.subfiletype & _REDUCED_OR_MASK
                    or (page.imagewidth < width and page.imagelength < height)
                )
                for page in others
            )
            is_changed = any(kind in _ALPHA for kind in first.extrasamples)
            is_changed |= first.samplesperpixel > 1 and first.planarconfig == _PLANES
            return _Header((width, height), has_more, True, is_changed)
    except Exception:  # of any kind: each format has its own
        return None


def _tiff_file(file: IO[bytes]) -> Any:
    """Open a TIFF with tifffile, which else writes about faults to the terminal."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    return tifffile.TiffFile(file)


def _pillow() -> ModuleType:
    """Pillow's images, without its own limit of pixels: `check_pixels` has ours."""
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    return Image


def metadata_of(path: Path) -> tuple[Any, dict[str, Any]]:
    """Return the EXIF tags of a picture, and what Pillow says besides, "icc_profile" for example.

    Raises errors of any kind if the file cannot be read. The pixels are not decoded.
    """
    tags, info = _pillow().Exif(), dict[str, Any]()
    with regular(path).open("rb") as file:
        if file.read(2) in (b"II", b"MM"):
            file.seek(0)
            tags.load_from_fp(file)
            info |= {"icc_profile": bytes(tags[_ICC])} if _ICC in tags else {}
        else:
            with _pillow().open(file) as image:
                info = image.info
            tags.load(info.get("exif", b""))
    return tags, info


def read_tiff(path: Path) -> np.ndarray:
    """Return what a TIFF holds, channels in RGB order.

    Raises InputError if it has too many values, see `check_pixels`, and errors of any kind if it cannot be read.
    """
    with regular(path).open("rb") as content, _tiff_file(content) as file:
        check_pixels(path, file.series[0].shape, channels=4)
        return np.asarray(file.asarray())


def read_array(path: Path, choose: Callable[[list[str]], str] | None = None) -> np.ndarray:
    """Return the array of an .npy, or with `choose` that of an .npz whose name it returns, of all names there.

    Raises FileError if it cannot be read, DamagedFileError if it is not whole, and InputError if it has too many
    values, see `check_pixels`.
    """
    with reading(path, "write it again with numpy.save"):
        if not zipfile.is_zipfile(regular(path)):
            # a false size allocates no memory
            mapped = np.lib.format.open_memmap(path, mode="r")
            check_pixels(path, mapped.shape, channels=4)
            return np.array(mapped)
        if choose is None:
            raise ValueError("an archive, not an array")
        with np.load(path, allow_pickle=False) as archive:
            name = choose(archive.files)
            check_pixels(path, (archive.zip.getinfo(f"{name}.npy").file_size,), channels=_BYTES)
            values: np.ndarray = archive[name]
            check_pixels(path, values.shape, channels=4)
            return values


def encode_png(values: AnyArray, compression: int = 3) -> memoryview:
    """Return gray, BGR or BGRA values, 8 or 16 bit, as the bytes of a PNG file. compression: 0 (fast) to 9 (small).

    They are OpenCV's own, since a copy may have 300 MB.
    """
    import cv2

    return cv2.imencode(".png", values, [cv2.IMWRITE_PNG_COMPRESSION, compression])[1].data


def write_png(path: Path, values: AnyArray, compression: int = 3, chunk: bytes = b"") -> None:
    """Write gray, BGR or BGRA values, 8 or 16 bit. compression: 0 (fast) to 9 (small).

    chunk: stands behind the header, for example `OF_JPEG`.
    Raises OutputError if the file cannot be written.
    """
    png = encode_png(values, compression)
    with open_atomically(path) as file:
        file.writelines((png[:PNG_HEADER], chunk, png[PNG_HEADER:]))


def write_image(path: Path, values: AnyArray) -> None:
    """Write gray or BGR values, 8 bit, in the format of the path's suffix, see `SUFFIXES`."""
    import cv2

    write_atomically(path, cv2.imencode(path.suffix, values)[1].data)
