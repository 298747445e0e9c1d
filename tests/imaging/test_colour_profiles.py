"""Colour profiles of pictures, against LittleCMS, by which Pillow converts, and against the standards' own numbers."""

import io
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageCms

from sucre_bench import Arrays, Restoration, View, score
from sucre_bench.imaging.colour_profiles import profile_of, read_srgb
from sucre_bench.loading.view_files import Files

pytestmark = pytest.mark.short

# Red, green and blue under D50, as the makers' profiles have them, and the curves' tags.
_ADOBE = ((0.60974, 0.31111, 0.01947), (0.20528, 0.62567, 0.06087), (0.14919, 0.06322, 0.74457))
_P3 = ((0.51512, 0.2412, -0.00105), (0.29198, 0.69225, 0.04189), (0.1571, 0.06657, 0.78407))
_ADOBE_CURVE = b"curv" + struct.pack(">4xIH", 1, 563)
_SRGB_CURVE = b"para" + struct.pack(
    ">4xHH5i",
    3,
    0,
    *(round(x * 65536) for x in (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)),
)
_TABLE = b"curv" + struct.pack(
    ">4xI256H", 256, *(round(65535 * (k / 255) ** 1.8) for k in range(256))
)


SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()


def icc(primaries: tuple[tuple[float, ...], ...], curve: bytes) -> bytes:
    """The profile of sRGB with another name, other primaries and curves, which are put at its end."""
    text = b"Deep Sea RGB\0"
    tags = {b"desc": b"desc\0\0\0\0" + struct.pack(">I", len(text)) + text + bytes(79)}
    for channel, colour in zip("rgb", primaries, strict=True):
        numbers = struct.pack(">3i", *(round(x * 65536) for x in colour))
        tags[f"{channel}XYZ".encode()] = b"XYZ \0\0\0\0" + numbers
        tags[f"{channel}TRC".encode()] = curve
    profile = SRGB
    for name, tag in tags.items():
        at = profile.index(name) + 4
        place = struct.pack(">II", len(profile), len(tag))
        profile = profile[:at] + place + profile[at + 8 :] + tag + bytes(-len(tag) % 4)
    return struct.pack(">I", len(profile)) + profile[4:]


def colours() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (40, 60, 3)).astype(np.uint8)


def png(path: Path, chunks: bytes, picture: np.ndarray) -> None:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "PNG")
    path.write_bytes(file.getvalue()[:33] + chunks + file.getvalue()[33:])


def chunk(content: bytes) -> bytes:
    return (
        struct.pack(">I", len(content) - 4) + content + struct.pack(">I", zlib.crc32(content))
    )


@pytest.mark.parametrize("suffix", ["png", "tif", "webp"])
@pytest.mark.parametrize(
    ("primaries", "curve"), [(_ADOBE, _ADOBE_CURVE), (_P3, _SRGB_CURVE), (_P3, _TABLE)]
)
def test_icc_profiles_give_the_colours_of_littlecms(
    tmp_path: Path, suffix: str, primaries, curve: bytes
) -> None:
    path, profile = tmp_path / f"a.{suffix}", icc(primaries, curve)
    picture = Image.fromarray(colours())
    picture.save(path, icc_profile=profile, lossless=True)
    known, srgb = ImageCms.ImageCmsProfile(io.BytesIO(profile)), ImageCms.createProfile("sRGB")
    expected = np.asarray(
        ImageCms.profileToProfile(picture, known, srgb, ImageCms.Intent.RELATIVE_COLORIMETRIC)
    )
    found, of = read_srgb(path)
    assert of is not None
    assert of.name == "Deep Sea RGB"
    assert np.abs(found * 255 - expected).max() < 1.5
    beyond = of.to_srgb(np.full((1, 1, 3), 1.2, np.float32))
    assert (beyond > 1.05).all()
    assert (beyond < 1.4).all()


def test_what_exif_and_png_say_is_the_same_as_an_icc_profile(tmp_path: Path) -> None:
    adobe, p3 = icc(_ADOBE, _ADOBE_CURVE), icc(_P3, _SRGB_CURVE)
    for name, exif in (
        ("space", {0x8769: {0xA001: 2}}),
        ("rule", {0x8769: {0xA001: 65535, 0xA005: {1: "R03"}}}),
    ):
        tags = Image.Exif()
        for tag, value in exif.items():
            tags[tag] = value
        Image.fromarray(colours()).save(tmp_path / f"{name}.png", exif=tags)
    exact = (31270, 32900, 64000, 33000, 21000, 71000, 15000, 6000)
    png(
        tmp_path / "chrm.png",
        chunk(b"gAMA" + struct.pack(">I", 45471)) + chunk(b"cHRM" + struct.pack(">8I", *exact)),
        colours(),
    )
    png(tmp_path / "cicp.png", chunk(b"cICP\x0c\x0d\0\1"), colours())
    Image.fromarray(colours()).save(tmp_path / "adobe.png", icc_profile=adobe)
    Image.fromarray(colours()).save(tmp_path / "p3.png", icc_profile=p3)
    for name, same in (
        ("space", "adobe"),
        ("rule", "adobe"),
        ("cicp", "p3"),
        ("chrm", "adobe"),
    ):
        found, expected = (read_srgb(tmp_path / f"{one}.png")[0] for one in (name, same))
        assert np.abs(found - expected).max() < 0.004, name


def test_srgb_by_any_name_and_damaged_profiles_change_nothing(tmp_path: Path) -> None:
    for name, profile in (
        ("srgb", SRGB),
        ("cut", icc(_P3, _TABLE)[:300]),
        ("cmyk", icc(_P3, b"junk")),
    ):
        Image.fromarray(colours()).save(tmp_path / f"{name}.png", icc_profile=profile)
        assert profile_of(tmp_path / f"{name}.png") is None
    png(tmp_path / "usual.png", chunk(b"gAMA" + struct.pack(">I", 45455)), colours())
    assert profile_of(tmp_path / "usual.png") is None


def test_methods_see_stored_values_and_scores_are_of_srgb(tmp_path: Path) -> None:
    path, profile = tmp_path / "a.png", icc(_ADOBE, _ADOBE_CURVE)
    Image.fromarray(colours()).save(path, icc_profile=profile)
    view = View("a.png", Files(path, (60, 40), reference=path))
    assert np.array_equal(view.rgb, colours() / np.float32(255))
    rows = score(Restoration(view.rgb), view, metrics=["psnr:unmasked"])
    assert rows["value"].iloc[0] > 55
    untagged = View("a.png", Arrays(view.rgb, reference=view.reference))
    assert (
        score(Restoration(view.rgb), untagged, metrics=["psnr:unmasked"])["value"].iloc[0] < 30
    )
