"""Underwater haze-lines (Berman, Levy, Avidan & Treibitz 2021, IEEE TPAMI 43(8)).

Underwater single image color restoration using haze-lines and a new quantitative dataset. The type of water, one of
Jerlov's, decides how fast each channel fades. Each type is tried, and the one with the most neutral result is taken.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, Water, method, track
from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.display import gray_world_gain
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.filters import guided_filter, window_max
from sucre_bench.imaging.image_formation import recovered, reduced
from sucre_bench.plugins.options import check_ranges
from sucre_bench.scene import Encoding

# Jerlov's optical water types, as ratios of the attenuation of blue, green and red.
#
# Attenuation at the wavelengths of the sensors' peaks, from Jerlov 1976, Marine optics, as used by Berman, Levy,
# Avidan & Treibitz 2021: from clear ocean (I) over murky ocean (III) to the coast (1C to 5C).


@dataclass(frozen=True)
class WaterType:
    """A water, by ratios of its attenuation coefficients, which are in 1/m."""

    name: str

    blue_to_red: float
    """Is beta_B / beta_R."""

    blue_to_green: float
    """Is beta_B / beta_G."""

    @property
    def exponents(self) -> Array:
        """(3,) float32, beta_B / beta_c of red, green, blue: the transmission of a channel to this power is blue's."""
        return np.array([self.blue_to_red, self.blue_to_green, 1.0], dtype=np.float32)


WATER_TYPES = (
    WaterType("I", 0.1118, 0.4566),
    WaterType("IA", 0.1452, 0.5499),
    WaterType("IB", 0.1745, 0.6341),
    WaterType("II", 0.2773, 0.7937),
    WaterType("III", 0.4051, 0.9539),
    WaterType("1C", 0.4642, 1.0930),
    WaterType("3C", 0.6515, 1.1244),
    WaterType("5C", 1.0000, 1.2725),
)


# Haze-lines: pixels of one colour at all distances lie on a line through the veiling light.
#
# With the veiling light A and the ratios of attenuation beta_B / beta_c of the water, every channel is brought to the
# same transmission, blue's: sign(I - A) |I - A|^(beta_B / beta_c) = t_B sign(J - A) |J - A|^(beta_B / beta_c). In this
# space a scene colour, fading, moves straight towards 0. The length along its line is the transmission, up to the
# length of what has not faded at all. Berman et al. 2021.

_HAZE_FREE = 0.9  # transmission of a line's farthest pixel: it, too, has water before it
_BAND = 256  # rows at once


@functools.cache
def directions(n: int) -> Array:
    """Return (n, 3) unit vectors spread evenly over the sphere: a Fibonacci lattice (Gonzalez 2010)."""
    i = np.arange(n)
    z = 1 - (2 * i + 1) / n
    turn = i * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), z], axis=1)
    points.setflags(write=False)
    return points


def transmission(
    image: Array,
    A: Array,
    water: WaterType,
    likeness: Array,
    *,
    lines: int,
    radius: int,
    eps: float,
    least: float,
) -> Array:
    """Return blue's transmission (H, W) float32 in [least, 1], in water of a type.

    image: (H, W, 3) float32 intensities; A: (3,) veiling light; likeness: (H, W), 1 where a pixel shows nothing but
    water and so lies on no line: it gets the least transmission that its colour allows; lines: how many clusters;
    radius, eps: of the guided filter; least: transmission.
    """
    length, line = np.empty(image.shape[:2], np.float32), np.empty(image.shape[:2], np.int32)
    for rows in _bands(len(image)):
        length[rows], line[rows] = along_lines(compensated(image[rows], A, water), lines)
    longest = np.zeros(lines, np.float32)
    np.maximum.at(longest, line.ravel(), length.ravel())
    t = np.empty_like(length)
    for rows in _bands(len(image)):
        bound = np.maximum(least_transmission(image[rows], A, water), least)
        along = np.maximum(
            _HAZE_FREE * length[rows] / np.maximum(longest, 1e-9)[line[rows]], bound
        )
        t[rows] = along + likeness[rows] * (bound - along)
    return guided_filter(image, t, radius, eps).clip(least, 1)


def _bands(height: int) -> list[slice]:
    return [slice(top, min(top + _BAND, height)) for top in range(0, height, _BAND)]


def compensated(image: Array, A: Array, water: WaterType) -> Array:
    """Return the difference from A (H, W, 3), each channel to the power beta_B / beta_c, its sign kept."""
    difference = image - A
    return np.asarray(np.copysign(np.abs(difference) ** water.exponents, difference))


def along_lines(points: Array, lines: int) -> tuple[Array, Array]:
    """Return the length of each vector of points (H, W, 3), and the number of the line nearest to its direction.

    lines: how many there are; line k has direction k of `directions(lines)`.
    """
    from scipy.spatial import cKDTree

    length = np.sqrt(np.einsum("...c,...c", points, points))
    unit = points / np.maximum(length, 1e-9)[..., None]
    return length, np.asarray(cKDTree(directions(lines)).query(unit)[1])


def least_transmission(image: Array, A: Array, water: WaterType) -> Array:
    """Return blue's least transmission (H, W) with which no channel of J is below 0: max (1 - I / A)^(beta_B / beta_c).

    A channel that the veiling light lacks bounds nothing.
    """
    shortfall = (1 - image / np.maximum(A, 1e-4)).clip(0, 1) * (A > 1e-4)
    return functools.reduce(np.maximum, np.moveaxis(shortfall**water.exponents, -1, 0))


def channel_transmission(t: Array, water: WaterType, least: float) -> Array:
    """Return t_c = t^(beta_c / beta_B) (H, W, 3), no less than `least`."""
    return np.maximum(t[..., None] ** (1 / water.exponents), np.float32(least))


# Finds open water in an image: an area without texture, the veiling light there, and similar pixels.
#
# After Berman et al. 2021, who find edges by a trained detector; here a gradient is one.

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)  # ITU-R BT.709
_QUANTISATION = 1e-5  # variance added to each channel's, about that of 8 bits: a flat area has none of its own


def textureless_area(encoded: Array, share: float) -> Mask:
    """Return (H, W): the largest connected region among the `share` of pixels that are farthest from any edge.

    encoded: (H, W, 3) gamma-encoded, in which the dark parts' edges count as much as the bright ones'. An edge is a
    gradient of luminance after a Gaussian of sigma 1. A pixel has the strongest one in a window of 1/64 of the image.
    """
    import cv2

    luminance = cv2.GaussianBlur(encoded @ _LUMINANCE, (0, 0), 1)
    gradient = np.hypot(
        cv2.Scharr(luminance, cv2.CV_32F, 1, 0), cv2.Scharr(luminance, cv2.CV_32F, 0, 1)
    )
    edges = window_max(gradient, 2 * (max(gradient.shape) // 128) + 1)
    smooth = edges <= np.quantile(edges, share)
    _, labels, about, _ = cv2.connectedComponentsWithStats(
        smooth.astype(np.uint8), connectivity=4
    )
    largest = 1 + int(about[1:, cv2.CC_STAT_AREA].argmax())  # label 0 is what is not smooth
    return np.asarray(labels == largest)


@dataclass(frozen=True, eq=False)
class OpenWater:
    """The colours of open water: the veiling light, and the Gaussian distribution around it."""

    veiling_light: Array
    """The colour of median luminance in the area, (3,) float32."""

    # Of a colour's Mahalanobis distance |whiten (I - mean)|, (3,) and (3, 3).
    mean: Array
    whiten: Array

    near: float
    """Distance up to which a colour is water for sure: the area's own mean distance and a standard deviation."""

    far: float
    """Distance from which a colour is something else for sure: the area's greatest, at least 1 more than `near`."""

    @classmethod
    def of(cls, colours: Array) -> OpenWater:
        """Describe the colours (P, 3) of an area of open water."""
        luminance = colours @ _LUMINANCE
        middle = np.argpartition(luminance, len(luminance) // 2)[len(luminance) // 2]
        mean = colours.mean(axis=0, dtype=np.float64)
        offset = colours - mean
        covariance = offset.T @ offset / len(colours) + _QUANTISATION * np.eye(3)
        whiten = np.linalg.inv(np.linalg.cholesky(covariance))
        distance = np.linalg.norm(offset @ whiten.T, axis=1)
        near = float(distance.mean() + distance.std())
        far = max(float(distance.max()), near + 1)
        return cls(
            colours[middle], mean.astype(np.float32), whiten.astype(np.float32), near, far
        )

    def likeness(self, image: Array) -> Array:
        """Return (H, W) float32: 1 for colours of water, 0 for others, linear in the distance in between."""
        offset = (image - self.mean) @ self.whiten.T
        distance = np.sqrt(np.einsum("...c,...c", offset, offset))
        return np.asarray(
            ((self.far - distance) / (self.far - self.near)).clip(0, 1), dtype=np.float32
        )


@method(
    requires=("cv2", "scipy"),
    encoding="gamma",
    cites="Berman, Levy, Avidan & Treibitz 2021, Underwater single image color restoration using haze-lines and a new "
    "quantitative dataset",
)
@dataclass(frozen=True)
class HazeLines:
    """Find the type of water among Jerlov's and each pixel's transmission along its haze-line, and undo both.

    The veiling light comes from the largest area without texture, which should be open water; without open water it is
    a guess. At the end, gray world over what is not water balances the picture.
    """

    linear: bool = True
    """Decode intensities (sRGB) first, because the authors' model is for linear light; false: use encoded
    intensities."""
    lines: int = 500
    """Number of directions on the sphere into which pixels are clustered."""
    radius: int = 30
    """Radius of the guided filter's window, pixels."""
    eps: float = 1e-3
    """Variance of intensity below which the guided filter smooths."""
    least: float = 0.1
    """Least transmission: of blue in the estimate, and of each channel in the recovery. It limits the noise."""
    contrast: float = 0.1
    """Least difference between the mean transmissions of objects and water for a type to count; 0 lets all count."""
    textureless: float = 0.2
    """Share of the pixels that count as free of texture."""
    work_px: int = 1024
    """Longer side, pixels, of the reduced image on which the veiling light and the type of water are chosen."""

    def __post_init__(self) -> None:
        check_ranges(
            self, lines="[1, 100000]", radius="[1, 1000]", eps="[1e-6, 1]", least="[1e-6, 1]"
        )
        check_ranges(self, contrast="[0, 1]", textureless="(0, 1]", work_px="[1, 100000]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]."""
        small = reduced(view.rgb, self.work_px)
        area = textureless_area(small, self.textureless)
        light: Encoding = "linear" if self.linear else "gamma"
        small = converted(small, "gamma", light).astype(np.float32)
        open_water = OpenWater.of(small[area])
        water_type = self._type_of(small, open_water)
        image = converted(view.rgb, "gamma", light).astype(np.float32, copy=False)
        J, _ = self._restored(image, open_water, water_type)
        mean = _mean(J, 1 - open_water.likeness(image))
        J *= gray_world_gain(mean[None]).astype(np.float32)
        A = open_water.veiling_light.astype(np.float64)
        unknown = np.full(3, np.nan)
        return Restoration(
            converted(J, light, "gamma"),
            Water(converted(A, light, "gamma"), unknown, unknown),
            info={"water_type": water_type.name},
        )

    def _type_of(self, image: Array, open_water: OpenWater) -> WaterType:
        """The type whose result is nearest to gray on objects, among those that see objects before the water."""
        object_like = 1 - open_water.likeness(image)
        casts = {}
        for water_type in track(WATER_TYPES, "water types"):
            J, t = self._restored(image, open_water, water_type)
            ahead = _mean(t, object_like) - _mean(t, 1 - object_like)
            casts[water_type] = (
                bool(ahead < self.contrast),
                float(_mean(J, object_like).std()),
            )
        return min(casts, key=lambda water_type: casts[water_type])

    def _restored(
        self, image: Array, open_water: OpenWater, water_type: WaterType
    ) -> tuple[Array, Array]:
        """J (H, W, 3), and blue's transmission (H, W)."""
        A = open_water.veiling_light
        likeness = open_water.likeness(image)
        t = transmission(
            image,
            A,
            water_type,
            likeness,
            lines=self.lines,
            radius=self.radius,
            eps=self.eps,
            least=self.least,
        )
        t_c = channel_transmission(t, water_type, self.least)
        return recovered(image, A, t_c), t


def _mean(values: Array, weight: Array) -> Array:
    """The weighted mean over the pixels, of (H, W) or of each channel of (H, W, 3), within [0, 1].

    Colours beyond are noise that the recovery has amplified. Where nothing has a weight, everything counts alike.
    """
    if not weight.any():
        weight = np.ones_like(weight)
    return np.asarray(
        np.average(values.clip(0, 1).reshape(weight.size, -1), axis=0, weights=weight.ravel())
    )
