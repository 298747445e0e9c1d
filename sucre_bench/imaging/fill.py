"""Colours for pixels without depth: the option `fill`, for maps and mosaics that need whole pictures.

Such a pixel gets a distance from its surroundings, and then the method's own water on its own intensity. These colours
are a guess: they stay apart from the restored image (`Restoration.filled`), are drawn, and are never scored.

Inverse distances are completed: on a plane they are linear in pixel coordinates. They are the solution of Laplace's
equation on a grid of cells, with weak links across edges of the image. So a hole holds no distance beyond those around
it. Distances run evenly from one side to the other, and edges of depth lie at edges of the image.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sucre_bench.arrays import Array, Mask
from sucre_bench.imaging.encoding import converted
from sucre_bench.imaging.filters import guided_filter
from sucre_bench.imaging.image_formation import ChannelWater, TwoTerm, distances, without_water
from sucre_bench.scene import Restoration, View, Water

# The longest side of the grid in cells, the contrast that counts as an edge, and the least link across one.
_CELLS = 200
_EDGE = 0.05
_WEAKEST = 1e-3

# Variance of the guide below which it counts as flat, when distances are brought to the image's pixels.
_FLAT = 1e-3

# Standard deviation of a completed distance, as a share of it.
GUESS = 0.3


@dataclass(frozen=True)
class FillOption:
    """The option of methods that need depth."""

    fill: bool = False
    """Also colour pixels without depth, with distances from their surroundings. Pictures show them; metrics do not
    score them."""

    def filled(
        self, restoration: Restoration, view: View, colours: Callable[[Array], Array]
    ) -> Restoration:
        """Return a restoration with colours for the pixels without depth; unchanged without `fill`, or where none is.

        colours: returns the method's image (H, W, 3), in the view's encoding, at distances (H, W), 0 = not wanted.
        """
        if not self.fill:
            return restoration
        z = fill_distances(view)
        return replace(restoration, filled=colours(z)) if z.any() else restoration


def completed_distance(z: Array, guide: Array) -> Array:
    """Return distances (H, W) float32 without unknown ones; known ones stay as they are.

    z: (H, W) metres, 0 = unknown, at least one known; guide: (H, W, 3), [0, 1], whose edges distances follow.
    """
    import cv2

    known = z > 0
    height, width = z.shape
    n = cell_px(known)
    inverse, share = (
        in_cells(np.divide(1, z, out=np.zeros_like(z), where=known), n),
        in_cells(known, n),
    )
    solved = continued(
        np.where(share > 0, inverse / np.maximum(share, 1e-9), 0), share > 0, in_cells(guide, n)
    )
    fine = cv2.resize(solved, (width, height), interpolation=cv2.INTER_LINEAR)
    fine = guided_filter(guide, np.where(known, 1 / np.where(known, z, 1), fine), 2 * n, _FLAT)
    fine = fine.clip(1 / z[known].max(), 1 / z[known].min())
    return np.where(known, z, 1 / fine).astype(np.float32)


def cell_px(mask: Mask) -> int:
    """Return the side of a cell, pixels, in an image of the size of a mask (H, W)."""
    return -(-max(mask.shape) // _CELLS)


def in_cells(plane: Array | Mask, n: int) -> Array:
    """Return the means of a plane (H, W) or (H, W, C) over cells of n x n pixels, float32."""
    import cv2

    height, width = plane.shape[:2]
    size = (-(-width // n), -(-height // n))
    plane = plane.astype(np.float32, copy=False)
    return np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def continued(values: Array, known: Mask, guide: Array, pull: Array | None = None) -> Array:
    """Return values (H, W) float32 whose unknown ones are the weighted means of their neighbours.

    guide: (H, W, 3), [0, 1], across whose edges links are weak; pull: (H, W), the weight of a 0 beside that of the
    neighbours, each at most 1; None for none.
    """
    from scipy.sparse import coo_array
    from scipy.sparse.linalg import spsolve

    if known.all():
        return values.astype(np.float32)
    number = np.arange(values.size).reshape(values.shape)
    pairs: list[tuple[Any, Any]] = [(np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1], np.s_[1:])]
    one = np.concatenate([number[a].ravel() for a, _ in pairs])
    other = np.concatenate([number[b].ravel() for _, b in pairs])
    contrast = ((guide.reshape(-1, 3)[one] - guide.reshape(-1, 3)[other]) ** 2).sum(axis=1)
    link = np.exp(-contrast / (2 * _EDGE**2)) + _WEAKEST
    links = coo_array(
        (np.r_[link, link], (np.r_[one, other], np.r_[other, one])), shape=(values.size,) * 2
    ).tocsr()
    unknown, given = (np.flatnonzero(which) for which in (~known, known))
    rows: Any = links[unknown]
    matrix = -rows[:, unknown]
    matrix.setdiag(rows.sum(axis=1) + (0 if pull is None else pull.ravel()[unknown]))
    solved = values.astype(np.float64).ravel()
    solved[unknown] = spsolve(matrix.tocsc(), rows[:, given] @ solved[given])
    return solved.reshape(values.shape).astype(np.float32)


def fill_distances(view: View) -> Array:
    """Return distances (H, W) float32 of the pixels without depth, 0 where depth is known."""
    z, _ = distances(view)
    return np.where(
        z > 0, 0, completed_distance(z, converted(view.rgb, view.encoding, "gamma"))
    ).astype(np.float32)


def filled_by_water(view: View, water: Water, z: Array) -> Array:
    """Return J (H, W, 3) of the view's intensities in a water, in its encoding; NaN where z (H, W) is 0."""
    parameters = zip(water.veiling_light, water.backscatter, water.attenuation, strict=True)
    of_channels = [ChannelWater(B, gamma, TwoTerm(beta)) for B, gamma, beta in parameters]
    return without_water(
        converted(view.rgb, view.encoding, water.encoding or view.encoding), z, of_channels
    )


def deviation_of_guess(J: Array, water: Water, z: Array) -> Array:
    """Return the standard deviation (3, P) that a guessed distance z (P,) gives colours J (3, P)."""
    B, beta, gamma = (
        np.asarray(p)[:, None]
        for p in (water.veiling_light, water.attenuation, water.backscatter)
    )
    slope = beta * J - B * gamma * np.exp((beta - gamma) * z)  # dJ/dz
    return np.asarray(np.abs(slope) * GUESS * z)
