"""Contrast stretch of each channel: the display normalisation of SUCRe's tables, without any restoration."""

from dataclasses import dataclass

import numpy as np

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.imaging.display import stretch


@method()
@dataclass(frozen=True)
class HistogramStretch:
    """Map two percentiles of each channel, over valid pixels, to 0 and 1, and clip.

    Valid pixels are those with depth, or all pixels of a view without depth. A constant channel stays as it is.
    """

    low: float = 1.0
    """The percentile that becomes 0."""

    high: float = 99.0
    """The percentile that becomes 1."""

    def __post_init__(self) -> None:
        if not 0 <= self.low < self.high <= 100:
            raise InputError(
                f"histogram_stretch: low is {self.low}, high {self.high}; use 0 <= low < high <= 100"
            )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, in [0, 1]."""
        valid = view.valid
        over = view.rgb[valid] if valid.any() else None
        return Restoration(stretch(view.rgb, self.low, self.high, over).astype(np.float32))
