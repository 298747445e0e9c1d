"""Reads the headers of image files: size, further pictures, transparency. It decodes no pixel."""

import itertools
import logging
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import IO, Any

from sucre_bench.errors import InputError
from sucre_bench.machine.files import regular

_ANIMATED = ("PNG", "WEBP")  # a JPEG's further pictures are previews, or the second lens of a camera
_REDUCED, _MASK = 1, 4  # bits of a TIFF page's NewSubfileType
_PLANES = 2  # the value of a TIFF's PlanarConfiguration
_MOST_PAGES = 100  # that are looked at


@dataclass(frozen=True, slots=True)
class Header:
    """What the header of an image file says.

    size: (width, height) of the first picture; has_more: whether there are others, besides thumbnails and masks;
    is_thumbnail: whether the first picture is one; has_alpha: whether pixels may be transparent; has_planes: whether a
    TIFF stores each channel as a picture of its own.
    """

    size: tuple[int, int]
    has_more: bool = False
    is_thumbnail: bool = False
    has_alpha: bool = False
    is_tiff: bool = False
    has_planes: bool = False

    def check(self, place: object) -> None:
        """Raise InputError if the file's picture is not known. place: the file."""
        if self.is_thumbnail:
            raise InputError("begins with a thumbnail", place, "save its picture as the only one of a file")
        if self.has_more:
            raise InputError("holds several pictures", place, "save the wanted one as a file of its own")


def read_header(file: IO[bytes]) -> Header | None:
    """Return what the header of an open file says; None where it cannot be read, which decoding will explain."""
    try:
        is_tiff = file.read(2) in (b"II", b"MM")
        file.seek(0)
        return _of_tiff(file) if is_tiff else _of_other(file)
    except Exception:  # of any kind: each format has its own
        return None


def begins_like_jpeg(content: bytes) -> bool:
    """Whether a file's first bytes are those of a JPEG."""
    return content.startswith(b"\xff\xd8")


def is_jpeg(path: Path) -> bool:
    """Whether a file is a JPEG, whatever its suffix; False where it cannot be read, which decoding will explain."""
    try:
        with regular(path).open("rb") as file:
            return begins_like_jpeg(file.read(2))
    except (OSError, InputError):
        return False


def tiff_file(file: IO[bytes]) -> Any:
    """Open a TIFF with tifffile, which else writes about faults to the terminal."""
    import tifffile

    logging.getLogger("tifffile").setLevel(logging.CRITICAL)
    return tifffile.TiffFile(file)


def pillow() -> ModuleType:
    """Pillow's images, without its own limit of pixels: `pixel_limit` has ours."""
    from PIL import Image

    Image.MAX_IMAGE_PIXELS = None
    return Image


def _of_tiff(file: IO[bytes]) -> Header:
    """Not by Pillow, which does not know 16-bit colour there."""
    with tiff_file(file) as tiff:
        first = tiff.pages.first
        has_more = any(not _is_extra(page, first) for page in itertools.islice(tiff.pages, 1, _MOST_PAGES))
        size = first.imagewidth, first.imagelength
        has_alpha = any(int(kind) in (1, 2) for kind in first.extrasamples)
        has_planes = first.samplesperpixel > 1 and int(first.planarconfig) == _PLANES
        is_thumbnail = bool(first.subfiletype & (_REDUCED | _MASK))
        return Header(size, has_more, is_thumbnail, has_alpha, is_tiff=True, has_planes=has_planes)


def _is_extra(page: Any, first: Any) -> bool:
    """Whether a page is a thumbnail, a step of a pyramid or a mask: it says so, or is smaller than the first one."""
    is_smaller = page.imagewidth < first.imagewidth and page.imagelength < first.imagelength
    return is_smaller or bool(page.subfiletype & (_REDUCED | _MASK))


def _of_other(file: IO[bytes]) -> Header:
    with pillow().open(file) as image:
        has_more = image.format in _ANIMATED and getattr(image, "n_frames", 1) > 1
        has_alpha = "A" in image.mode or "transparency" in image.info
        return Header(image.size, has_more, False, has_alpha)
