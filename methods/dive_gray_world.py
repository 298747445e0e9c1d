"""Gray world by range over a dive: the colour correction that robotic surveys run before they map the seabed.

Bryson, Johnson-Roberson, Pizarro & Williams 2012, Colour-consistent structure-from-motion models using underwater
imagery, Robotics: Science and Systems VIII (MIT Press 2013). The assumption: over a whole dive, what lies at one
distance has the same mean colour and contrast as what lies at another. Then the mean and standard deviation of each
channel at each distance describe the water, and bringing them to common values removes it.
"""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array, evenly
from sucre_bench.imaging.encoding import converted, srgb_decode
from sucre_bench.imaging.fill import FillOption, with_filled
from sucre_bench.imaging.image_formation import distances
from sucre_bench.machine.progress import say, track
from sucre_bench.plugins.ranges import check_ranges
from sucre_bench.scene import Encoding

Along = Literal["distance", "depth"]

_ROWS = 512  # of an image, counted at once: memory holds a band and never a dive
_ENOUGH = 1_000_000  # pixels of a view; of larger ones every 2nd, 3rd ... row and column is counted, and weighs as many
_MOST_BINS = 10_000  # wrong distances beyond fall into the last bin
_LEAST_DEVIATION = 1 / 255  # a level of 8 bits: what varies less is noise


@dataclass(frozen=True, slots=True, eq=False)
class RangeStatistics:
    """What a dive looks like at each range.

    range_m: (K,) mean distance of each bin's pixels, metres, ascending; mean, deviation: (K, 3) of each channel;
    pixels: (K,) how many each bin has; views: how many were counted.
    """

    range_m: Array
    mean: Array
    deviation: Array
    pixels: Array
    views: int

    def at(self, z: Array, channel: int) -> tuple[Array, Array]:
        """Return a channel's mean and deviation (...) at distances z (...), linear between bins, constant beyond."""
        mean = np.interp(z, self.range_m, self.mean[:, channel])
        deviation = np.interp(z, self.range_m, self.deviation[:, channel])
        return mean, np.maximum(deviation, _LEAST_DEVIATION)


@method(
    needs={"depth"},
    cites="Bryson, Johnson-Roberson, Pizarro & Williams 2012, Colour-consistent structure-from-motion models using "
    "underwater imagery",
)
@dataclass(frozen=True)
class DiveGrayWorld(FillOption):
    """Give every channel the same mean and contrast at every distance, by statistics of all images of a dive.

    The mean and standard deviation of each channel are pooled over all views of the scene, by bins of distance. Each
    pixel becomes (I - mean(z)) / deviation(z) * contrast + brightness. Pixels without depth have no colour.
    """

    bin_m: float = 0.1
    """Width of a bin of distance, metres."""

    fewest: int = 1000
    """Least number of pixels in a bin. A bin with fewer takes its values from its neighbours."""

    brightness: float = 0.5
    """Mean of each channel after the correction, in gamma-encoded intensity."""

    contrast: float = 0.15
    """Standard deviation of each channel after the correction, in gamma-encoded intensity."""

    most_views: int | None = 100
    """Most views to count, spread evenly over the scene; null = all."""

    def __post_init__(self) -> None:
        check_ranges(self, bin_m="[1e-3, 1000]", fewest="[1, inf)", brightness="(0, 1)", contrast="(0, 1]")
        check_ranges(self, most_views="[1, inf)")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the corrected image, NaN where the view has no depth; it may leave [0, 1].

        info: along (what distances are measured along), n_views, n_bins, nearest_m and farthest_m of the bins.
        Raises NotApplicableError when no pixel of the view has depth, SolveError when no view can be counted.
        """
        z, along = distances(view)
        statistics = _of_scene(scene, self, view.encoding, along)
        brightness, contrast = _targets(self.brightness, self.contrast, view.encoding)

        def at(z: Array) -> Array:
            seen = z > 0
            image = np.full(view.rgb.shape, np.nan, dtype=np.float32)
            for c in range(3):
                mean, deviation = statistics.at(z[seen], c)
                image[seen, c] = (view.rgb[..., c][seen] - mean) * (contrast / deviation) + brightness
            return image

        info = {
            "along": along,
            "n_views": statistics.views,
            "n_bins": len(statistics.range_m),
            "nearest_m": float(statistics.range_m[0]),
            "farthest_m": float(statistics.range_m[-1]),
        }
        restoration = Restoration(at(z), info=info)
        return with_filled(restoration, view, at) if self.fill else restoration


def pooled(scene: Scene, options: DiveGrayWorld, encoding: Encoding, along: Along) -> RangeStatistics:
    """Return the statistics of a scene, counted view by view.

    encoding: of the intensities counted; along: what distances are measured along. Views without depth, without a
    camera where `along` is "distance", or with a damaged file are left out. Raises SolveError when none is left.
    """
    sums = np.zeros((_MOST_BINS, 8))  # pixels, their distances, three channels, their squares
    counted, last = 0, "no view has depth"
    for k in track(evenly(len(scene), options.most_views or len(scene)), "colours by range"):
        view = scene.views[k]
        try:
            if not view.has_depth or (along == "distance" and view.camera is None):
                continue
            z = view.distance if along == "distance" else view.depth
            step = max(1, math.isqrt(z.size // _ENOUGH))
            rgb = converted(view.rgb[::step, ::step], view.encoding, encoding)
            for band in _bands(rgb, z[::step, ::step], options.bin_m):
                sums[: len(band)] += band * step**2
        except InputError as fault:
            last = str(fault)
            say(f"colours by range: {view.name} is left out, {fault}")
            continue
        counted += 1
    if not sums[:, 0].any():
        raise SolveError(f"{scene.name}: no view can be counted, {last}")
    return _statistics(sums, options.fewest, counted)


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def _of_scene(scene: Scene, options: DiveGrayWorld, encoding: Encoding, along: Along) -> RangeStatistics:
    return pooled(scene, options, encoding, along)


def _bands(rgb: Array, z: Array, bin_m: float) -> Iterator[Array]:
    """Yield the sums (bins, 8) of some rows of an image after another."""
    for top in range(0, len(z), _ROWS):
        far = z[top : top + _ROWS]
        seen = far > 0
        if not seen.any():
            continue
        distance = far[seen].astype(np.float64)
        bins = np.minimum(distance / bin_m, _MOST_BINS - 1).astype(np.int64)
        colours = rgb[top : top + _ROWS][seen].T.astype(np.float64)  # (3, P)
        weights = (None, distance, *colours, *colours**2)
        yield np.stack([np.bincount(bins, weight) for weight in weights], axis=-1)


def _statistics(sums: Array, fewest: int, views: int) -> RangeStatistics:
    """The statistics of summed bins; one bin for all pixels where none has enough of them."""
    enough = sums[sums[:, 0] >= fewest]
    filled = enough if len(enough) else sums.sum(axis=0, keepdims=True)
    pixels = filled[:, :1]
    mean = filled[:, 2:5] / pixels
    variance = np.maximum(filled[:, 5:] / pixels - mean**2, 0)
    return RangeStatistics(filled[:, 1] / pixels[:, 0], mean, np.sqrt(variance), pixels[:, 0], views)


def _targets(brightness: float, contrast: float, encoding: Encoding) -> tuple[float, float]:
    """The mean and deviation to reach, in the view's encoding."""
    if encoding == "gamma":
        return brightness, contrast
    low, high = (float(srgb_decode(np.asarray(brightness + side * contrast))) for side in (-1, 1))
    return (low + high) / 2, (high - low) / 2
