"""Underwater haze-lines (Berman, Levy, Avidan & Treibitz 2021, IEEE TPAMI 43(8)).

Underwater single image color restoration using haze-lines and a new quantitative dataset. The type of water, one of
Jerlov's, decides how fast each channel fades. Each type is tried, and the one with the most neutral result is taken.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.display import gray_world_gain
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.imaging.image_formation import recovered, reduced, transmissions
from sucre_bench.machine.progress import track
from sucre_bench.methods.haze_lines.jerlov import WATER_TYPES, WaterType
from sucre_bench.methods.haze_lines.lines import channel_transmission, transmission
from sucre_bench.methods.haze_lines.open_water import OpenWater, textureless_area
from sucre_bench.plugins.ranges import check_ranges
from sucre_bench.scene import Water


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
        check_ranges(self, lines="[1, 100000]", radius="[1, 1000]", eps="[1e-6, 1]", least="[1e-6, 1]")
        check_ranges(self, contrast="[0, 1]", textureless="(0, 1]", work_px="[1, 100000]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]."""
        small = reduced(view.rgb, self.work_px)
        area = textureless_area(small, self.textureless)
        small = self._decoded(small)
        open_water = OpenWater.of(small[area])
        water_type = self._type_of(small, open_water)
        image = self._decoded(view.rgb)
        J, t, _ = self._restored(image, open_water, water_type)
        mean = _mean(J, 1 - open_water.likeness(image))
        J *= gray_world_gain(mean[None]).astype(np.float32)
        A = open_water.veiling_light.astype(np.float64)
        unknown = np.full(3, np.nan)
        return Restoration(
            self._encoded(J),
            Water(self._encoded(A), unknown, unknown),
            info={**transmissions(t), "water_type": water_type.name},
        )

    def _type_of(self, image: Array, open_water: OpenWater) -> WaterType:
        """The type whose result is nearest to gray on objects, among those that see objects before the water."""
        object_like = 1 - open_water.likeness(image)
        casts = {}
        for water_type in track(WATER_TYPES, "water types"):
            J, _, t = self._restored(image, open_water, water_type)
            ahead = _mean(t, object_like) - _mean(t, 1 - object_like)
            casts[water_type] = (bool(ahead < self.contrast), float(_mean(J, object_like).std()))
        return min(casts, key=lambda water_type: casts[water_type])

    def _restored(self, image: Array, open_water: OpenWater, water_type: WaterType) -> tuple[Array, Array, Array]:
        """J and each channel's transmission (H, W, 3), and blue's transmission (H, W)."""
        A = open_water.veiling_light
        likeness = open_water.likeness(image)
        t = transmission(
            image, A, water_type, likeness, lines=self.lines, radius=self.radius, eps=self.eps, least=self.least
        )
        t_c = channel_transmission(t, water_type, self.least)
        return recovered(image, A, t_c), t_c, t

    def _decoded(self, image: Array) -> Array:
        return srgb_decode(image).astype(np.float32) if self.linear else image

    def _encoded(self, image: Array) -> Array:
        return srgb_encode(image) if self.linear else image


def _mean(values: Array, weight: Array) -> Array:
    """The weighted mean over the pixels, of (H, W) or of each channel of (H, W, 3), within [0, 1].

    Colours beyond are noise that the recovery has amplified. Where nothing has a weight, everything counts alike.
    """
    if not weight.any():
        weight = np.ones_like(weight)
    return np.asarray(np.average(values.clip(0, 1).reshape(weight.size, -1), axis=0, weights=weight.ravel()))
