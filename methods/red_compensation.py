"""Red compensation: a quick colour correction that survey images get before or after photogrammetry.

Red from green and gray world are the colour step of Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018, Color balance and
fusion for underwater image enhancement. A contrast stretch takes the place of its fusion. This is not the red-channel
prior of Galdran et al. 2015, which data sets call RED.
"""

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.imaging.display import stretch
from sucre_bench.imaging.filters import gray_world, red_from_green
from sucre_bench.plugins.options import check_ranges


@method(
    cites="Ancuti, Ancuti, De Vleeschouwer & Bekaert 2018",
    encoding="gamma",
    differs="a step of fusion_2018 with a stretch; U45's pictures called RED are 17 dB away",
)
@dataclass(frozen=True)
class RedCompensation:
    """Raise red where green is strong, balance by gray world, and stretch the contrast of each channel."""

    strength: float = 1.0
    """Share of the difference from green that red gets back: alpha of Ancuti et al. 2018, eq. 4; 0 switches this
    off."""

    percent: float = 0.05
    """Percent of each channel's pixels that become 0, and as many 1; 0 stretches from minimum to maximum."""

    def __post_init__(self) -> None:
        check_ranges(self, strength="[0, 10]", percent="[0, 50)")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        balanced = gray_world(red_from_green(view.rgb, self.strength))
        return Restoration(
            stretch(balanced, self.percent, 100 - self.percent).astype(np.float32)
        )
