"""The displayed and the expected colour of each chart patch, for tables of swatches."""

from collections.abc import Iterator
from dataclasses import dataclass

from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_patches import measure
from sucre_bench.metrics.psi_and_de00 import patch_region
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

CHANNELS = ("red", "green", "blue")


@metric(
    role="patch-colour",
    needs={"charts"},
    requires=["cv2"],
    unit="",
    better="none",
    range=(0, 1),
    default=[*CHANNELS, *(f"{channel}-expected" for channel in CHANNELS)],
    variants={
        **dict.fromkeys(CHANNELS, "measured, gamma-encoded"),
        **{f"{channel}-expected": "in the sRGB list" for channel in CHANNELS},
    },
)
@dataclass(frozen=True)
class PatchColour:
    """Intensity of each chart patch, grays as well: the median over the patch, one channel a variant."""

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield a score per patch."""
        channel, _, expected = variant.partition("-")
        c = CHANNELS.index(channel)
        for chart in view.charts:
            for reading in measure(shown, chart):
                value = float(reading.patch.srgb[c] if expected else reading.rgb[c])
                yield Score(value, patch_region(chart, reading.patch), reading.n_pixels, reading.coverage)
