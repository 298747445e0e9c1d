"""A restored picture as a file of its photograph's format, with the photograph's metadata.

EXIF, GPS, maker notes, XMP, IPTC and the colour profile stay as they are: survey software reads places and lenses
there. Only the preview of the photograph is left out, because it shows the colours of before. JPEG and PNG files keep
the photograph's own segments and chunks, byte for byte. A TIFF keeps its tags.
"""

import io
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from PIL import Image, TiffTags
from PIL.ExifTags import IFD

from sucre_bench.errors import ANY_FAULT
from sucre_bench.imaging.image_files import encode_png
from sucre_bench.machine.files import regular

_PNG = b"\x89PNG\r\n\x1a\n"
# Chunks of a PNG that describe its pixels and not the photograph.
_OF_PIXELS = {
    b"IHDR",
    b"PLTE",
    b"IDAT",
    b"IEND",
    b"tRNS",
    b"bKGD",
    b"hIST",
    b"sBIT",
    b"sPLT",
    b"acTL",
}
_EXIF = b"Exif\x00\x00"
_ICC = b"ICC_PROFILE\x00"
_MULTI = b"MPF\x00"
_START_OF_SCAN = 0xDA
_COMMENT = 0xFE
_EXIF_MARKER = 0xE1
_ADOBE = 0xEE
_RGB_PROFILE = slice(16, 20)  # bytes of an ICC profile that name the colours it is for
# Tags of a TIFF: what says where and how its pixels are stored, and the resolution of previews.
_SIDES = 256
_BITS = 258
_COMPRESSION = 259
_COLOURS = 262
_OFFSETS = 273
_SAMPLES = 277
_ROWS = 278
_COUNTS = 279
_STORED = {
    254,
    255,
    256,
    257,
    258,
    259,
    262,
    266,
    273,
    277,
    278,
    279,
    284,
    317,
    320,
    322,
    323,
    324,
    325,
    330,
    338,
    339,
    347,
    512,
    513,
    514,
    530,
    531,
    532,
}
# Bytes without a type of their own, which Pillow would call numbers: configuration of components, maker note, comment,
# source of file and scene, settings; of GPS, method and area.
_UNTYPED = {IFD.Exif: (37121, 37500, 37510, 41728, 41729, 41995), IFD.GPSInfo: (27, 28)}
_PROFILE_TAG = 34675
_IPTC_TAG = 33723
_NO_COMPRESSION = 1
_DEFLATE = 8
_RGB = 2

# Pillow writes a tag with the type in its own tables, so these learn the types once.
# of any length
TiffTags.TAGS_V2[_IPTC_TAG] = TiffTags.TagInfo(_IPTC_TAG, type=TiffTags.UNDEFINED)
for _directory, _tags in _UNTYPED.items():
    _known: Any = TiffTags.TAGS_V2_GROUPS[_directory]
    _known |= {tag: TiffTags.TagInfo(tag, type=TiffTags.UNDEFINED, length=1) for tag in _tags}


def bits_of(photograph: Path) -> int:
    """Return the bits a channel of a photograph: 16 for PNG and TIFF files that have them, else 8. Reads its header."""
    try:
        with regular(photograph).open("rb") as file:
            start = file.read(25)
            if start.startswith(_PNG):
                return 16 if start[24] == 16 else 8
            if start[:2] not in (b"II", b"MM"):
                return 8
            tags = Image.Exif()
            file.seek(0)
            tags.load_from_fp(file)
            return 16 if np.max(tags.get(_BITS, 8)) > 8 else 8
    except ANY_FAULT:  # restoring it says what is wrong
        return 8


def encoded(picture: npt.NDArray[Any], photograph: bytes, quality: int) -> bytes:
    """Return a picture (H, W, 3) RGB uint8 or uint16 as a file of the photograph's format, with its metadata.

    photograph: content of its file; quality: of JPEG and WebP, 1 to 100. JPEG, WebP and BMP have 8 bits.
    """
    if photograph.startswith(_PNG):
        is_gray = photograph[25] in (0, 4)
        left_out = _OF_PIXELS | ({b"iCCP"} if is_gray else set())
        kept = [chunk for chunk in _chunks(photograph) if chunk[4:8] not in left_out]
        head, *others = _chunks(bytes(encode_png(picture[..., ::-1])))
        return _PNG + head + b"".join(kept) + b"".join(others)
    if photograph[:2] in (b"II", b"MM"):
        return _tiff(picture, photograph)
    return _by_pillow(
        (picture >> 8).astype(np.uint8) if picture.dtype == np.uint16 else picture,
        photograph,
        quality,
    )


def _by_pillow(picture: npt.NDArray[Any], photograph: bytes, quality: int) -> bytes:
    made, file = Image.fromarray(picture), io.BytesIO()
    with Image.open(io.BytesIO(photograph)) as source:
        kind = source.format or "PNG"
        info = source.info
    names = {"exif", "xmp", "icc_profile"} if kind == "WEBP" else {"dpi"}
    more = {}
    if photograph.startswith(b"\xff\xd8"):  # of all kinds of JPEG
        kept = (
            _without_preview(segment)
            for segment in _segments(photograph)
            if _is_metadata(segment)
        )
        kind = "JPEG"
        more = {"subsampling": 0, "extra": b"".join(kept)}
    made.save(
        file,
        kind,
        quality=quality,
        **more,
        **{name: info[name] for name in names & info.keys()},
    )
    return file.getvalue()


# -- JPEG -------------------------------------------------------------------------------------------------------


def _segments(content: bytes) -> Iterator[bytes]:
    """Yield the segments of a JPEG before its scan, each with its marker."""
    at = 2
    while at + 4 <= len(content) and content[at] == 0xFF:
        if content[at + 1] == 0xFF:  # padding
            at += 1
            continue
        if content[at + 1] == _START_OF_SCAN:
            return
        (length,) = struct.unpack_from(">H", content, at + 2)
        yield content[at : at + 2 + length]
        at += 2 + length


def _is_metadata(segment: bytes) -> bool:
    """Whether a segment is about the photograph, and neither about its pixels nor of other colours than RGB."""
    marker, body = segment[1], segment[4:]
    if body.startswith(_MULTI) or marker == _ADOBE:
        # places of other pictures in the file; how colours are stored
        return False
    if body.startswith(_ICC):
        head = body[len(_ICC) + 2 :]
        return body[len(_ICC)] > 1 or head[_RGB_PROFILE] == b"RGB "
    return marker == _COMMENT or 0xE1 <= marker <= 0xEF


def _without_preview(segment: bytes) -> bytes:
    """An EXIF segment whose first directory is its last: the second one is the preview."""
    if segment[1] != _EXIF_MARKER or not segment[4:].startswith(_EXIF):
        return segment
    start = 4 + len(_EXIF)
    order = "<" if segment[start : start + 2] == b"II" else ">"
    try:
        (first,) = struct.unpack_from(f"{order}I", segment, start + 4)
        (count,) = struct.unpack_from(f"{order}H", segment, start + first)
        following = start + first + 2 + 12 * count
        return (
            segment[:following] + bytes(4) + segment[following + 4 :]
            if following + 4 <= len(segment)
            else segment
        )
    except struct.error:  # a damaged directory stays as it is
        return segment


# -- PNG and TIFF -----------------------------------------------------------------------------------------------


def _chunks(content: bytes) -> Iterator[bytes]:
    at = len(_PNG)
    while at + 12 <= len(content):
        (length,) = struct.unpack_from(">I", content, at)
        yield content[at : at + 12 + length]
        at += 12 + length


def _tiff(picture: npt.NDArray[Any], photograph: bytes) -> bytes:
    """A TIFF of one page and one strip, with the tags of a photograph that are not about its pixels."""
    tags: Any = Image.Exif()  # of the first page, with the directories of EXIF and GPS
    tags.load(photograph)
    is_packed = tags.get(_COMPRESSION, _NO_COMPRESSION) != _NO_COMPRESSION
    for tag in _STORED & set(tags):
        del tags[tag]
    if _PROFILE_TAG in tags and bytes(tags[_PROFILE_TAG])[_RGB_PROFILE] != b"RGB ":
        del tags[_PROFILE_TAG]
    order: Any = "<" if photograph.startswith(b"II") else ">"
    if not isinstance(tags.get(_IPTC_TAG, b""), bytes):
        # called numbers of 32 bits by many programs
        tags[_IPTC_TAG] = np.array(tags[_IPTC_TAG], f"{order}u4").tobytes()
    height, width = picture.shape[:2]
    pixels = picture.astype(picture.dtype.newbyteorder(order)).tobytes()
    pixels = zlib.compress(pixels, 6) if is_packed else pixels
    tags[_SIDES], tags[_SIDES + 1] = width, height
    tags[_BITS] = (8 * picture.itemsize,) * 3
    tags[_SAMPLES] = 3
    tags[_COMPRESSION] = _DEFLATE if is_packed else _NO_COMPRESSION
    tags[_COLOURS] = _RGB
    # 0: Pillow writes where the directories end
    tags[_ROWS] = height
    tags[_COUNTS] = len(pixels)
    tags[_OFFSETS] = 0
    return tags.tobytes()[len(_EXIF) :] + pixels
