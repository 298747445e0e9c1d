"""Underwater dark channel prior, UDCP (Drews et al. 2013, Transmission estimation in underwater single images).

Continued in Drews et al. 2016, Underwater depth estimation and image restoration based on single images. The dark
channel prior of He, Sun & Tang (2011) says that somewhere near each pixel one channel is dark, unless there is haze.
Under water red is dark everywhere, near and far, so only green and blue are used.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters import guided_filter
from sucre_bench.imaging.image_formation import brightest, restoration
from sucre_bench.plugins.options import check_ranges


@method(
    requires=("cv2",),
    encoding="gamma",
    cites="Drews Jr, do Nascimento, Moraes, Botelho & Campos 2013, Transmission estimation in underwater single images",
    opinions={"SAUD": 31},
)
@dataclass(frozen=True)
class Udcp:
    """Remove the veil that the dark channel of green and blue measures; its transmission is the same in all channels.

    The veiling light A is the colour where that dark channel is highest. The transmission t is 1 - the dark channel of
    I / A, refined by a guided filter. Then J = (I - A) / t + A.
    """

    window: int = 9
    """Side of the dark channel's window, pixels, odd."""
    radius: int = 50
    """Radius of the guided filter's window, pixels."""
    eps: float = 1e-3
    """Variance of intensity below which the guided filter smooths."""
    least: float = 0.2
    """Least transmission: noise is amplified by at most 1 / least; 1e-6 switches the bound off."""
    greatest: float = 0.9
    """Greatest transmission: near parts also keep some veil; 1 switches the bound off."""

    def __post_init__(self) -> None:
        check_ranges(self, window="[1, 1001]", radius="[1, 1000]", eps="[1e-6, 1]")
        check_ranges(self, least="[1e-6, 1]", greatest=f"[{self.least}, 1]")
        if self.window % 2 == 0:
            raise InputError(
                f"udcp.window: {self.window} is even; give an odd number of pixels"
            )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]."""
        rgb = view.rgb
        dark = dark_channel(rgb[..., 1:], self.window)
        A = brightest(rgb, dark == dark.max())
        # in a black image, nothing is brighter than A
        divisor = np.maximum(A[1:], 1e-3).astype(np.float32)
        t = guided_filter(
            rgb, 1 - dark_channel(rgb[..., 1:] / divisor, self.window), self.radius, self.eps
        )
        return restoration(rgb, A, t.clip(self.least, self.greatest))


def dark_channel(channels: Array, size: int) -> Array:
    """Return (H, W): the least value of any of the channels (H, W, C) in a window of size x size pixels, size odd.

    Windows are cut at the border.
    """
    import cv2

    darkest = np.ascontiguousarray(channels.min(axis=-1), dtype=np.float32)
    return np.asarray(cv2.erode(darkest, np.ones((size, size), np.uint8)))
