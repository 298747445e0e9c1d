"""White-patch white balance (Land 1977, The retinex theory of color vision)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from sucre_bench import InputError, Restoration, Scene, View, method


@method(cites="Land 1977, The retinex theory of color vision", licence="MIT")
@dataclass(frozen=True)
class WhitePatch:
    """Scale every channel so that its brightest pixels become white; a channel that is black is left alone."""

    percentile: float = 99.0
    """Of each channel, what becomes 1; 100 is the brightest pixel."""

    def __post_init__(self) -> None:
        if not 0 < self.percentile <= 100:
            raise InputError(f"white_patch.percentile: {self.percentile} is not above 0 up to 100; give 99")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, cut off at 1."""
        top = np.percentile(view.rgb, self.percentile, axis=(0, 1))
        gain = 1 / np.where(top > 1e-6, top, 1)
        return Restoration(np.minimum(view.rgb * gain.astype(np.float32), 1), info={"gain": gain.tolist()})
