"""A restored picture keeps the format and the metadata of its photograph; readers are not the libraries that write."""

import io
import struct
from pathlib import Path

import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms, PngImagePlugin
from PIL.ExifTags import IFD

from sucre_bench.imaging.image_files import read_rgb
from sucre_bench.programs.restore.picture_file import bits_of, encoded

PICTURE = np.random.default_rng(1).integers(0, 65535, (24, 36, 3), dtype=np.uint16)
PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
XMP = b'<x:xmpmeta xmlns:x="adobe:ns:meta/">reef</x:xmpmeta>'
LATITUDE = (17.0, 30.0, 12.5)


def exif() -> Image.Exif:
    made = Image.Exif()
    made[271], made[274] = "Nikon", 6
    made[IFD.Exif], made[IFD.GPSInfo] = {37500: b"maker note"}, {1: "S", 2: LATITUDE}
    return made


def photograph(kind: str) -> bytes:
    file, image = io.BytesIO(), Image.fromarray(np.zeros((24, 36, 3), np.uint8))
    text = PngImagePlugin.PngInfo()
    text.add_itxt("XML:com.adobe.xmp", XMP.decode())
    tags, more = Image.Exif(), {"pnginfo": text} if kind == "PNG" else {"xmp": XMP}
    tags.load(exif().tobytes())
    if kind == "TIFF":
        tags[700], more = XMP, {}
    image.save(file, kind, exif=tags if kind == "TIFF" else exif().tobytes(), icc_profile=PROFILE, **more)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["JPEG", "PNG", "WEBP", "TIFF"])
def test_exif_gps_xmp_and_profile_are_kept(kind: str) -> None:
    made = encoded((PICTURE >> 8).astype(np.uint8), photograph(kind), 95)
    with Image.open(io.BytesIO(made)) as image:
        tags = image.getexif()
        assert (image.format, tags[271], tags[274]) == (kind, "Nikon", 6)
        assert tuple(map(float, tags.get_ifd(0x8825)[2])) == LATITUDE
        assert tags.get_ifd(0x8769)[37500] == b"maker note"
        assert image.info["icc_profile"] == PROFILE
        assert XMP in made
        assert kind != "TIFF" or struct.pack("<HH", 37500, 7) in made, "bytes of no type, as the photograph's"


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
@pytest.mark.parametrize("bits", [8, 16])
def test_png_and_tiff_lose_no_level(tmp_path: Path, kind: str, bits: int) -> None:
    """Nor are they turned, though their orientation says so: viewers turn them, as they turn the photograph."""
    picture, file = PICTURE if bits == 16 else (PICTURE >> 8).astype(np.uint8), tmp_path / f"a.{kind.lower()}"
    file.write_bytes(encoded(picture, photograph(kind), 95))
    assert (np.rint(read_rgb(file) * (2**bits - 1)) == picture).all()


def test_a_tiff_of_16_bits_stays_one(tmp_path: Path) -> None:
    file = tmp_path / "a.tif"
    iptc = b"\x1c\x02\x19\x00\x04reef\x00\x00\x00"
    tags = [(700, 1, len(XMP), XMP, True), (33550, 12, 3, (0.5, 0.5, 0.0), True)]  # GeoTIFF's size of a pixel
    tags.append((33723, 4, 3, struct.unpack("<3I", iptc), True))  # keywords, as exiftool writes them
    tifffile.imwrite(file, PICTURE, photometric="rgb", compression="zlib", iccprofile=PROFILE, extratags=tags)
    assert bits_of(file) == 16
    content = encoded(PICTURE[::-1], file.read_bytes(), 95)
    assert iptc in content
    with tifffile.TiffFile(io.BytesIO(content)) as made:
        page = made.pages.first
        assert (page.asarray() == PICTURE[::-1]).all()
        assert (page.iccprofile, page.tags[33550].value) == (PROFILE, (0.5, 0.5, 0.0))
        assert page.tags[700].value == XMP


def test_the_preview_of_the_photograph_goes() -> None:
    """File managers would show the colours of before."""
    small = io.BytesIO()
    Image.fromarray(np.zeros((12, 18, 3), np.uint8)).save(small, "JPEG")
    order, first, second = b"II*\x00\x08\x00\x00\x00", 1, 2
    at = 8 + 2 + 12 * first + 4
    directory = first.to_bytes(2, "little") + b"\x0f\x01\x02\x00\x04\x00\x00\x00GoP\x00" + at.to_bytes(4, "little")
    place = at + 2 + 12 * second + 4
    preview = second.to_bytes(2, "little")
    for tag, value in ((513, place), (514, len(small.getvalue()))):
        preview += tag.to_bytes(2, "little") + b"\x04\x00\x01\x00\x00\x00" + value.to_bytes(4, "little")
    body = b"Exif\x00\x00" + order + directory + preview + bytes(4) + small.getvalue()
    file = io.BytesIO()
    Image.fromarray(np.zeros((24, 36, 3), np.uint8)).save(file, "JPEG", exif=body)
    with Image.open(io.BytesIO(file.getvalue())) as image:
        assert image.getexif().get_ifd(IFD.IFD1)  # the photograph has one
    with Image.open(io.BytesIO(encoded((PICTURE >> 8).astype(np.uint8), file.getvalue(), 95))) as image:
        assert image.getexif()[271] == "GoP"
        assert not image.getexif().get_ifd(IFD.IFD1)


def test_a_profile_of_gray_is_not_given_to_colours() -> None:
    file, gray = io.BytesIO(), PROFILE[:16] + b"GRAY" + PROFILE[20:]
    Image.fromarray(np.zeros((24, 36), np.uint8)).save(file, "JPEG", icc_profile=gray)
    with Image.open(io.BytesIO(encoded((PICTURE >> 8).astype(np.uint8), file.getvalue(), 95))) as image:
        assert image.mode == "RGB"
        assert "icc_profile" not in image.info
