"""Fits a view of any size to a network: resizes it, mirrors its edges, or cuts it into blended tiles."""

from collections.abc import Callable, Sequence

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.resizing import resized_by_pillow
from sucre_bench.machine.progress import track
from sucre_bench.scene import Restoration, View


def limited(image: Array, longest: int | None) -> tuple[int, int]:
    """Return the height and width of an image, scaled down so that neither exceeds `longest`; None limits nothing."""
    height, width = image.shape[:2]
    share = min(1.0, (longest or max(height, width)) / max(height, width))
    return max(1, round(height * share)), max(1, round(width * share))


def resized(image: Array, height: int, width: int) -> Array:
    """Return an image (H, W, 3) at another size, float32: bicubic, wide enough not to alias when it shrinks.

    The bicubic filter of Pillow, in which most published networks were given their images. It may overshoot.
    """
    if image.shape[:2] == (height, width):
        return image
    return resized_by_pillow(image.astype(np.float32), (width, height), "bicubic")


def restored_at(
    view: View, at: tuple[int, int], device: str, run: Callable[[Array], Array]
) -> Restoration:
    """Return the whole image of a view, restored by `run` at another size and brought back to the view's.

    at: height and width that `run` is given, (H, W, 3) to (H, W, 3); device: where it runs. info: device, worked_at
    (height and width).
    """
    height, width = view.rgb.shape[:2]
    restored = run(resized(view.rgb, *at))
    return Restoration(
        resized(restored, height, width),
        info={"device": device, "worked_at": f"{at[0]}x{at[1]}"},
    )


def tiled(
    images: Sequence[Array],
    run: Callable[[Array], Array],
    tile: int | None,
    overlap: int = 0,
    multiple: int = 1,
    least: int = 1,
) -> Array:
    """Return what `run` makes of images (H, W, C) of one size, their channels joined, in tiles: (H, W, 3) float32.

    run: (h, w, channels of all) -> (h, w, 3), where h and w are multiples of `multiple` and not below `least`; images
    are continued by their mirror image up to such a size. tile: longest side of a tile, None for one tile. The outer
    quarters of the `overlap` of two tiles are not used. The rest is blended linearly. If the network reaches no further
    than a quarter, the result is that of a single tile.
    """
    height, width = images[0].shape[:2]
    wanted = [(n, _up(max(n, least), multiple)) for n in (height, width)]
    # Each line's own pixels, then back again, as often as it takes.
    rows, columns = (np.pad(np.arange(n), (0, up - n), mode="symmetric") for n, up in wanted)
    down, right = (_tiles(len(at), tile, overlap, multiple) for at in (rows, columns))
    restored = np.zeros((len(rows), len(columns), 3), dtype=np.float32)
    places = [(y, x) for y in down for x in right]
    for (y, vertical), (x, horizontal) in track(places, "tiles") if len(places) > 1 else places:
        here = np.ix_(rows[y : y + len(vertical)], columns[x : x + len(horizontal)])
        part = run(np.concatenate([image[here] for image in images], axis=-1))
        weight = vertical[:, None, None] * horizontal[:, None]
        restored[y : y + len(vertical), x : x + len(horizontal)] += weight * part
    return restored[:height, :width]


def _up(length: int, multiple: int) -> int:
    return -(-length // multiple) * multiple


def _tiles(
    length: int, tile: int | None, overlap: int, multiple: int
) -> list[tuple[int, Array]]:
    """Where along a line tiles start, on multiples, and the weight of each of their pixels; weights add up to 1."""
    shared = _up(overlap, multiple)
    n = (
        1
        if tile is None or length <= tile
        else -(-(length - shared) // max(multiple, tile - shared))
    )
    # all alike, none narrow
    size = min(length, _up(-(-(length + (n - 1) * shared) // n), multiple))
    rising = (
        ((np.arange(size) + 0.5 - overlap / 4) / max(overlap / 2, 1e-6))
        .clip(0, 1)
        .astype(np.float32)
    )
    tiles = []
    total = np.zeros(length, dtype=np.float32)
    for start in (min(i * (size - shared), length - size) for i in range(n)):
        weight = np.ones_like(rising) if start == 0 else rising.copy()
        weight *= 1 if start == length - size else rising[::-1]
        total[start : start + size] += weight
        tiles.append((start, weight))
    return [(start, weight / total[start : start + size]) for start, weight in tiles]
