"""Files that are not what their names promise: cut, endless, of forged sizes, or no files at all."""

from __future__ import annotations

import io
import os
import socket
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tifffile


def png_of_size(width: int, height: int) -> bytes:
    """A PNG of a few bytes whose header says a size."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return (
        b"\x89PNG\r\n\x1a\n"
        + chunk(b"IHDR", header)
        + chunk(b"IDAT", zlib.compress(b"\0" * 1000))
        + chunk(b"IEND", b"")
    )


def tiff_of_size(width: int, height: int) -> bytes:
    """A TIFF of a few bytes whose header says a size."""
    content = io.BytesIO()
    tifffile.imwrite(content, np.zeros((1, 1), np.float32))
    with tifffile.TiffFile(io.BytesIO(content.getvalue())) as file:
        tags = {name: file.pages.first.tags[name] for name in ("ImageWidth", "ImageLength")}
        order = file.byteorder
    data = bytearray(content.getvalue())
    for tag, value in ((tags["ImageWidth"], width), (tags["ImageLength"], height)):
        data[tag.valueoffset : tag.valueoffset + 4] = struct.pack(order + "I", value)
        data[tag.offset + 2 : tag.offset + 4] = struct.pack(order + "H", 4)
    return bytes(data)


def npz_of_shape(shape: tuple[int, ...]) -> bytes:
    """An .npz of some kilobytes whose array "image" is all zeros, of as many GB as the shape says."""
    header = io.BytesIO()
    np.lib.format.write_array_header_1_0(header, {"descr": "<f4", "fortran_order": False, "shape": shape})
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("image.npy", header.getvalue() + bytes(1 << 16))
    data = bytearray(content.getvalue())  # the directory says that the array is whole
    place = data.rindex(b"PK\x01\x02")
    data[place + 24 : place + 28] = struct.pack("<I", 0xFFFFFFF0)
    return bytes(data)


def cut_tiff() -> bytes:
    content = io.BytesIO()
    tifffile.imwrite(content, np.ones((30, 40, 3), np.uint8))
    return content.getvalue()[:8]


def tiff_of_pages(*pages: np.ndarray, reduced: int | None = None) -> bytes:
    """A TIFF of several pictures (H, W, 3). reduced: the page that says of itself that it is a thumbnail."""
    content = io.BytesIO()
    with tifffile.TiffWriter(content) as file:
        for number, page in enumerate(pages):
            file.write(page, photometric="rgb", subfiletype=int(number == reduced))
    return content.getvalue()


def animation(*pictures: np.ndarray) -> bytes:
    """A PNG that shows pictures (H, W, 3) one after the other."""
    from PIL import Image

    content, (first, *others) = io.BytesIO(), map(Image.fromarray, pictures)
    first.save(content, "PNG", save_all=True, append_images=others)
    return content.getvalue()


def device(path: Path) -> None:
    path.symlink_to("/dev/zero")


def pipe(path: Path) -> None:
    os.mkfifo(path)


def bound_socket(path: Path) -> None:
    here = Path.cwd()
    os.chdir(path.parent)  # an address has 108 bytes
    try:
        with socket.socket(socket.AF_UNIX) as bound:
            bound.bind(path.name)
    finally:
        os.chdir(here)


def written(content: bytes) -> Callable[[Path], None]:
    """Write some content, whatever the file's name says it is."""
    return lambda path: path.write_bytes(content) and None
