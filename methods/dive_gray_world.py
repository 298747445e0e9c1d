"""Gray world by range over a dive: the colour correction that robotic surveys run before they map the seabed.

Bryson, Johnson-Roberson, Pizarro & Williams 2012, Colour-consistent structure-from-motion models using underwater
imagery, Robotics: Science and Systems VIII (MIT Press 2013). The assumption: over a whole dive, what lies at one
distance has the same mean colour and contrast as what lies at another. Then the mean and standard deviation of each
channel at each distance describe the water, and bringing them to common values removes it.

With `by_place`, the same holds for places in the image. What is left then at a place, over the whole dive, is the light
of lamps and strobes: the flat field of the dive.
"""

import functools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, SolveError, View, method
from sucre_bench.arrays import Array, evenly
from sucre_bench.imaging.encoding import converted, is_grey, srgb_decode
from sucre_bench.imaging.fill import FillOption
from sucre_bench.imaging.image_formation import distances
from sucre_bench.machine.progress import say, track
from sucre_bench.plugins.options import check_ranges
from sucre_bench.scene import Encoding

Along = Literal["distance", "depth"]

_ROWS = 512  # of an image, counted at once: memory holds a band and never a dive
_ENOUGH = 1_000_000  # pixels of a view; of larger ones every 2nd, 3rd ... row and column is counted, and weighs as many
_CELLS = 16  # places along the longer side of an image
_MOST_BINS = 10_000  # wrong distances beyond fall into the last bin
_LEAST_SHARE = 0.1  # of the deviation of a range: a place with less has no contrast to enlarge
_LEAST_DEVIATION = 1 / 255  # a level of 8 bits: what varies less is noise


@dataclass(frozen=True, slots=True, eq=False)
class RangeStatistics:
    """What a dive looks like at each range."""

    range_m: Array
    """Mean distance of each bin's pixels, (K,) metres, ascending."""

    # Of each channel, (K, 3).
    mean: Array
    deviation: Array

    pixels: Array
    """How many each bin has, (K,)."""

    views: int
    """How many were counted."""

    def at(self, z: Array, channel: int) -> tuple[Array, Array]:
        """Return a channel's mean and deviation (...) at distances z (...), linear between bins, constant beyond."""
        mean = np.interp(z, self.range_m, self.mean[:, channel])
        deviation = np.interp(z, self.range_m, self.deviation[:, channel])
        return mean, np.maximum(deviation, _LEAST_DEVIATION)


@method(
    needs={"depth"},
    requires=("cv2",),
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

    by_place: bool = False
    """Also give every place in the image the same mean and contrast over the dive, for lamps and strobes. Needs dozens
    of views of ground that changes from view to view."""

    most_views: int | None = 100
    """Most views to count, spread evenly over the scene; null = all."""

    def __post_init__(self) -> None:
        check_ranges(
            self,
            bin_m="[1e-3, 1000]",
            fewest="[1, inf)",
            brightness="(0, 1)",
            contrast="(0, 1]",
        )
        check_ranges(self, most_views="[1, inf)")

    @property
    def sees_whole_scene(self) -> bool:
        """All views of a scene rest on its statistics, which one worker counts once."""
        return True

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the corrected image, NaN where the view has no depth; it may leave [0, 1].

        info: along (what distances are measured along), n_views, n_bins, nearest_m and farthest_m of the bins.
        Raises NotApplicableError when no pixel of the view has depth, SolveError when no view can be counted.
        """
        import cv2

        z, along = distances(view)
        counted = (scene, self, view.encoding, along, is_grey(view.rgb))
        statistics = pooled(*counted)
        brightness, contrast = self.brightness, self.contrast
        if view.encoding == "linear":
            low, high = (
                float(srgb_decode(np.asarray(brightness + side * contrast))) for side in (-1, 1)
            )
            brightness, contrast = (low + high) / 2, (high - low) / 2

        def at(z: Array) -> Array:
            seen = z > 0
            image = np.full(view.rgb.shape, np.nan, dtype=np.float32)
            for c in range(3):
                mean, deviation = statistics.at(z[seen], c)
                image[seen, c] = (view.rgb[..., c][seen] - mean) * (
                    contrast / deviation
                ) + brightness
            if self.by_place:
                mean, deviation = (
                    cv2.resize(cells, z.shape[::-1], interpolation=cv2.INTER_LINEAR)
                    for cells in _flat_field(*counted)
                )
                image = (
                    (image - brightness - contrast * mean) / deviation + brightness
                ).astype(np.float32)
            return image

        info = {
            "along": along,
            "n_views": statistics.views,
            "n_bins": len(statistics.range_m),
            "nearest_m": float(statistics.range_m[0]),
            "farthest_m": float(statistics.range_m[-1]),
        }
        restoration = Restoration(at(z), info=info)
        return self.filled(restoration, view, at)


@functools.lru_cache(maxsize=4)  # every view of the scene asks for it
def pooled(
    scene: Scene, options: DiveGrayWorld, encoding: Encoding, along: Along, grey: bool = False
) -> RangeStatistics:
    """Return the statistics of a scene, counted view by view.

    encoding: of the intensities counted; along: what distances are measured along; grey: whether grey images are
    counted, too. Views without depth, without a camera where `along` is "distance", or with a damaged file are left
    out. Raises SolveError when none is left.
    """
    sums = np.zeros((_MOST_BINS, 8))  # pixels, their distances, three channels, their squares
    counted = 0
    for rgb, z, step in _counted(scene, options, encoding, along, grey):
        for rows in (slice(top, top + _ROWS) for top in range(0, len(z), _ROWS)):
            if (seen := z[rows] > 0).any():
                distance = z[rows][seen].astype(np.float64)
                bins = np.minimum(distance / options.bin_m, _MOST_BINS - 1).astype(np.int64)
                colours = rgb[rows][seen].T.astype(np.float64)  # (3, P)
                weights = (None, distance, *colours, *colours**2)
                band = np.stack([np.bincount(bins, weight) for weight in weights], axis=-1)
                sums[: len(band)] += band * step**2
        counted += 1
    if not sums[:, 0].any():
        raise SolveError(
            f"{scene.name}: no view can be counted; give views with readable images and depth maps"
        )
    enough = sums[sums[:, 0] >= options.fewest]
    # one bin for all where none has enough
    filled = enough if len(enough) else sums.sum(axis=0, keepdims=True)
    pixels = filled[:, :1]
    mean = filled[:, 2:5] / pixels
    variance = np.maximum(filled[:, 5:] / pixels - mean**2, 0)
    return RangeStatistics(
        filled[:, 1] / pixels[:, 0], mean, np.sqrt(variance), pixels[:, 0], counted
    )


def _counted(
    scene: Scene, options: DiveGrayWorld, encoding: Encoding, along: Along, grey: bool
) -> Iterator[tuple[Array, Array, int]]:
    """Yield image (h, w, 3), distances (h, w) of the views to count, and which row and column these are each."""
    for k in track(evenly(len(scene), options.most_views or len(scene)), "colours by range"):
        view = scene.views[k]
        try:
            if not view.has_depth or (along == "distance" and view.camera is None):
                continue
            z = view.distance if along == "distance" else view.depth
            step = max(1, math.isqrt(z.size // _ENOUGH))
            rgb = converted(view.rgb[::step, ::step], view.encoding, encoding)
            if is_grey(rgb) and not grey:
                raise InputError("it is grey, the restored view is not")
        except InputError as fault:
            say(f"colours by range: {view.name} is left out, {fault}")
            continue
        yield rgb, z[::step, ::step], step


@functools.lru_cache(maxsize=4)
def _flat_field(
    scene: Scene, options: DiveGrayWorld, encoding: Encoding, along: Along, grey: bool
) -> Array:
    """Return mean and deviation (2, 16, 16, 3) of what the statistics by range leave at each place in the image.

    Both in deviations of the range. A place with too few pixels has those of all: 0 and 1.
    """
    import cv2

    statistics = pooled(scene, options, encoding, along, grey)
    sums = np.zeros((_CELLS, _CELLS, 7))
    for rgb, z, step in _counted(scene, options, encoding, along, grey):
        known, left = (
            (z > 0)[..., None].astype(np.float32),
            np.empty(rgb.shape, dtype=np.float32),
        )
        for c in range(3):
            mean, deviation = statistics.at(z, c)
            left[..., c] = (rgb[..., c] - mean) / deviation
        of_cell = z.size * step**2 / _CELLS**2
        for at, plane in (
            (0, known),
            (slice(1, 4), left * known),
            (slice(4, 7), left**2 * known),
        ):
            cells = cv2.resize(plane, (_CELLS, _CELLS), interpolation=cv2.INTER_AREA)
            sums[..., at] += np.asarray(cells) * of_cell
    pixels = np.maximum(sums[..., :1], 1)
    mean = sums[..., 1:4] / pixels
    deviation = np.sqrt(np.maximum(sums[..., 4:] / pixels - mean**2, _LEAST_SHARE**2))
    enough = sums[..., :1] >= options.fewest
    return np.stack([np.where(enough, mean, 0), np.where(enough, deviation, 1)])
