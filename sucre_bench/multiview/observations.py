"""All observations of a target's pixels in the views of a scene, laid out for fast sums over them.

Pixels are sorted by how many observations they have, most first. Slot k holds every pixel's k-th observation: the
pixels that have one are a prefix of that order, so a slot is one contiguous array beside the prefix of any array
over pixels, and sums over a pixel's observations need no scatter (jagged-diagonal storage, Saad 1989).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.errors import InputError, SolveError
from sucre_bench.multiview.pairing import Surface, lift, match, own_matches
from sucre_bench.progress import say, track
from sucre_bench.scene import Array, View

__all__ = ["Observations", "Seen", "arrange", "observe"]

Indices = npt.NDArray[np.integer[Any]]

# A view is left out when it shows no more than this share of the target's pixels (the authors' program).
MIN_SHARE = 1e-6


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """P pixels of a target, N observations of them in V views.

    shape: (H, W) of the target; views: names of the views, in the scene's order, those without a pair left out;
    pixels: (P,) int64 flat indices into the target, by falling count, equal counts by rising index;
    counts: (P,) int32, at least 1;
    starts: (S + 1,) int64, slot k is elements starts[k] to starts[k + 1] and belongs to the first pixels of that
    number;
    distance: (N,) float32 metres from the observing camera;
    colour: (3, N) uint8 where all images are 8-bit, else float32 in [0, 1], encoded as the views are;
    view: (N,) uint16 indices into `views`, rising over a pixel's slots: the target's own is where it is in the scene;
    unreadable: what is wrong with each view that might have shown something, but has a file that cannot be read.
    """

    shape: tuple[int, int]
    views: tuple[str, ...]
    pixels: Indices
    counts: Indices
    starts: Indices
    distance: Array
    colour: npt.NDArray[Any]
    view: Indices
    unreadable: tuple[str, ...] = ()

    def __len__(self) -> int:
        """N."""
        return len(self.distance)

    def slots(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[int, slice]]:
        """Yield (n, part) per slot: the first n of pixels[start:stop] have an observation at [part], in that order."""
        stop = len(self.pixels) if stop is None else stop
        for begin, end in zip(self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True):
            n = min(stop, end - begin) - start
            if n <= 0:
                return
            yield n, slice(begin + start, begin + start + n)

    def intensity(self, part: slice) -> Array:
        """Return the colours (3, n) of observations as float32 in [0, 1]."""
        return self.colour[:, part].astype(np.float32) * np.float32(self.scale)

    @property
    def scale(self) -> float:
        """What `colour` is multiplied by to lie in [0, 1]."""
        return 1 / 255 if self.colour.dtype == np.uint8 else 1.0

    def image(self, colours: Array) -> Array:
        """Return pixels' colours (3, P) as an image (H, W, 3) float32, NaN elsewhere."""
        image = np.full((self.shape[0] * self.shape[1], 3), np.nan, dtype=np.float32)
        image[self.pixels] = colours.T
        return image.reshape(*self.shape, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """What one view shows of a target.

    name: the view's; pixels: (M,) int flat indices into the target, each at most once;
    distance: (M,) float32 metres; colour: (M, 3) uint8, or float32 in [0, 1].
    """

    name: str
    pixels: Indices
    distance: Array
    colour: npt.NDArray[Any]


def observe(target: View, views: Sequence[View]) -> Observations:
    """Pair the target with the views (itself among them) and return all observations of its pixels with depth.

    Views without a pose or depth are left out, as are those that show 1e-6 of the target's pixels or less, and those
    with a file that cannot be read: one damaged image of a dive does not cost the others theirs.
    Raises SolveError when the target has no pixel with depth; InputError when it has no depth map or pose.
    """
    surface = lift(target)
    if not len(surface.pixels):
        raise SolveError(f"{target.name}: no pixel has depth; check its depth map, 0 means unknown")
    height, width = target.depth.shape
    seen: list[Seen] = []
    if all(view.name != target.name for view in views):
        views = [target, *views]
    unreadable: list[str] = []
    for view in track(views, "pairing"):
        try:
            if (one := _see(surface, target, view, MIN_SHARE * height * width)) is not None:
                seen.append(one)
        except InputError as fault:
            if view.name == target.name:
                raise
            unreadable.append(str(fault))
            say(f"{target.name}: does without {view.name}: {fault}")
    return replace(arrange((height, width), seen), unreadable=tuple(unreadable))


def _see(surface: Surface, target: View, view: View, least: float) -> Seen | None:
    """What a view shows of the target; None when that is no more than `least` pixels."""
    matches = own_matches(surface) if view.name == target.name else match(surface, view)
    if matches is None or len(matches.pixels) <= least:
        return None
    colour = view.rgb.reshape(-1, 3)[matches.others]  # (M, 3)
    return Seen(view.name, matches.pixels.astype(np.int32), matches.distance, _compact(colour))


def _compact(colour: Array) -> npt.NDArray[Any]:
    """Colours as uint8 where that loses nothing but float32 rounding: a quarter of the memory, also to be read."""
    levels = colour * np.float32(255)
    rounded = np.rint(levels)
    return rounded.astype(np.uint8) if np.abs(levels - rounded).max(initial=0) < 1e-4 else colour


def arrange(shape: tuple[int, int], seen: Sequence[Seen]) -> Observations:
    """Lay out what views show of a target of this shape (H, W); the order of views is that of a pixel's slots."""
    counts = np.zeros(shape[0] * shape[1], dtype=np.int32)
    for one in seen:
        counts[one.pixels] += 1
    pixels = np.flatnonzero(counts)
    pixels = pixels[np.argsort(-counts[pixels], kind="stable")]
    place = np.empty(len(counts), dtype=np.int32)  # of each pixel in that order
    place[pixels] = np.arange(len(pixels))
    slot_sizes = len(pixels) - np.cumsum(np.bincount(counts[pixels], minlength=1))[:-1]  # pixels with more than k
    starts = np.concatenate([[0], np.cumsum(slot_sizes)]).astype(np.int64)

    n = int(starts[-1])
    eight_bit = all(one.colour.dtype == np.uint8 for one in seen)
    distance, view = np.empty(n, dtype=np.float32), np.empty(n, dtype=np.uint16)
    colour = np.empty((3, n), dtype=np.uint8 if eight_bit else np.float32)
    filled = np.zeros(len(counts), dtype=np.int32)  # slots, of each pixel
    for index, one in enumerate(seen):
        at = starts[filled[one.pixels]] + place[one.pixels]
        filled[one.pixels] += 1
        distance[at], view[at] = one.distance, index
        is_scaled = one.colour.dtype == np.uint8 and not eight_bit
        colour[:, at] = (one.colour / np.float32(255) if is_scaled else one.colour).T
    names = tuple(one.name for one in seen)
    return Observations(shape, names, pixels, counts[pixels], starts, distance, colour, view)
