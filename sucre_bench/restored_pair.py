"""The input of a metric of several restored views: two restored views of a scene, and the points that both show."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from sucre_bench.arguments import checked_fields
from sucre_bench.arrays import Array, Indices, locked
from sucre_bench.scene import View


@dataclass(frozen=True, eq=False)
class RestoredView:
    """A view and its restoration by one method. The pictures are read when they are needed."""

    view: View
    """The photograph, with camera, pose and depth."""

    read_shown: Callable[[], Array] = field(repr=False)
    """Function that reads `shown`."""

    read_image: Callable[[], Array | None] = field(default=lambda: None, repr=False)
    """Function that reads `image`."""

    @cached_property
    def shown(self) -> Array:
        """(H, W, 3) float32 in [0, 1], gamma-encoded, NaN = no colour: the restored image. A stored one has 8 bits."""
        return locked(self.read_shown())

    @cached_property
    def image(self) -> Array | None:
        """(H, W, 3) float32 in the view's encoding, NaN = no colour: J. None unless the run had save=full."""
        image = self.read_image()
        return None if image is None else locked(image)


@dataclass(frozen=True, slots=True, weakref_slot=True, eq=False)
class CommonPoints:
    """The pixels of two views that show the same P patches of the scene."""

    here: Indices
    """(M,) int32: flat pixel indices in the first view."""

    there: Indices
    """(N,) int32: flat pixel indices in the second view."""

    here_patch: Indices
    """(M,) int32 in [0, P): the patch of each pixel in `here`."""

    there_patch: Indices
    """(N,) int32 in [0, P): the patch of each pixel in `there`."""

    distance: Array
    """(2, P) float64 metres: of each patch from the first and the second camera."""

    def __len__(self) -> int:
        """Return P, the number of patches."""
        return self.distance.shape[1]

    def turned(self) -> CommonPoints:
        """Return the same points with the two views exchanged."""
        return CommonPoints(
            self.there, self.here, self.there_patch, self.here_patch, self.distance[::-1]
        )


@dataclass(frozen=True, eq=False)
@checked_fields
class RestoredPair:
    """Two views that one method restored, and the patches of the scene that both show.

    >>> from sucre_bench import Arrays, View
    >>> dark, light = (RestoredView(View(name, Arrays(np.zeros((8, 8, 3)))), lambda g=g: np.full((8, 8, 3), g))
    ...                for name, g in (("a.png", 0.25), ("b.png", 0.5)))
    >>> whole = np.arange(64), np.zeros(64, int)  # all pixels of both views show the one patch
    >>> pair = RestoredPair(dark, light, CommonPoints(whole[0], whole[0], whole[1], whole[1], np.ones((2, 1))))
    >>> [mean.tolist() for mean in pair.means(pair.here.shown, pair.there.shown)]
    [[[0.25, 0.25, 0.25]], [[0.5, 0.5, 0.5]]]
    """

    here: RestoredView
    """The first restored view."""

    there: RestoredView
    """The second restored view."""

    points: CommonPoints
    """The pixels that show the same patches."""

    are_neighbours: bool = True
    """Whether one view is among the two views that overlap the other most."""

    def means(self, here: Array, there: Array) -> tuple[Array, Array]:
        """Return the mean colours (P, 3) float64 of the common patches in images (H, W, 3) of the two views.

        Both are NaN for a patch if less than 3/4 of its pixels have a colour in one of the images.
        """
        points = self.points
        first = self._means(here, points.here, points.here_patch)
        second = self._means(there, points.there, points.there_patch)
        absent = np.isnan(first).any(axis=1) | np.isnan(second).any(axis=1)
        first[absent] = second[absent] = np.nan
        return first, second

    def _means(self, image: Array, pixels: Indices, patch: Indices) -> Array:
        n = len(self.points)
        colours = image.reshape(-1, 3)[pixels]
        known = np.isfinite(colours).all(axis=1)
        patches = patch[known]
        counted = np.bincount(patches, minlength=n)
        sums = np.stack(
            [np.bincount(patches, column, n) for column in colours[known].T], axis=1
        )
        enough = counted >= np.maximum(1, _LEAST * np.bincount(patch, minlength=n))
        return np.where(enough[:, None], sums / np.maximum(counted, 1)[:, None], np.nan)


_LEAST = 0.75  # of a patch's pixels
