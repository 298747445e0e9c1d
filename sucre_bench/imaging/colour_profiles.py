"""Colour profiles of picture files, and the same colours in sRGB, in which pictures are scored and shown.

A profile is what the file says: an ICC profile of primaries and curves, or of gray; EXIF's Adobe RGB; cICP, or gAMA
and cHRM, of a PNG. A file that says nothing is in sRGB.
"""

import functools
import io
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from sucre_bench.arrays import AnyArray, Array
from sucre_bench.errors import ANY_FAULT
from sucre_bench.imaging.cielab import linear_srgb_of_xyz
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.image_files import metadata_of, read_rgb, say_once_a_folder
from sucre_bench.scene import Encoding, Plane, Restoration, View

PROFILE = (
    "profile"  # the name in the record of the profile from which a restoration was converted
)

_EXIF = 0x8769
_INTEROPERABILITY = 0xA005
_COLOUR_SPACE = 0xA001
_BEYOND = 8.0  # a curve goes on as a straight line up to this intensity: restorations may leave [0, 1]
_D50 = np.array([0.9642, 1, 0.8249])  # of ICC profiles
_SRGB_LIKE = 1.5 / 255  # a profile that changes no colour by more is sRGB's

# Chromaticities (x, y) of red, green, blue and white.
_D65 = (0.3127, 0.329)
_BT709 = (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, *_D65)
_ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, *_D65)
# By the numbers of ITU-T H.273, of which PNG's cICP has two.
_PRIMARIES = {
    1: _BT709,
    9: (0.708, 0.292, 0.17, 0.797, 0.131, 0.046, *_D65),
    12: (0.68, 0.32, 0.265, 0.69, 0.15, 0.06, *_D65),
}
_BT709_CURVES = (1, 6, 14, 15)
_GAMMAS = {4: 2.2, 5: 2.8, 8: 1.0}
_SRGB_CURVE = 13
_NAMES = {1: "BT.709", 9: "BT.2020", 12: "Display P3"}

_GRID = np.linspace(0, 1, 4097)


@dataclass(frozen=True, eq=False)
class Profile:
    """The colour profile of an image file."""

    name: str
    """As the file has it."""

    matrix: Array
    """Leads to linear light of sRGB's primaries, (3, 3)."""

    curves: Array
    """Linear light of equally spaced values from 0 to 1, in red, green and blue, (3, 4097)."""

    def to_srgb(self, image: Array, encoding: Encoding = "gamma") -> Array:
        """Return an image (H, W, 3), in the same encoding, as sRGB: float32, beyond [0, 1] what that cannot show."""
        light = image if encoding == "linear" else self._linear(image)
        light = light @ self.matrix.T
        return np.asarray(light if encoding == "linear" else srgb_encode(light), np.float32)

    def _linear(self, image: Array) -> Array:
        light = np.empty(image.shape, np.float32)
        for channel, curve in enumerate(self.curves):
            slopes = np.diff(curve)[[0, -1]] / _GRID[1]
            ends = curve[0] - _BEYOND * slopes[0], curve[-1] + _BEYOND * slopes[1]
            light[..., channel] = np.interp(
                image[..., channel], [-_BEYOND, *_GRID, 1 + _BEYOND], [ends[0], *curve, ends[1]]
            )
        return light


def profile_of(path: Path) -> Profile | None:
    """Return the profile of a picture's file; None if it is sRGB, is not said, or cannot be used, which a line says."""
    try:
        found = _read(path)
    except _UnusableError as fault:
        say_once_a_folder(
            path, "profile", f"{path.name} {fault}, so it is read as sRGB; convert it to sRGB"
        )
        return None
    except ANY_FAULT:  # no picture, which decoding will say
        return None
    if found:
        text = f"pictures are in {found.name}: methods see values as stored, scores and charts are of sRGB"
        say_once_a_folder(path, "profile", text)
    return found


def read_srgb(path: Path) -> tuple[Array, Profile | None]:
    """Return what `read_rgb` does, converted to sRGB and clipped to [0, 1], and the profile that the file has."""
    image, profile = read_rgb(path), profile_of(path)
    return (profile.to_srgb(image).clip(0, 1) if profile else image), profile


@dataclass(frozen=True, eq=False)
class _InSrgb:
    """The pixels of a view, its image converted to sRGB."""

    view: View
    profile: Profile

    def load(self, plane: Plane) -> Array | None:
        if plane == "rgb":
            return self.profile.to_srgb(self.view.rgb, self.view.encoding).clip(0, 1)
        if plane == "reference":
            return self.view.reference
        return self.view.depth if self.view.has_depth else None


def view_in_srgb(view: View) -> View:
    """Return a view for scoring: its image is converted to sRGB, if its file has another profile."""
    profile: Profile | None = getattr(view.pixels, "profile", None)
    return replace(view, pixels=_InSrgb(view, profile)) if profile else view


def restoration_in_srgb(restoration: Restoration, view: View) -> Restoration:
    """Return a restoration of a view as it is scored and shown: converted to sRGB, unless its info names a profile."""
    profile: Profile | None = getattr(view.pixels, "profile", None)
    if profile is None or PROFILE in restoration.info:
        return restoration
    image = profile.to_srgb(restoration.image, view.encoding)
    filled = restoration.filled
    filled = None if filled is None else profile.to_srgb(filled, view.encoding)
    return replace(
        restoration,
        image=image,
        filled=filled,
        info={**restoration.info, PROFILE: profile.name},
    )


class _UnusableError(ValueError):
    """A file has a profile that is not understood."""


def _read(path: Path) -> Profile | None:
    tags, info = metadata_of(path)
    with path.open("rb") as file:
        head = file.read(1 << 16).partition(b"IDAT")[0]
    is_png = head.startswith(b"\x89PNG")
    if is_png and (code := head.partition(b"\0\0\0\4cICP")[2][:2]):
        return _of_primaries(
            _NAMES.get(code[0], ""), _PRIMARIES.get(code[0]), _curve_of(code[1])
        )
    if icc := info.get("icc_profile"):
        return of_icc(icc)
    if is_png and "srgb" not in info and "gamma" in info:
        *white, rx, ry, gx, gy, bx, by = info.get("chromaticity", (*_D65, *_BT709))[:8]
        primaries = (rx, ry, gx, gy, bx, by, *white)
        if abs(info["gamma"] - 1 / 2.2) < 0.005 and np.allclose(primaries, _BT709, atol=0.002):
            return None  # so many programs write sRGB
        return _of_primaries(
            "colours of their own (gAMA, cHRM)", primaries, _GRID ** (1 / info["gamma"])
        )
    of_camera = tags.get_ifd(_EXIF)
    rule = str(tags.get_ifd(_INTEROPERABILITY).get(1, "")).strip("\0 ")
    if of_camera.get(_COLOUR_SPACE) == 2 or (
        rule == "R03" and of_camera.get(_COLOUR_SPACE) != 1
    ):
        return _of_primaries("Adobe RGB (EXIF)", _ADOBE, _GRID ** (563 / 256))
    return None


def _curve_of(number: int) -> Array:
    if number == _SRGB_CURVE:
        return srgb_decode(_GRID)
    if number in _BT709_CURVES:
        return np.where(_GRID < 0.081, _GRID / 4.5, ((_GRID + 0.099) / 1.099) ** (1 / 0.45))
    if number in _GAMMAS:
        return np.asarray(_GRID ** _GAMMAS[number])
    raise _UnusableError("has an unknown curve, perhaps of high dynamic range")


def _of_primaries(name: str, xy: Sequence[float] | None, curve: Array) -> Profile | None:
    """The profile of chromaticities (x, y) of red, green, blue and white, and one curve; None if it is sRGB's."""
    if xy is None:
        raise _UnusableError("has unknown primaries")
    x, y = np.array(xy, np.float64).reshape(4, 2).T
    XYZ = np.stack([x / y, np.ones(4), (1 - x - y) / y])
    of_rgb = XYZ[:, :3] * np.linalg.solve(XYZ[:, :3], XYZ[:, 3])
    return _unless_srgb(
        Profile(name, linear_srgb_of_xyz(XYZ[:, 3]) @ of_rgb, np.stack([curve] * 3))
    )


def _unless_srgb(profile: Profile) -> Profile | None:
    levels = np.linspace(0, 1, 9, dtype=np.float32)
    colours = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(1, -1, 3)
    changes = np.abs(profile.to_srgb(colours).clip(0, 1) - colours).max()
    if not np.isfinite(changes):
        raise _UnusableError(f"has the profile {profile.name}, which is damaged")
    return profile if changes > _SRGB_LIKE else None


# -- ICC ------------------------------------------------------------------------------------------------------


@functools.lru_cache(maxsize=64)  # a dive's photographs have one
def of_icc(content: bytes) -> Profile | None:
    """Return an ICC profile (ICC.1:2022) of primaries and curves, or of gray; None if it is sRGB's."""
    from PIL import ImageCms

    name = "a colour profile"
    try:
        known = ImageCms.ImageCmsProfile(io.BytesIO(content))
        name = " ".join(ImageCms.getProfileDescription(known).split())
        (n,) = struct.unpack_from(">I", content, 128)
        entries = [struct.unpack_from(">4sII", content, 132 + 12 * k) for k in range(n)]
        tags = {tag: content[start : start + size] for tag, start, size in entries}
        if content[16:20] == b"GRAY":
            return _unless_srgb(Profile(name, np.eye(3), np.stack([_curve(tags[b"kTRC"])] * 3)))
        matrix = np.stack([_numbers(tags[f"{c}XYZ".encode()], 8, 3) for c in "rgb"], axis=1)
        curves = np.stack([_curve(tags[f"{c}TRC".encode()]) for c in "rgb"])
    except ANY_FAULT as fault:
        if isinstance(fault, _UnusableError):
            raise
        raise _UnusableError(
            f"has the profile {name}, which is not of primaries and curves"
        ) from fault
    return _unless_srgb(Profile(name, linear_srgb_of_xyz(_D50) @ matrix, curves))


def _numbers(tag: bytes, start: int, count: int) -> Array:
    """Numbers of a tag, each of 16 bits before and after the point."""
    return np.frombuffer(tag, ">i4", count, start) / 65536


def _curve(tag: bytes) -> Array:
    """The linear light of `_GRID`, by a tag "curv" or "para"."""
    number = int.from_bytes(tag[8:12])
    if tag[:4] == b"curv":
        values: AnyArray = np.frombuffer(tag, ">u2", number, 12).astype(np.float64)
        if number < 2:
            return np.asarray(_GRID ** (values[0] / 256 if number else 1.0))
        return np.interp(_GRID, np.linspace(0, 1, number), values / 65535)
    kind = number >> 16
    given = _numbers(tag, 12, (1, 3, 4, 5, 7)[kind])
    g, a, b, c, d, e, f = map(float, [*given, *(1, 1, 0, 0, 0, 0, 0)[len(given) :]])
    if kind in (1, 2):
        d = -b / a
        e = c
        f = c
        c = 0.0
    return np.where(d <= _GRID, np.maximum(a * _GRID + b, 0) ** g + e, c * _GRID + f)
