"""All observations of a target's pixels in the views of a scene, laid out for fast sums.

Pixels are sorted by their number of observations, most first. Slot k holds the k-th observation of every pixel that has
one; these pixels are a prefix of the order. So a slot is a contiguous array beside the prefix of any array over pixels.
Sums over a pixel's observations need no scatter (jagged-diagonal storage, Saad 1989).

An observation takes 7 bytes where the images are 8-bit: three colours and a float32 distance.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Indices, Mask, locked
from sucre_bench.machine.compute import compiled, usable_cores


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """P pixels of a target, N observations of them in V views."""

    shape: tuple[int, int]
    """(H, W) of the target."""

    views: tuple[str, ...]
    """Names of the views, in the scene's order, those without a pair left out."""

    pixels: Indices
    """Flat indices into the target, (P,) int64, by falling count, equal counts by rising index."""

    counts: Indices
    """How many observations each pixel has, (P,) int32, at least 1."""

    starts: Indices
    """Shape (S + 1,), int64. Slot k is elements starts[k] to starts[k + 1], one for each of the first pixels."""

    distance: Array
    """In metres, from the observing camera, (N,) float32."""

    colour: npt.NDArray[Any]
    """Shape (3, N). It is uint8 or uint16, full scale being 1, if all images have so few bits; else float32, [0, 1]."""

    weight: Array | None = None
    """Of each observation's squared residual, (N,) float32, or (3, N) for each channel; None for 1."""

    view: Indices | None = None
    """Indices into `views`, (N,) uint16, rising over a pixel's slots; None unless asked for."""

    ray: Array | None = None
    """The x / z and y / z of the point in the observing camera's frame, (2, N) float32; None unless asked for."""

    unreadable: tuple[str, ...] = ()
    """The fault of each view that may see the target but has a file that cannot be read."""

    grey: tuple[str, ...] = ()
    """The fault of each view that is left out because it is grey and the target is not."""

    read_s: float = 0.0
    """Seconds spent reading files, summed over threads."""

    pair_s: float = 0.0
    """Seconds in all."""

    stacked: int = 1
    """How many targets lie one below the other, see `pooled`."""

    def __len__(self) -> int:
        """N."""
        return len(self.distance)

    @property
    def n_repeated(self) -> int:
        """The number of pixels with two observations or more; they come first in the order."""
        return int(self.starts[2] - self.starts[1]) if len(self.starts) > 2 else 0

    @property
    def n_excess(self) -> int:
        """Observations minus pixels; those of weight 0 do not count. With weights of channels, the fewest of any."""
        n = (
            len(self)
            if self.weight is None
            else int(np.count_nonzero(self.weight, axis=-1).min())
        )
        return n - len(self.pixels)

    @property
    def place(self) -> Indices:
        """The index into `pixels` of each observation, (N,)."""
        return np.concatenate([np.arange(n) for n, _ in self.slots()])

    def slots(self, start: int = 0, stop: int | None = None) -> Iterator[tuple[int, slice]]:
        """Yield (n, part) a slot: the first n of pixels[start:stop] have their observations at [part], in order."""
        stop = len(self.pixels) if stop is None else stop
        for begin, end in zip(self.starts[:-1].tolist(), self.starts[1:].tolist(), strict=True):
            n = min(stop, end - begin) - start
            if n <= 0:
                return
            yield n, slice(begin + start, begin + start + n)

    def distance_range(self) -> tuple[Array, Array]:
        """Return the nearest and the farthest distance (P,) of each pixel's observations, float32 metres."""
        nearest, farthest = np.full((2, len(self.pixels)), self.distance[: len(self.pixels)])
        for n, part in self.slots():
            np.minimum(nearest[:n], self.distance[part], out=nearest[:n])
            np.maximum(farthest[:n], self.distance[part], out=farthest[:n])
        return nearest, farthest

    def intensity(self, part: slice) -> Array:
        """Return the colours (3, n) of observations as float32 in [0, 1]."""
        return self.colour[:, part].astype(np.float32) * np.float32(self.scale)

    @property
    def scale(self) -> float:
        """The factor that brings `colour` to [0, 1]."""
        return 1 / _full_scale(self.colour.dtype)

    def image(self, values: Array) -> Array:
        """Return pixels' colours (3, P), or one value each (P,), as an image (H, W[, 3]) float32, NaN elsewhere."""
        image = np.full(
            (self.shape[0] * self.shape[1], *values.shape[:-1]), np.nan, dtype=np.float32
        )
        image[self.pixels] = values.T
        return image.reshape(*self.shape, *values.shape[:-1])

    def take(self, places: Indices) -> Observations:
        """Return the observations of some pixels. places: (M,) rising indices into `pixels`."""
        counts = self.counts[places]
        sizes = (
            (counts[:, None] > np.arange(counts[0])).sum(axis=0)
            if len(places)
            else np.empty(0, dtype=np.int64)
        )
        at = (
            np.concatenate([self.starts[k] + places[:n] for k, n in enumerate(sizes)])
            if len(places)
            else places
        )
        starts = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
        return replace(
            self, pixels=self.pixels[places], counts=counts, starts=starts, **self._at(at)
        )

    def in_views(self, kept: Mask) -> Observations:
        """Return the observations in some views, (V,) bool; pixels that none of them shows are left out."""
        assert self.view is not None
        stays = kept[self.view]
        counts = np.zeros(len(self.pixels), dtype=np.int32)
        slot = np.empty(len(self), dtype=np.int64)
        for n, part in self.slots():
            slot[part] = counts[:n]
            counts[:n] += stays[part]
        order = np.argsort(-counts, kind="stable")[: np.count_nonzero(counts)]
        rank = np.empty(len(counts), dtype=np.int64)
        rank[order] = np.arange(len(order))
        at = np.flatnonzero(stays)
        at = at[np.lexsort((rank[self.place[at]], slot[at]))]
        return replace(
            self,
            pixels=self.pixels[order],
            counts=counts[order],
            starts=np.concatenate([[0], np.cumsum(np.bincount(slot[at]))]).astype(np.int64),
            **self._at(at),
        )

    def _at(self, at: Indices) -> dict[str, Any]:
        """Return the fields with one value an observation, at some of them."""
        per_observation = ("distance", "colour", "weight", "view", "ray")
        return {
            name: values[..., at]
            for name in per_observation
            if (values := getattr(self, name)) is not None
        }


def pooled(parts: Sequence[Observations], views: Sequence[str]) -> Observations:
    """Return the observations of targets as of one, whose images lie one below the other.

    parts: with `view`; views: names in the scene's order. Colours are float32.
    """
    height, width = np.max([one.shape for one in parts], axis=0).tolist()
    shown = {name for one in parts for name in one.views}
    names = {name: k for k, name in enumerate(name for name in views if name in shown)}
    pixels = []
    owner = []
    slot = []
    view = []
    first = 0
    for k, one in enumerate(parts):
        y, x = np.divmod(one.pixels, one.shape[1])
        pixels.append((k * height + y) * width + x)
        owner.append(first + one.place)
        slot.append(np.repeat(np.arange(len(one.starts) - 1), np.diff(one.starts)))
        view.append(np.array([names[name] for name in one.views], dtype=np.uint16)[one.view])
        first += len(one.pixels)
    counts = np.concatenate([one.counts for one in parts])
    order = np.argsort(-counts, kind="stable")
    slots = np.concatenate(slot)
    at = np.lexsort((np.argsort(order)[np.concatenate(owner)], slots))
    rays = [one.ray for one in parts if one.ray is not None]
    return Observations(
        (height * len(parts), width),
        tuple(names),
        np.concatenate(pixels)[order],
        counts[order],
        np.concatenate([[0], np.cumsum(np.bincount(slots))]),
        np.concatenate([one.distance for one in parts])[at],
        np.concatenate([one.intensity(slice(None)) for one in parts], axis=1)[:, at],
        view=np.concatenate(view)[at],
        ray=np.concatenate(rays, axis=1)[:, at] if len(rays) == len(parts) else None,
        stacked=len(parts),
    )


def _full_scale(dtype: np.dtype[Any]) -> int:
    return np.iinfo(dtype).max if dtype.kind == "u" else 1


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """The observations of a target in one view."""

    name: str
    """The view's."""

    pixels: Indices
    """Flat indices into the target, (M,) int, each at most once."""

    distance: Array
    """In metres, (M,) float32."""

    colour: npt.NDArray[Any]
    """Shape (M, 3); uint8, uint16, or float32 in [0, 1]."""

    ray: Array | None = None
    """See `Observations`, (2, M) float32."""


def compact(colour: Array) -> npt.NDArray[Any]:
    """Return colours in [0, 1] as uint8 or uint16 if that loses no more than float32 rounding, to save memory."""
    for dtype, tolerance in ((np.uint8, 1e-4), (np.uint16, 0.02)):
        levels = colour * np.float32(np.iinfo(dtype).max)
        rounded = np.rint(levels)
        if not (rounded.min(initial=0) >= 0 and rounded.max(initial=0) <= np.iinfo(dtype).max):
            # or NaN
            continue
        levels -= rounded
        if max(levels.max(initial=0), -levels.min(initial=0)) < tolerance:
            return rounded.astype(dtype)
    return colour


def arrange(
    shape: tuple[int, int],
    seen: list[Seen],
    *,
    with_view: bool = False,
    free: bool = False,
    empty: Callable[[str, tuple[int, ...], npt.DTypeLike], npt.NDArray[Any]] | None = None,
) -> Observations:
    """Lay out the observations of a target of this shape (H, W); a pixel's slots follow the order of views.

    free: empty `seen` on the way, to free its memory while the result's is filled; empty: makes the arrays with a value
    an observation, from a field's name, a shape and a type; None makes them in memory.
    """
    empty = empty or (lambda _, shape, dtype: np.empty(shape, dtype))
    n_pixels = shape[0] * shape[1]
    counts = np.zeros(n_pixels, dtype=np.int32)
    for one in seen:
        compiled(_count)(locked(one.pixels), counts)
    most = counts.max(initial=0)
    # By falling count, equal counts by rising index; numbers of 8 or 16 bits are sorted by counting.
    order = np.argsort((most - counts).astype(np.min_scalar_type(most)), kind="stable")
    pixels = order[: np.count_nonzero(counts)].copy()
    del order
    place = np.empty(n_pixels, dtype=np.int32)  # of each pixel in that order
    place[pixels] = np.arange(len(pixels), dtype=np.int32)
    # pixels with more than k observations, (S,)
    n_more = n_pixels - np.cumsum(np.bincount(counts))[:-1]
    starts = np.concatenate([[0], np.cumsum(n_more)]).astype(np.int64)
    # the next slot of each pixel
    filled, n = (
        np.zeros(n_pixels, dtype=np.int32),
        int(starts[-1]),
    )
    finest = np.result_type(
        np.uint8, *(one.colour.dtype if one.colour.dtype.kind == "u" else "f4" for one in seen)
    )
    distance, colour = empty("distance", (n,), np.float32), empty("colour", (3, n), finest)
    view = empty("view", (n,), np.uint16) if with_view else None
    ray = (
        empty("ray", (2, n), np.float32)
        if seen and all(one.ray is not None for one in seen)
        else None
    )
    names = tuple(one.name for one in seen)
    parts = seen if free else list(seen)
    for index in range(len(parts)):
        one = parts.pop(0)
        colours = one.colour
        if colours.dtype != finest and finest == np.uint16:
            colours = colours.astype(np.uint16) * 257  # 65535 / 255
        elif colours.dtype != finest:
            colours = (colours / np.float32(_full_scale(colours.dtype))).astype(finest)
        at = np.empty(0 if view is None and ray is None else len(one.pixels), dtype=np.int64)
        given = (
            locked(one.pixels),
            locked(one.distance),
            locked(np.ascontiguousarray(colours)),
        )
        _fill_in_threads(
            *given, starts, place, filled, at, np.asarray(distance), np.asarray(colour)
        )
        if view is not None:
            view[at] = index
        if ray is not None:
            ray[:, at] = one.ray
    return Observations(
        shape, names, pixels, counts[pixels], starts, distance, colour, view=view, ray=ray
    )


# Observations that are worth a thread.
_MANY = 200_000


def _fill_in_threads(pixels: Indices, *arrays: npt.NDArray[Any]) -> None:
    """Call `_fill` for parts of a view's pixels: they differ, so no two threads write to one place."""
    step = max(_MANY, -(-len(pixels) // usable_cores()))
    spans = [(start, min(start + step, len(pixels))) for start in range(0, len(pixels), step)]
    if len(spans) == 1:
        compiled(_fill)(pixels, *arrays, *spans[0])
    elif spans:
        with ThreadPoolExecutor(len(spans)) as pool:
            list(pool.map(lambda span: compiled(_fill)(pixels, *arrays, *span), spans))


def _count(pixels: Indices, counts: Indices) -> None:
    for i in range(len(pixels)):
        counts[pixels[i]] += 1


def _fill(
    pixels: Indices,
    values: Array,
    colours: npt.NDArray[Any],
    starts: Indices,
    place: Indices,
    filled: Indices,
    at: Indices,
    out: Array,
    colour: npt.NDArray[Any],
    first: int,
    last: int,
) -> None:
    """Store values (M,) in out (N,), colours (M, 3) in colour (3, N), and their places in `at` unless it is empty."""
    for i in range(first, last):
        pixel = pixels[i]
        k = starts[filled[pixel]] + place[pixel]
        filled[pixel] += 1
        if len(at):
            at[i] = k
        out[k] = values[i]
        colour[0, k], colour[1, k], colour[2, k] = colours[i, 0], colours[i, 1], colours[i, 2]


def new_file(
    folder: Path, name: str, shape: tuple[int, ...], dtype: npt.DTypeLike
) -> npt.NDArray[Any]:
    """Return a new, unfilled array in FOLDER/NAME.npy. Raises OSError if the disk has no room for it."""
    path = folder / f"{name}.npy"
    array = np.lib.format.open_memmap(path, mode="w+", dtype=np.dtype(dtype), shape=shape)
    with path.open("r+b") as file:
        # else a full disk would kill the process when a page is written
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    return array


class Spool:
    """The observations of several views in an unnamed file, which is removed when nothing uses it any more."""

    def __init__(self, folder: Path) -> None:
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115, see close
        self._parts: list[
            tuple[str, dict[str, tuple[int, np.dtype[Any], tuple[int, ...]]]]
        ] = []

    def close(self) -> None:
        """Give the file up."""
        self._file.close()

    def append(self, seen: Seen) -> None:
        """Write a view's observations. Raises OSError if the disk is full."""
        where = {}
        for field in ("pixels", "distance", "colour", "ray"):
            values = getattr(seen, field)
            if values is not None:
                where[field] = (self._file.tell(), values.dtype, values.shape)
                self._file.write(np.ascontiguousarray(values).data)
                self._file.write(bytes(-values.nbytes % 8))  # align each array to its type
        self._parts.append((seen.name, where))

    def parts(self) -> list[Seen]:
        """Return the observations of all views; their arrays are read from the file when used."""
        self._file.flush()
        whole = np.memmap(self._file, np.uint8, "r") if self._parts else None
        return [
            Seen(
                name,
                **{
                    field: np.ndarray(shape, dtype, whole, at)
                    for field, (at, dtype, shape) in where.items()
                },
            )
            for name, where in self._parts
        ]
