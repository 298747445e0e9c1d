"""Fills small holes of a depth map in flat, untextured objects, for example patches of a colour chart."""

import numpy as np

from sucre_bench.arrays import Array

_LARGEST = 0.01  # share of the image
_RIM = 3  # pixels: width of the rim around a hole
_FEWEST = 12  # fewest pixels of a rim
_FLAT = 0.005  # relative distance from one plane that nine tenths of the rim must keep


def without_small_holes(depth: Array) -> Array:
    """Return planar depth (H, W) with every hole filled whose rim lies on one plane.

    On a plane inverse depth is linear in pixel coordinates. A hole at the image's border, or between an object and its
    background, has no such rim and stays 0.
    """
    import cv2

    count, labels, stats, _ = cv2.connectedComponentsWithStats((depth <= 0).astype(np.uint8), connectivity=8)
    filled = depth.copy()
    height, width = depth.shape
    for label in range(1, count):
        x, y, wide, high, area = stats[label]
        if area > _LARGEST * depth.size or x == 0 or y == 0 or x + wide == width or y + high == height:
            continue
        window = np.s_[max(0, y - _RIM) : y + high + _RIM, max(0, x - _RIM) : x + wide + _RIM]
        hole = labels[window] == label
        around = cv2.dilate(hole.astype(np.uint8), np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)) > 0
        rows, columns = np.nonzero(around & (depth[window] > 0))
        if len(rows) < _FEWEST:
            continue
        w = 1 / depth[window][rows, columns].astype(np.float64)
        design = np.column_stack([columns, rows, np.ones(len(rows))])
        plane = np.linalg.lstsq(design, w, rcond=None)[0]
        if np.quantile(np.abs(design @ plane / w - 1), 0.9) > _FLAT:
            continue
        rows, columns = np.nonzero(hole)
        inside = plane[0] * columns + plane[1] * rows + plane[2]
        if inside.min() > 0:
            filled[window][hole] = 1 / inside
    return filled
