"""Weighted blending over scales (Burt & Adelson 1983; Mertens, Kautz & Van Reeth 2007): no seams where weights jump."""

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from sucre_bench.arrays import Array


def blended(images: Sequence[Array], weights: Iterable[Array], levels: int) -> Array:
    """Return the images' weighted mean (H, W, 3), taken in each band of a pyramid: R_l = sum_k G_l(W_k) L_l(I_k).

    images: (H, W, 3) float32; weights: (H, W) float32, one an image, of sum 1 at every pixel; levels: of the pyramid,
    1 or more, the last one low-pass; at most `most_levels`. Values may leave the images' range near strong edges.
    """
    import cv2

    levels = min(levels, most_levels(images[0].shape[:2]))
    sums: list[Array] = []
    for image, weight in zip(images, weights, strict=True):
        for level, band in enumerate(_bands(image, levels)):
            weight = np.asarray(cv2.pyrDown(weight)) if level else weight
            if level == len(sums):
                sums.append(band * weight[..., None])
            else:
                sums[level] += band * weight[..., None]
    result = sums.pop()
    while sums:
        finer = sums.pop()
        result = finer + _enlarged(result, finer.shape)
    return result


def most_levels(shape: tuple[int, ...]) -> int:
    """Return how many levels an image of shape (H, W) has room for: the smaller side of the last is 2 to 4 pixels."""
    return max(1, min(shape).bit_length() - 1)


def _bands(image: Array, levels: int) -> Iterator[Array]:
    """The Laplacian pyramid from fine to coarse: what each level has that the next has not, and the last level."""
    import cv2

    for _ in range(levels - 1):
        coarse: Array = np.asarray(cv2.pyrDown(image))
        yield image - _enlarged(coarse, image.shape)
        image = coarse
    yield image


def _enlarged(coarse: Array, shape: tuple[int, ...]) -> Array:
    """Enlarge a level to the size of the next finer one. The caller gives this size, because half of an odd size was
    rounded up."""
    import cv2

    return np.asarray(cv2.pyrUp(coarse, dstsize=(shape[1], shape[0])))
