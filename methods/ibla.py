"""Restoration by image blurriness and light absorption, IBLA (Peng & Cosman 2017, IEEE TIP 26(4)).

Particles in the water blur distant things, and the water takes their red. The depth estimate blends one map from
blurriness with two from red. The weights depend on how bright the water is and how much red the image has. Symbols are
the paper's. Details that the paper leaves open follow the results that U45 publishes of this method
(docs/methods.md).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.cielab import luma
from sucre_bench.imaging.filters import guided_filter, window_max
from sucre_bench.imaging.image_formation import (
    highest,
    nearest_depth,
    reduced,
    restoration,
    stretched_plane,
)
from sucre_bench.plugins.options import check_ranges

_WAVELENGTH_NM = np.array([620.0, 540.0, 450.0])  # of red, green and blue
# scattering is linear in the wavelength (Zhao et al. 2015)
_SLOPE = -0.00113
_INTERCEPT = 1.62517
_STEEPNESS = 32.0  # s, of the sigmoid
# a channel is bright if more than 20 % of its pixels exceed 0.5 (eps_n)
_BRIGHT = 0.5
_BRIGHT_SHARE = 0.2
# in ratios of attenuation, a channel of the veiling light counts as at least this
_LEAST_LIGHT = 0.1
_SMALLEST_BLOCK = 1024  # the search for a block ends at this fraction of the image


@method(
    requires=("cv2", "skimage"),
    encoding="gamma",
    cites="Peng & Cosman 2017, Underwater image restoration based on image blurriness and light absorption",
    opinions={"SOTA (0 to 100)": 45.4, "UID2021": 3.3},
)
@dataclass(frozen=True)
class Ibla:
    """Estimate depth from blurriness and from the loss of red, and undo the attenuation over it.

    The veiling light A blends three candidates; the depth blends three maps. Red is attenuated by 1/7 per metre. The
    colour of A gives the attenuation of green and blue relative to red. Then J = (I - A) / t + A.
    """

    window: int = 7
    """Side of the maximum filters' window, pixels."""
    scales: int = 4
    """Number n of Gaussians that measure blurriness; the i-th has size and sigma 2^i n + 1 pixels."""
    radius: int = 100
    """Radius of the guided filter's window, pixels."""
    eps: float = 1e-3
    """Variance of intensity below which the guided filter smooths."""
    deepest: float = 8.0
    """Distance of relative depth 1, metres."""
    red: float = 1 / 7
    """Attenuation of red light, 1/m."""
    least: float = 0.1
    """Least transmission: noise is amplified by at most 1 / least; 1e-6 switches the bound off."""
    work_px: int = 1024
    """Longer side, pixels, of the reduced image on which depth and veiling light are estimated. The depth is then
    enlarged and refined at full size."""

    def __post_init__(self) -> None:
        check_ranges(
            self, window="[1, 1001]", scales="[1, 8]", radius="[1, 1000]", eps="[1e-6, 1]"
        )
        check_ranges(
            self, deepest="(0, 1000]", red="(0, 10]", least="[1e-6, 1]", work_px="[1, 100000]"
        )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]. info: attenuation (1/m of the method's own scale)."""
        import cv2

        rgb = view.rgb
        small = reduced(rgb, self.work_px)
        sharpness = sharpness_map(luma(small), self.scales, self.window)
        A = veiling_light_of(small, guided_filter(small, sharpness, self.radius, self.eps))
        depth = relative_depth(small, sharpness, A, self.window)
        if depth.shape != rgb.shape[:2]:
            depth = np.asarray(
                cv2.resize(depth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR),
                dtype=np.float32,
            )
        depth = guided_filter(rgb, depth, self.radius, self.eps).clip(0, 1)
        metres = np.float32(self.deepest) * (depth + np.float32(nearest_depth(rgb, A)))
        beta = self.red * attenuation_ratio(A)
        t = np.exp(-beta.astype(np.float32) * metres[..., None])
        return restoration(
            rgb, A, np.maximum(t, np.float32(self.least)), attenuation=beta.tolist()
        )


# -- blurriness -------------------------------------------------------------------------------


def sharpness_map(gray: Array, scales: int, window: int) -> Array:
    """Return the paper's blurriness map (H, W): the difference that blurring makes, low where the image is blurred.

    It is the mean difference from n Gaussians, then its maximum in a window (P_r). A smooth patch within a sharp object
    is a hole in P_r; morphological reconstruction raises each that does not touch the border to its rim.
    """
    import cv2
    from skimage.morphology import reconstruction

    difference = np.zeros_like(gray)
    for size in (2**i * scales + 1 for i in range(1, scales + 1)):
        difference += np.abs(
            gray - cv2.GaussianBlur(gray, (size, size), size, borderType=cv2.BORDER_REPLICATE)
        )
    plane = window_max(difference / scales, window)
    seed = np.full_like(plane, plane.max())
    seed[[0, -1]], seed[:, [0, -1]] = plane[[0, -1]], plane[:, [0, -1]]
    return np.asarray(reconstruction(seed, plane, method="erosion"), dtype=np.float32)


# -- veiling light ----------------------------------------------------------------------------


def veiling_light_of(rgb: Array, sharpness: Array) -> Array:
    """Return A (3,) float64, between the least and the greatest of three candidates in each channel.

    The candidates are the mean colours of the 0.1 % most blurred pixels, of the block of least variance and of the most
    blurred block. The more pixels of a channel are bright, the nearer A is to the greatest.
    """
    gray = luma(rgb)
    blocks = least_block(gray, np.var), least_block(sharpness, np.mean)
    # (3 candidates, 3 channels)
    candidates = np.stack(
        [rgb[highest(-sharpness, 0.001)].mean(axis=0, dtype=np.float64)]
        + [rgb[block].mean(axis=(0, 1), dtype=np.float64) for block in blocks]
    )
    bright = np.mean(rgb > _BRIGHT, axis=(0, 1))
    alpha = sigmoid(bright, _BRIGHT_SHARE)
    return np.asarray(alpha * candidates.max(axis=0) + (1 - alpha) * candidates.min(axis=0))


def least_block(plane: Array, measure: Callable[[Array], float]) -> tuple[slice, slice]:
    """Return the block where a measure is least, found by choosing one of four quarters again and again.

    The search ends at about 2^-10 of the image. The first half of n pixels has n // 2 + 1, as in the authors' results.
    """
    rows, columns = slice(0, plane.shape[0]), slice(0, plane.shape[1])
    enough = plane.size // _SMALLEST_BLOCK
    while (_length(rows) - 1) * (_length(columns) - 1) > enough:
        quarters = [(r, c) for r in _halves(rows) for c in _halves(columns)]
        chosen = min(quarters, key=lambda q: measure(plane[q]))
        if chosen == (rows, columns):
            break
        rows, columns = chosen
    return rows, columns


def _length(line: slice) -> int:
    return int(line.stop - line.start)


def _halves(whole: slice) -> list[slice]:
    """The two halves, or the whole where it has too few pixels for two."""
    middle = whole.start + _length(whole) // 2 + 1
    return (
        [slice(whole.start, middle), slice(middle, whole.stop)]
        if middle < whole.stop
        else [whole]
    )


# -- depth and attenuation ------------------------------------------------------


def relative_depth(rgb: Array, sharpness: Array, veiling_light: Array, window: int) -> Array:
    """Return relative depth (H, W) in [0, 1]: theta_b (theta_a d_D + (1 - theta_a) d_R) + (1 - theta_b) d_B.

    d_R: from the red that is left; d_D: from the excess of red over green and blue (maximum intensity prior,
    Carlevaris-Bianco et al. 2010), used in bright water; d_B: from blurriness, used for images without red.
    """
    red = window_max(rgb[..., 0], window)
    d_R = 1 - stretched_plane(red)
    d_D = 1 - stretched_plane(red - window_max(rgb[..., 1:].max(axis=-1), window))
    d_B = 1 - stretched_plane(sharpness)
    theta_a = float(sigmoid(veiling_light.mean(), 0.5))
    theta_b = float(sigmoid(rgb[..., 0].mean(dtype=np.float64), 0.1))
    return theta_b * (theta_a * d_D + (1 - theta_a) * d_R) + (1 - theta_b) * d_B


def attenuation_ratio(veiling_light: Array) -> Array:
    """Return the attenuation of R, G and B as multiples of red's (3,): A_R (m l + i) / (A_l (m l_R + i)).

    A wavelength l that is strong in the veiling light is absorbed little. A_R and A_l count as at least 0.1: with less
    red than that, green and blue would not change at all.
    """
    A = np.maximum(np.asarray(veiling_light, dtype=np.float64), _LEAST_LIGHT)
    scattering = _SLOPE * _WAVELENGTH_NM + _INTERCEPT
    return np.asarray(A[0] * scattering / (A * scattering[0]))


def sigmoid(a: Array | float, middle: float) -> Array:
    """Return S(a, delta) = 1 / (1 + exp(-s (a - delta)))."""
    return np.asarray(
        1 / (1 + np.exp(-_STEEPNESS * (np.asarray(a, dtype=np.float64) - middle)))
    )
