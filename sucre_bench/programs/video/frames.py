"""Frames of a before/after video: the input beside the restored images, or both with a moving divider."""

import math
from collections.abc import Iterator, Sequence

import numpy as np

from sucre_bench.arrays import Picture
from sucre_bench.engine.reopen_results import INPUT, Frame
from sucre_bench.imaging.drawing import captioned
from sucre_bench.machine.progress import track

_SWEEP_SECONDS = 6.0  # of the divider, there and back
_REACH = 0.42  # of the width, to either side of the middle
_GAP = 4  # pixels between panels
_LINE = 2  # pixels, the divider


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
    for k, frame in enumerate(track(frames, "video")):
        given = _fitted(frame.picture(INPUT), size)
        made = {method: _fitted(frame.picture(method), size) for method in methods}
        if split:
            at = _divider(k / fps, size[0])
            panels = [_split(given, picture, at, method) for method, picture in made.items()]
        else:
            panels = [captioned(picture, name) for name, picture in {INPUT: given, **made}.items()]
        gap = np.zeros((size[1], _GAP, 3), np.uint8)
        yield np.hstack([part for panel in panels for part in (gap, panel)][1:])


def _fitted(picture: Picture, size: tuple[int, int]) -> Picture:
    """A picture scaled to fit a panel, black beside it."""
    import cv2

    high, wide = picture.shape[:2]
    share = min(size[0] / wide, size[1] / high)
    wide, high = min(size[0], round(wide * share)), min(size[1], round(high * share))
    method = cv2.INTER_AREA if share < 1 else cv2.INTER_LINEAR
    fitted = np.zeros((size[1], size[0], 3), np.uint8)
    top, left = (size[1] - high) // 2, (size[0] - wide) // 2
    fitted[top : top + high, left : left + wide] = cv2.resize(picture, (wide, high), interpolation=method)
    return fitted


def _divider(seconds: float, width: int) -> int:
    return round(width * (0.5 - _REACH * math.cos(2 * math.pi * seconds / _SWEEP_SECONDS)))


def _split(given: Picture, made: Picture, at: int, method: str) -> Picture:
    """The input left of a column, the restored image right of it; each name stays on its side."""
    panel = captioned(made, method, right=True)
    panel[:, :at] = captioned(given, INPUT)[:, :at]
    panel[:, max(0, at - _LINE // 2) : at + _LINE // 2] = 255
    return panel
