"""Flicker: how much a method's colours change between consecutive views.

gain      the mean over channels of |G(t+1) - G(t)|, where G = ln(mean of restored / mean of input) of a channel, in
          linear light, over the pixels that are restored (not black). A method that multiplies every other view by a
          gain g flickers by |ln g|; one with a constant gain by 0, whatever the views show.
points    the mean CIEDE2000 between the same scene points in consecutive restored views, matched by depth and poses
          (rule "depth" of multiview/pairing.py). The input's own is given beside it: water and light change it, too.
relative  points, divided by the mean CIEDE2000 between those points and others of the same view (half of the list of
          points away): more contrast, as restoring gives, makes all differences larger.

Of each, the mean over pairs of consecutive views and Student's 95 % interval, as if pairs were independent.
Pairs without a common point count for gain alone.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array, Picture
from sucre_bench.engine.reopen_results import INPUT, Frame
from sucre_bench.imaging.cielab import ciede2000, contrast, lab_d50
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.machine.progress import track
from sucre_bench.multiview.common_points import matched, surface_of
from sucre_bench.scene import View

FORMULAE = {
    "gain": "mean over channels of |ln(restored / input)(t+1) - ln(restored / input)(t)|, of means in linear light",
    "points": "mean CIEDE2000 of the same scene points in views t and t+1",
    "relative": "points / mean CIEDE2000 of different points in view t",
}

_DARKEST = (
    0.5 / 255 / 12.92
)  # half of the smallest step of 8 bits, in linear light: the mean of a channel without light
_MOST_POINTS = 20_000  # points of a pair; the mean over so many has an error of about 0.02
_LINEAR = srgb_decode(np.arange(256) / 255)


@dataclass(frozen=True)
class Flicker:
    """A mean over pairs of consecutive views, and its 95 % interval (NaN for one pair); pairs: their number."""

    mean: float
    low: float
    high: float
    pairs: int


def flicker(frames: Sequence[Frame], methods: Sequence[str]) -> dict[str, dict[str, Flicker]]:
    """Return the flicker by method, "input" first, and by variant.

    Left out are variants that no pair of views has, for example "points" without depth or poses.
    """
    labels = (INPUT, *methods)
    found: dict[str, dict[str, list[float]]] = {label: {name: [] for name in FORMULAE} for label in labels}
    before: tuple[View, dict[str, Picture]] | None = None
    for frame in track(frames, "flicker"):
        now = frame.view, {label: frame.picture(label) for label in labels}
        if before is not None:
            for label, name, value in (*_gain_changes(before[1], now[1]), *_point_differences(*before, *now)):
                found[label][name].append(value)
        before = now
    return {
        label: {name: _mean(values) for name, values in by_statistic.items() if values}
        for label, by_statistic in found.items()
    }


def gain_of(restored: Picture, given: Picture) -> Array:
    """Return ln(mean restored / mean input) (3,) in linear light over restored pixels; NaN where there are none."""
    coloured = restored.any(axis=-1)
    if not coloured.any():
        return np.full(3, np.nan)
    means = [np.maximum(_LINEAR[picture[coloured]].mean(axis=0), _DARKEST) for picture in (restored, given)]
    return np.asarray(np.log(means[0] / means[1]))


def _gain_changes(before: Mapping[str, Picture], now: Mapping[str, Picture]) -> Iterator[tuple[str, str, float]]:
    for method in now:
        if method != INPUT:
            change = float(np.abs(gain_of(now[method], now[INPUT]) - gain_of(before[method], before[INPUT])).mean())
            if np.isfinite(change):
                yield method, "gain", change


def _point_differences(
    view: View, pictures: Mapping[str, Picture], following: View, following_pictures: Mapping[str, Picture]
) -> Iterator[tuple[str, str, float]]:
    """Colour differences of points that both views show and that have colours in all their pictures."""
    matches = matched(surface_of(view), following)
    if matches is None:
        return
    here = {name: picture.reshape(-1, 3)[matches.pixels] for name, picture in pictures.items()}
    there = {name: picture.reshape(-1, 3)[matches.others] for name, picture in following_pictures.items()}
    both = np.logical_and.reduce([side[name].any(axis=-1) for side in (here, there) for name in here if name != INPUT])
    chosen = np.flatnonzero(both)[:: max(1, int(both.sum()) // _MOST_POINTS)]
    if not len(chosen):
        return
    for name in here:
        colours = lab_d50(here[name][chosen] / 255)
        difference = float(ciede2000(colours, lab_d50(there[name][chosen] / 255)).mean())
        yield name, "points", difference
        if between_points := contrast(colours):
            yield name, "relative", difference / between_points


def _mean(values: Sequence[float]) -> Flicker:
    from scipy.stats import t

    n, mean = len(values), float(np.mean(values))
    if n < 2:
        return Flicker(mean, np.nan, np.nan, n)
    half = float(t.ppf(0.975, n - 1) * np.std(values, ddof=1) / np.sqrt(n))
    return Flicker(mean, max(0.0, mean - half), mean + half, n)  # flicker is not negative
