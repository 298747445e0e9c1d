"""Videos of the views before and after, and flicker: how much a method's colours change between consecutive views.

Browsers play H.264, VP8, VP9 and AV1. OpenCV's wheels write VP9, in .mp4 and .webm, but neither H.264 nor AV1. Their
other format, MPEG-4 part 2 ("mp4v"), does not play in browsers.

Measures of flicker:

gain      the mean over channels of |G(t+1) - G(t)|, where G = ln(mean of restored / mean of input) of a channel, in
          linear light, over the pixels that are restored (not black). A method that multiplies every other view by a
          gain g flickers by |ln g|. One with a constant gain flickers by 0, whatever the views show.
points    the mean CIEDE2000 between the same scene points in consecutive restored views, matched by depth and poses
          (rule "depth" of multiview/pairing.py). The input's own is given beside it: water and light change it, too.
relative  points, divided by the mean CIEDE2000 between those points and others of the same view (half of the list of
          points away): more contrast, as restoring gives, makes all differences larger.

Of each, the mean over pairs of consecutive views and Student's 95 % interval, as if pairs were independent.
Pairs without a common point count for gain alone.
"""

import contextlib
import itertools
import math
import os
import tempfile
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array, Picture
from sucre_bench.engine.reopen_results import INPUT, Frame
from sucre_bench.errors import OutputError
from sucre_bench.imaging.cielab import ciede2000, contrast, lab_d50
from sucre_bench.imaging.drawing import captioned
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.machine.files import write_atomically
from sucre_bench.machine.progress import track
from sucre_bench.multiview.common_points import matched, surface_of
from sucre_bench.scene import View

_SWEEP_SECONDS = 6.0  # of the divider, there and back
_REACH = 0.42  # of the width, to either side of the middle
_GAP = 4  # pixels between panels
_LINE = 2  # pixels, the divider

FORMULAE = {
    "gain": "mean over channels of |ln(restored / input)(t+1) - ln(restored / input)(t)|, of means in linear light",
    "points": "mean CIEDE2000 of the same scene points in views t and t+1",
    "relative": "points / mean CIEDE2000 of different points in view t",
}

_DARKEST = 0.5 / 255 / 12.92  # half of an 8-bit step in linear light: the mean of a channel without light
_MOST_POINTS = 20_000  # points of a pair; the mean over so many has an error of about 0.02
_LINEAR = srgb_decode(np.arange(256) / 255)


def panel_size(frame: Frame, height: int) -> tuple[int, int]:
    """Return the width and height of a panel: the view's, shrunk to `height` if it is higher; both even."""
    high, wide = frame.view.rgb.shape[:2]
    share = min(1.0, height / high)
    return max(2, round(wide * share) // 2 * 2), max(2, round(high * share) // 2 * 2)


def composed(
    frames: Sequence[Frame], methods: Sequence[str], size: tuple[int, int], fps: float, split: bool
) -> Iterator[Picture]:
    """Yield a picture a frame, (H, W, 3) uint8 RGB with even sides: named panels next to each other.

    The input comes first. With `split`, each method's panel shows the input left of a moving divider instead.
    Views of another shape are fitted into `size` (width, height). Raises InputError for an unreadable picture.
    """
    from PIL import Image, ImageOps

    for k, frame in enumerate(track(frames, "video")):
        pictures = {name: Image.fromarray(frame.picture(name)) for name in (INPUT, *methods)}
        fitted = {name: np.asarray(ImageOps.pad(picture, size)) for name, picture in pictures.items()}
        if split:
            at = round(size[0] * (0.5 - _REACH * math.cos(2 * math.pi * k / fps / _SWEEP_SECONDS)))
            panels = [captioned(fitted[method], method, right=True) for method in methods]
            for panel in panels:  # each name stays on its side
                panel[:, :at] = captioned(fitted[INPUT], INPUT)[:, :at]
                panel[:, max(0, at - _LINE // 2) : at + _LINE // 2] = 255
        else:
            panels = [captioned(picture, name) for name, picture in fitted.items()]
        gap = np.zeros((size[1], _GAP, 3), np.uint8)
        yield np.hstack([part for panel in panels for part in (gap, panel)][1:])


def write_video(path: Path, pictures: Iterable[Picture], fps: float) -> int:
    """Write pictures (H, W, 3) uint8 RGB, all of one size with even sides, and return their number.

    The file is written atomically. Raises OutputError if it cannot be written, or if this OpenCV has no VP9 encoder.
    """
    import cv2

    writer, code, count = cv2.VideoWriter(), cv2.VideoWriter.fourcc(*"vp09"), 0
    with tempfile.TemporaryDirectory(prefix="sucre-bench-") as folder:
        file = Path(folder) / f"video{path.suffix.lower()}"
        try:
            for count, picture in enumerate(pictures, 1):
                if count == 1:
                    with _quiet():
                        writer.open(str(file), cv2.CAP_FFMPEG, code, fps, picture.shape[1::-1])
                    if not writer.isOpened():
                        remedy = "install opencv-python-headless from PyPI"
                        raise OutputError("this OpenCV cannot write VP9", path, remedy)
                writer.write(np.ascontiguousarray(picture[..., ::-1]))
        finally:
            writer.release()
        write_atomically(path, file.read_bytes())
    return count


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Hide a harmless message of OpenCV's C code about a tag in .webm."""
    kept = os.dup(2)
    with Path(os.devnull).open("w") as nowhere:
        os.dup2(nowhere.fileno(), 2)
    try:
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)


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
    from scipy.stats import t

    labels = (INPUT, *methods)
    values: dict[tuple[str, str], list[float]] = defaultdict(list)
    seen = ((frame.view, {name: frame.picture(name) for name in labels}) for frame in track(frames, "flicker"))
    for before, now in itertools.pairwise(seen):
        for method in methods:
            change = float(np.abs(np.subtract(*(_gain(p[method], p[INPUT]) for _, p in (before, now)))).mean())
            if np.isfinite(change):
                values[method, "gain"].append(change)
        for key, difference in _point_differences(*before, *now):
            values[key].append(difference)

    def mean(of_pairs: Sequence[float]) -> Flicker:
        n, middle = len(of_pairs), float(np.mean(of_pairs))
        if n < 2:
            return Flicker(middle, np.nan, np.nan, n)
        half = float(t.ppf(0.975, n - 1) * np.std(of_pairs, ddof=1) / np.sqrt(n))
        return Flicker(middle, max(0.0, middle - half), middle + half, n)  # flicker is not negative

    return {label: {name: mean(values[label, name]) for name in FORMULAE if values[label, name]} for label in labels}


def _gain(restored: Picture, given: Picture) -> Array:
    """ln(mean restored / mean input) (3,) in linear light over restored pixels; NaN where there are none."""
    coloured = restored.any(axis=-1)
    if not coloured.any():
        return np.full(3, np.nan)
    means = [np.maximum(_LINEAR[picture[coloured]].mean(axis=0), _DARKEST) for picture in (restored, given)]
    return np.asarray(np.log(means[0] / means[1]))


def _point_differences(
    view: View, pictures: Mapping[str, Picture], following: View, following_pictures: Mapping[str, Picture]
) -> Iterator[tuple[tuple[str, str], float]]:
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
        yield (name, "points"), difference
        if between_points := contrast(colours):
            yield (name, "relative"), difference / between_points
