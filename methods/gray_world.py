"""Gray-world white balance (Buchsbaum 1980, A spatial processor model for object colour perception)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.imaging.display import gray_world_gain


@method(cites="Buchsbaum 1980")
@dataclass(frozen=True)
class GrayWorld:
    """Scale every channel so that all three have the same mean over valid pixels.

    Valid are pixels with depth, all of them where there is no depth: open water is not asked to be gray. A channel
    that is black throughout is left black.
    """

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, scaled; it may exceed 1."""
        valid = view.valid
        pixels = view.rgb[valid] if valid.any() else view.rgb.reshape(-1, 3)
        gain = gray_world_gain(pixels)
        return Restoration(view.rgb * gain.astype(np.float32), info={"gain": gain.tolist()})
