"""Pairs a target with all views of a scene and collects the observations of its pixels.

A few threads work on the views, so that one decodes files while another pairs. The result does not depend on their
number.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypedDict, TypeVar, get_args

import numpy as np
import numpy.typing as npt
import psutil

from sucre_bench.arrays import Array, Indices, locked
from sucre_bench.camera import Camera
from sucre_bench.errors import InputError, NotApplicableError, SolveError, did_you_mean
from sucre_bench.imaging.encoding import is_grey, srgb_decode
from sucre_bench.machine.compute import compiled, usable_cores
from sucre_bench.machine.progress import say, track
from sucre_bench.multiview.observations import (
    Observations,
    Seen,
    Spool,
    arrange,
    compact,
    new_file,
)
from sucre_bench.multiview.pairing import (
    Matches,
    Surface,
    lift,
    match,
    own_matches,
    visible_pixels,
)
from sucre_bench.scene import View

T = TypeVar("T")

# The encoding of stored colours: the view's own, or linear light.
Kept = Literal["view", "linear"]

# A view is left out when it shows no more than this share of the target's pixels (the authors' program).
MIN_SHARE = 1e-6

# A thread holds an image, its depth and arrays made of them: about 60 MB at 1920x1080.
_MOST_THREADS = 16

# Extrapolate the memory needed once the views done so far cover this share of the pixels that may be visible.
_TELLING_SHARE = 1 / 8


class GreyError(InputError):
    """A view is grey, and the target is not."""


class Options(TypedDict, total=False):
    """The options of `observe` that decide its result."""

    encoding: Kept
    with_view: bool
    with_ray: bool


def observe(
    target: View,
    views: Sequence[View],
    *,
    encoding: Kept = "view",
    with_view: bool = False,
    with_ray: bool = False,
    folder: Path | None = None,
) -> Observations:
    """Pair the target with the views (itself among them) and return all observations of its pixels with depth.

    encoding: "view" keeps colours as they are, "linear" decodes gamma-encoded ones (as sRGB) and keeps 16 bits;
    with_view, with_ray: fill these fields of the result; folder: an empty folder to hold arrays in, not in memory.

    Colours that are not finite give no observation. Left out are views without a pose or depth, views that show 1e-6 of
    the target's pixels or less, views with an unreadable file, and grey photographs where the target has colours.
    Raises NotApplicableError if no pixel of the target has depth, or if it is grey and another view is not. SolveError
    if too little memory is free. InputError if the target has no depth map or pose, or an option is wrong.
    """
    began = time.perf_counter()
    if encoding not in get_args(Kept):
        remedy = did_you_mean(encoding, get_args(Kept))
        raise InputError("unknown", f"encoding={encoding}", remedy)
    _, read_s = _timed(lambda: target.has_depth)
    surface = lift(target)
    if not len(surface.pixels):
        raise NotApplicableError(
            f"{target.name}: no pixel has depth; check its depth map, 0 means unknown"
        )
    if all(view.name != target.name for view in views):
        views = [target, *views]
    visible = visible_pixels(surface, views)
    chosen = [k for k, view in enumerate(views) if visible[k] > 0 or view.name == target.name]
    # observations of the first k + 1, at most
    tried = [views[k] for k in chosen]
    most = np.cumsum(visible[chosen])
    shape = (surface.camera.height, surface.camera.width)
    least = MIN_SHARE * shape[0] * shape[1]
    see = partial(
        _see, surface, target, is_grey(_image(target, encoding)), least, encoding, with_ray
    )
    seen: list[Seen] = []
    unreadable: list[str] = []
    grey: list[str] = []
    with ExitStack() as stack:
        spool = stack.enter_context(closing(Spool(folder))) if folder is not None else None
        outcomes = stack.enter_context(closing(_in_order(see, tried)))
        held = _Held(target.name, with_view, int(most[-1]))
        for k, view in enumerate(track(tried, "pairing")):
            try:
                one, seconds = next(outcomes).result()
            except InputError as fault:
                if view.name == target.name:
                    raise
                (grey if isinstance(fault, GreyError) else unreadable).append(str(fault))
                say(f"{target.name}: leaves out {view.name}: {fault}")
                continue
            read_s += seconds
            if one is not None and spool is not None:
                spool.append(one)
            elif one is not None:
                seen.append(one)
                held.add(one, int(most[k]))
        if spool is not None:
            seen = spool.parts()
    if not seen:
        raise SolveError(
            f"{target.name}: no pixel has both depth and colour; check its image for NaN"
        )
    empty = None if folder is None else partial(new_file, folder)
    observations = arrange(shape, seen, with_view=with_view, free=True, empty=empty)
    pair_s = time.perf_counter() - began
    return replace(
        observations,
        unreadable=tuple(unreadable),
        grey=tuple(grey),
        read_s=read_s,
        pair_s=pair_s,
    )


def _timed(load: Callable[[], T]) -> tuple[T, float]:
    began = time.perf_counter()
    return load(), time.perf_counter() - began


def _in_order(
    work: Callable[[View], T], views: Sequence[View]
) -> Generator[Future[T], None, None]:
    """Yield the results of a few threads in the order of the views; the threads work only a few views ahead."""
    n_threads = min(usable_cores(), _MOST_THREADS, len(views))
    with ThreadPoolExecutor(n_threads) as pool:
        ahead: deque[Future[T]] = deque()
        try:
            for view in views:
                ahead.append(pool.submit(work, view))
                if len(ahead) > n_threads + 1:
                    yield ahead.popleft()
            while ahead:
                yield ahead.popleft()
        finally:
            for future in ahead:
                future.cancel()


def _image(view: View, encoding: Kept) -> npt.NDArray[Any]:
    """The image of a view; where no colour is computed of it, its mapped 8-bit levels will do."""
    levels = view.levels if encoding == "view" else None
    return view.rgb if levels is None else levels


def _see(
    surface: Surface,
    target: View,
    is_target_grey: bool,
    least: float,
    encoding: Kept,
    with_ray: bool,
    view: View,
) -> tuple[Seen | None, float]:
    """The observations in a view, None if there are `least` or fewer; and the seconds spent reading."""
    _, read_s = _timed(lambda: view.has_depth)
    matches = own_matches(surface) if view.name == target.name else match(surface, view)
    if matches is None or len(matches.pixels) <= least:
        return None, read_s
    began = time.perf_counter()
    rgb = _image(view, encoding)
    read_s += time.perf_counter() - began
    if is_grey(rgb) != is_target_grey:
        if is_target_grey:
            remedy = "give this photograph in colour"
            raise NotApplicableError(f"{target.name}: is grey, {view.name} is not; {remedy}")
        raise GreyError("is grey, the target is not", view.name, "give it in colour")
    assert view.camera is not None
    if rgb.shape[:2] != (view.camera.height, view.camera.width):
        sizes = f"{rgb.shape[1]}x{rgb.shape[0]}, the camera's {view.camera.width}x{view.camera.height}"
        raise InputError(
            f"the image is {sizes}", view.name, "use the images that the cameras belong to"
        )
    matches, colour = colours_at(
        matches, rgb, encoding == "linear" and view.encoding == "gamma"
    )
    if not len(colour):
        return None, read_s
    ray = rays_at(matches, view.camera) if with_ray else None
    return Seen(view.name, matches.pixels, matches.distance, colour, ray), read_s


@dataclass(slots=True)
class _Held:
    """Watches the memory that observations take; see `_TELLING_SHARE`."""

    target: str
    with_view: bool

    n_visible: int
    """The most observations that all views together may give."""

    # Bytes of the views' observations until now, and of the result that is made of them.
    parts: int = 0
    result: int = 0

    def add(self, one: Seen, n_tried: int) -> None:
        """Count a view's observations. Raises SolveError as soon as the memory is bound to run out."""
        arrays = [one.distance, one.colour, *([] if one.ray is None else [one.ray])]
        self.result += sum(array.nbytes for array in arrays) + (
            2 * len(one.pixels) if self.with_view else 0
        )
        self.parts += sum(array.nbytes for array in arrays) + one.pixels.nbytes
        share = n_tried / self.n_visible if n_tried > _TELLING_SHARE * self.n_visible else 1.0
        needed = (self.parts + self.result) / share
        free = psutil.virtual_memory().available + self.parts
        if needed > free:
            sizes = f"its observations take some {needed / 1e9:.1f} GB of memory, {free / 1e9:.1f} GB are free"
            cure = "use fewer views or smaller images"
            raise SolveError(f"{self.target}: {sizes}; {cure}")


def colours_at(
    matches: Matches, rgb: npt.NDArray[Any], decode: bool
) -> tuple[Matches, npt.NDArray[Any]]:
    """Return the matches with a finite colour, and their colours (M, 3), uint8, uint16 or float32 (see `compact`).

    rgb: (H, W, 3) float32 in [0, 1], the view's; decode: convert sRGB to linear light, as uint16. Instead, for matches
    of pixels and without `decode`, rgb may hold the levels as uint8.
    """
    if rgb.dtype == np.uint8:
        levels = np.empty((len(matches.others), 3), rgb.dtype)
        compiled(_gather)(
            locked(np.ascontiguousarray(rgb).reshape(-1, 3)), locked(matches.others), levels
        )
        return matches, levels
    nearest = rgb.reshape(-1, 3)[matches.others]
    colours = srgb_decode(nearest) if decode else nearest
    if not np.isfinite(colours).all():
        which = np.asarray(np.isfinite(colours).all(axis=-1))
        colours = colours[which]
        matches = matches.only(which)
    return matches, _levels(colours) if decode else compact(colours)


def _gather(levels: npt.NDArray[Any], others: Indices, colours: npt.NDArray[Any]) -> None:
    for i in range(len(others)):
        pixel = others[i]
        colours[i, 0], colours[i, 1], colours[i, 2] = (
            levels[pixel, 0],
            levels[pixel, 1],
            levels[pixel, 2],
        )


def _levels(colours: Array) -> npt.NDArray[np.uint16]:
    full = np.iinfo(np.uint16).max
    levels = colours * np.float32(full)
    np.rint(levels, out=levels)
    return np.clip(levels, 0, full, out=levels).astype(np.uint16)


def rays_at(matches: Matches, camera: Camera) -> Array:
    """Return the rays (2, M) float32 to the matched points: x / z and y / z in the frame of the view's camera."""
    at = matches.at
    if at is None:
        # (M, 2)
        at = (
            np.stack([matches.others % camera.width, matches.others // camera.width], axis=1)
            + 0.5
        )
    K_inv = np.linalg.inv(camera.K)
    return np.asarray(K_inv[:2, :2] @ at.T + K_inv[:2, 2:], dtype=np.float32)
