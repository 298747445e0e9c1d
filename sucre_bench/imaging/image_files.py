"""Reads image files: 8- or 16-bit PNG, TIFF or JPEG to RGB in [0, 1].

The pixels are taken as they lie in the file, as COLMAP does: an orientation noted in EXIF is ignored.
"""

import io
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.errors import DamagedFileError, InputError, file_error
from sucre_bench.imaging.image_header import Header, begins_like_jpeg, pillow, read_header, tiff_file
from sucre_bench.imaging.image_notes import note_alpha, note_few_bits
from sucre_bench.imaging.pixel_limit import check_array, check_pixels, most_pixels
from sucre_bench.imaging.read_tiff import Stored, read_stored
from sucre_bench.machine.files import regular, write_atomically

_MOST_BYTES_A_PIXEL = 16  # four channels of 32 bits
SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".webp")  # of what is taken for an image in a folder


def image_size(path: Path) -> tuple[int, int] | None:
    """Return (width, height) from the file's header; None where that cannot be read, which decoding will explain."""
    try:
        with regular(path).open("rb") as file:
            return _size_in(file)
    except (OSError, InputError):
        return None


def size_of_only_page(path: Path) -> tuple[int, int] | None:
    """Return what `image_size` does; None for a TIFF of several pages, which may be layers of one array."""
    try:
        with regular(path).open("rb") as file:
            is_tiff = file.read(2) in (b"II", b"MM")
            file.seek(0)
            if is_tiff and len(tiff_file(file).pages) != 1:
                return None
            file.seek(0)
            return _size_in(file)
    except Exception:  # of any kind: decoding says what is wrong
        return None


def _size_in(file: IO[bytes]) -> tuple[int, int] | None:
    """The size that a file's header says."""
    header = read_header(file)
    return header.size if header else None


def read_tiff(path: Path) -> np.ndarray:
    """Return what a TIFF holds, channels in RGB order.

    Raises InputError if it has too many values, see `pixel_limit`, and errors of any kind if it cannot be read.
    """
    with regular(path).open("rb") as content, tiff_file(content) as file:
        check_array(path, file.series[0].shape)
        return np.asarray(file.asarray())


def same_shape(one: tuple[int, int], other: tuple[int, int]) -> bool:
    """Whether two sizes (width, height) differ by scale only: to 1 % of the aspect ratio, or to a pixel's rounding.

    A pixel's rounding is at most an eighth of a height: a picture of one pixel has no shape.
    """
    (width, height), (wide, high) = sorted((one, other))
    return abs(high * width / wide - height) <= max(min(1.0, height / 8), 0.01 * height)


def read_rgb(path: Path, size: tuple[int, int] | None = None) -> Array:
    """Return an image (H, W, 3) float32 RGB in [0, 1], shrunk to `size` (width, height) by area if one is given.

    Gray is repeated over the channels, transparency dropped. Raises InputError if the file cannot be read, does not
    have 8 or 16 bits, or has a size that does not shrink to `size`.
    """
    import cv2

    if size is not None and (found := image_size(path)) is not None:
        _check_shrinks(path, found, size)
    stored = decode(path, cv2.IMREAD_COLOR | cv2.IMREAD_ANYDEPTH | cv2.IMREAD_IGNORE_ORIENTATION)
    if stored.dtype not in (np.uint8, np.uint16):
        raise InputError(f"is {stored.dtype}", path, "save it with 8 or 16 bits a channel")
    note_few_bits(path, stored)
    image = stored[..., ::-1].astype(np.float32) / np.iinfo(stored.dtype).max
    height, width = image.shape[:2]
    if size is None or (width, height) == size:
        return image
    _check_shrinks(path, (width, height), size)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA))


def _check_shrinks(path: Path, found: tuple[int, int], size: tuple[int, int]) -> None:
    """Raise InputError unless an image of its own size (width, height) shrinks to another."""
    if found[0] < size[0] or found[1] < size[1] or not same_shape(found, size):
        raise InputError(f"is {found[0]}x{found[1]}, expected {size[0]}x{size[1]}", path, "resize it or the others")


def decode(path: Path, flags: int) -> np.ndarray:
    """Return what OpenCV makes of a file by its flags, channels in BGR order; a JPEG always has 8 bits, and three
    channels unless gray is asked for. FileError when it is unreadable, DamagedFileError when it is incomplete.
    """
    try:
        if regular(path).stat().st_size > _MOST_BYTES_A_PIXEL * most_pixels():
            raise InputError(f"is larger than any image of {most_pixels() / 1e6:g} megapixels", path, "copy it again")
        data = path.read_bytes()
    except OSError as fault:
        raise file_error(path, fault, "copy the file again") from fault
    return decode_bytes(data, flags, str(path))


def decode_bytes(data: bytes, flags: int, place: str) -> np.ndarray:
    """Return what `decode` does, of a file's content. place: the file's name, for errors."""
    import cv2

    header = read_header(io.BytesIO(data))
    if header is None:  # OpenCV might still allocate what a damaged header says
        raise DamagedFileError("cannot be read, damaged or not an image", place, "copy it again")
    check_pixels(place, header.size)
    header.check(place)
    if begins_like_jpeg(data):  # OpenCV may fill up a cut JPEG with gray, Pillow does not
        try:
            with pillow().open(io.BytesIO(data)) as image:
                if not flags & cv2.IMREAD_COLOR:  # a bit that is set in IMREAD_UNCHANGED, too
                    return np.asarray(image.convert("L"))
                return np.asarray(image.convert("RGB"))[..., ::-1]
        except Exception as fault:  # each of its decoders has its own
            reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else fault
            raise DamagedFileError(f"cannot be read, {reason}", place, "copy the file again") from fault
    complete = not data.startswith(b"\x89PNG") or b"IEND" in data[-4096:]
    try:
        decoded = _imdecode(data, flags, place, header) if data and complete else None
    except cv2.error:
        decoded = None
    if decoded is None:
        how = "damaged" if complete else "cut short"
        raise DamagedFileError(f"cannot be read, {how}", place, "copy it again")
    return np.asarray(decoded)


def _imdecode(data: bytes, flags: int, place: str, header: Header) -> Any:
    """What OpenCV makes of a file; None if it cannot. Transparent pixels keep their colours if colours are wanted."""
    import cv2

    content = np.frombuffer(data, dtype=np.uint8)
    stored = None
    if flags != cv2.IMREAD_UNCHANGED and flags & cv2.IMREAD_COLOR:
        if header.is_tiff and (header.has_alpha or header.has_planes):
            stored = read_stored(data, place)
        elif header.has_alpha:
            values = cv2.imdecode(content, cv2.IMREAD_UNCHANGED)
            if values is not None and values.shape[2:] == (4,):
                stored = Stored(values[..., :3], values[..., 3])
    if stored is None:
        return cv2.imdecode(content, flags)
    if not flags & cv2.IMREAD_ANYDEPTH:
        return (stored.bgr >> 8).astype(np.uint8) if stored.bgr.dtype == np.uint16 else stored.bgr
    if stored.alpha is not None and stored.alpha.dtype.kind == "u":  # the reader refuses others
        note_alpha(place, stored.alpha)
    return stored.bgr


def encode_png(values: npt.NDArray[Any], compression: int = 3) -> bytes:
    """Return gray, BGR or BGRA values, 8 or 16 bit, as a PNG file. compression: 0 (fast) to 9 (small)."""
    import cv2

    return bytes(cv2.imencode(".png", values, [cv2.IMWRITE_PNG_COMPRESSION, compression])[1])


def write_png(path: Path, values: npt.NDArray[Any], compression: int = 3) -> None:
    """Write gray, BGR or BGRA values, 8 or 16 bit. compression: 0 (fast) to 9 (small).

    Raises OutputError if the file cannot be written.
    """
    write_atomically(path, encode_png(values, compression))


def write_image(path: Path, values: npt.NDArray[Any]) -> None:
    """Write gray or BGR values, 8 bit, in the format of the path's suffix, see `SUFFIXES`."""
    import cv2

    write_atomically(path, bytes(cv2.imencode(path.suffix, values)[1]))
