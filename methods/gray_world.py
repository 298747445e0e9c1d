"""Gray-world white balance (Buchsbaum 1980, A spatial processor model for object colour perception)."""

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.imaging.display import gray_world_gain


@method(cites="Buchsbaum 1980")
@dataclass(frozen=True)
class GrayWorld:
    """Scale every channel so that all three have the same mean over valid pixels.

    Valid pixels are those with depth, or all pixels of a view without depth. So open water need not be gray. A black
    channel stays black.
    """

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may exceed 1. info: gain, the factor of each channel."""
        valid, rgb = view.valid, view.rgb
        gain = gray_world_gain(
            rgb[valid] if valid.any() and not valid.all() else rgb.reshape(-1, 3)
        )
        return Restoration(rgb * gain.astype(np.float32), info={"gain": gain.tolist()})
