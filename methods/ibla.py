"""Restoration by image blurriness and light absorption, IBLA (Peng & Cosman 2017, IEEE TIP 26(4)).

Far things are blurred by what floats in the water, and have lost their red. Depth blends one estimate from blurriness
with two from red, by how bright the water is and how much red the image has. Symbols are the paper's.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters.dark_channel import window_max
from sucre_bench.imaging.filters.guided_filter import guided_filter
from sucre_bench.imaging.filters.luma import luma
from sucre_bench.imaging.filters.veiling_light import highest, nearest_depth, reduced, restoration
from sucre_bench.plugins.ranges import check_ranges

_WAVELENGTH_NM = np.array([620.0, 540.0, 450.0])  # of red, green and blue
_SLOPE, _INTERCEPT = -0.00113, 1.62517  # scattering is linear in the wavelength (Zhao et al. 2015)
_STEEPNESS = 32.0  # s, of the sigmoid
_BRIGHT, _BRIGHT_SHARE = 0.5, 0.2  # a channel is bright if more than this share of its pixels exceeds that (eps_n)


@method(
    requires=("cv2", "skimage"),
    encoding="gamma",
    cites="Peng & Cosman 2017, Underwater image restoration based on image blurriness and light absorption",
)
@dataclass(frozen=True)
class Ibla:
    """Estimate depth from blurriness and from the loss of red, and undo the attenuation over it.

    The veiling light blends three candidates, the depth three maps. Red is attenuated by 1/7 a metre, green and blue in
    the ratio that the veiling light's colour tells, and J = (I - A) / t + A.
    """

    window: int = 7
    """Side of the maximum filters' window, pixels."""
    scales: int = 4
    """Number n of Gaussians that blurriness is measured with; the i-th has the size and sigma 2^i n + 1 pixels."""
    radius: int = 50
    """Radius of the guided filter's window, pixels."""
    eps: float = 1e-3
    """Variance of intensity below which the guided filter smooths."""
    deepest: float = 8.0
    """Metres that the relative depth 1 stands for."""
    red: float = 1 / 7
    """Attenuation of red light, 1/m."""
    least: float = 0.1
    """Least transmission: what bounds the amplification of noise."""
    work_px: int = 1024
    """Depth and veiling light are estimated on the image with its longer side reduced to these pixels; then the depth
    is enlarged and refined at full size."""

    def __post_init__(self) -> None:
        check_ranges(self, window="[1, 1001]", scales="[1, 8]", radius="[1, 1000]", eps="[1e-6, 1]")
        check_ranges(self, deepest="(0, 1000]", red="(0, 10]", least="[1e-6, 1]", work_px="[1, 100000]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, restored; it may leave [0, 1]."""
        import cv2

        rgb = view.rgb
        small = reduced(rgb, self.work_px)
        sharpness = _sharpness(luma(small), self.scales, self.window)
        A = _veiling_light(small, guided_filter(small, sharpness, self.radius, self.eps))
        depth = _depth(small, sharpness, A, self.window)
        if depth.shape != rgb.shape[:2]:
            depth = np.asarray(cv2.resize(depth, rgb.shape[1::-1], interpolation=cv2.INTER_LINEAR), dtype=np.float32)
        depth = guided_filter(rgb, depth, self.radius, self.eps).clip(0, 1)
        metres = np.float32(self.deepest) * (depth + np.float32(nearest_depth(rgb, A)))
        beta = self.red * _attenuation_ratio(A)
        t = np.exp(-beta.astype(np.float32) * metres[..., None])
        return restoration(rgb, A, np.maximum(t, np.float32(self.least)), attenuation=beta.tolist())


# -- blurriness -------------------------------------------------------------------------------


def _sharpness(gray: Array, scales: int, window: int) -> Array:
    """What blurring takes away (H, W), P_r with its holes filled: the paper's blurriness map, low where it is blurred.

    The mean difference from n Gaussians, its maximum in a window; a smooth patch within a sharp object
    is a hole, filled by morphological reconstruction.
    """
    sizes = [2**i * scales + 1 for i in range(1, scales + 1)]
    difference = np.zeros_like(gray)
    for size in sizes:
        difference += np.abs(gray - _gaussian(gray, size))
    return _filled(window_max(difference / scales, window))


def _gaussian(gray: Array, size: int) -> Array:
    import cv2

    return np.asarray(cv2.GaussianBlur(gray, (size, size), size, borderType=cv2.BORDER_REPLICATE))


def _filled(plane: Array) -> Array:
    """Each basin that does not touch the image's border, raised to its rim (closing by reconstruction)."""
    from skimage.morphology import reconstruction

    seed = np.full_like(plane, plane.max())
    seed[[0, -1]], seed[:, [0, -1]] = plane[[0, -1]], plane[:, [0, -1]]
    return np.asarray(reconstruction(seed, plane, method="erosion"), dtype=np.float32)


# -- veiling light ----------------------------------------------------------------------------


def _veiling_light(rgb: Array, sharpness: Array) -> Array:
    """A (3,) float64: of three candidates, the brighter the image the nearer to their greatest.

    The mean colours of the .1 % most blurred pixels, of the block of least variance and of the block most blurred.
    """
    gray = luma(rgb)
    blocks = _least_block(gray, np.var), _least_block(sharpness, np.mean)
    candidates = np.stack(
        [rgb[highest(-sharpness, 0.001)].mean(axis=0, dtype=np.float64)]
        + [rgb[block].mean(axis=(0, 1), dtype=np.float64) for block in blocks]
    )  # (3 candidates, 3 channels)
    bright = np.mean(rgb > _BRIGHT, axis=(0, 1))
    alpha = _sigmoid(bright, _BRIGHT_SHARE)
    return np.asarray(alpha * candidates.max(axis=0) + (1 - alpha) * candidates.min(axis=0))


def _least_block(plane: Array, measure: Callable[[Array], float]) -> tuple[slice, slice]:
    """The block where a measure is least: of the four quarters, again and again, until 2^-10 of the image is left."""
    rows, columns = slice(0, plane.shape[0]), slice(0, plane.shape[1])
    enough = plane.size / 1024
    while (block := plane[rows, columns]).size > enough and min(block.shape) >= 2:
        quarters = [(r, c) for r in _halves(rows) for c in _halves(columns)]
        rows, columns = min(quarters, key=lambda q: measure(plane[q]))
    return rows, columns


def _halves(whole: slice) -> tuple[slice, slice]:
    middle = (whole.start + whole.stop) // 2
    return slice(whole.start, middle), slice(middle, whole.stop)


# -- depth and attenuation ------------------------------------------------------


def _depth(rgb: Array, sharpness: Array, veiling_light: Array, window: int) -> Array:
    """Relative depth (H, W) in [0, 1], theta_b (theta_a d_D + (1 - theta_a) d_R) + (1 - theta_b) d_B.

    d_R: what is left of red; d_D: how far red exceeds green and blue (the maximum intensity prior of
    Carlevaris-Bianco et al. 2010), which is trusted in bright water; d_B: blurriness, for images without red.
    """
    red = window_max(rgb[..., 0], window)
    d_R = 1 - _stretched(red)
    d_D = 1 - _stretched(red - window_max(rgb[..., 1:].max(axis=-1), window))
    d_B = 1 - _stretched(sharpness)
    theta_a = float(_sigmoid(veiling_light.mean(), 0.5))
    theta_b = float(_sigmoid(rgb[..., 0].mean(dtype=np.float64), 0.1))
    return theta_b * (theta_a * d_D + (1 - theta_a) * d_R) + (1 - theta_b) * d_B


def _attenuation_ratio(veiling_light: Array) -> Array:
    """Attenuation of R, G and B as a multiple of red's (3,): A_R (m l + i) / (A_l (m l_R + i)).

    The more of a wavelength l is left in the veiling light, the less it is absorbed for what is scattered.
    """
    A = np.maximum(np.asarray(veiling_light, dtype=np.float64), 1e-3)  # a dead channel is not attenuated without end
    scattering = _SLOPE * _WAVELENGTH_NM + _INTERCEPT
    return np.asarray(A[0] * scattering / (A * scattering[0]))


def _stretched(plane: Array) -> Array:
    """The plane brought to [0, 1] (F_s); 0 where it is the same everywhere."""
    low, high = plane.min(), plane.max()
    return np.asarray((plane - low) / max(high - low, np.float32(1e-6)))


def _sigmoid(a: Array | float, middle: float) -> Array:
    """S(a, delta) = 1 / (1 + exp(-s (a - delta)))."""
    return np.asarray(1 / (1 + np.exp(-_STEEPNESS * (np.asarray(a, dtype=np.float64) - middle))))
