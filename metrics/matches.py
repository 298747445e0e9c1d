"""Matches: how many more points can be matched between restored views than between the photographs.

SIFT (Lowe 2004) finds keypoints in both views. The nearest descriptor is a match if it is nearer than 0.8 of the second
nearest. The same must hold for the nearest from the other side. A match is verified if its keypoints lie where depth
and poses put the point, within 1 % of the image's diagonal. The geometry is known, so nothing is drawn at random.
"""

import functools
from collections.abc import Iterator
from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import AnyArray, Array, Mask, locked, once
from sucre_bench.camera import depth_at, moved, project, relative_pose, unproject
from sucre_bench.errors import NotApplicableError
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_formation import reduced
from sucre_bench.plugins.plugin import metric
from sucre_bench.restored_pair import CommonPoints, RestoredPair
from sucre_bench.scene import Encoding, Score, View

# Keypoints are sought in images of at most so many pixels a side, and so many are kept, the strongest.
_SIDE_PX = 1280
_MOST = 4000

# Holes are filled with the mean of their surroundings, a square of this side, so that they have few keypoints.
_AROUND_PX = 31

_RATIO = 0.8
_NEAR = 0.01  # of the diagonal


@metric(
    needs={"restored_views", "depth", "poses"},
    requires=["cv2"],
    unit="",
    better="higher",
    range=(-np.inf, np.inf),
    symbol="verified matches, restored / photograph",
    cites="Summers, Sensors 2025, 25(22) 6966; Lowe 2004",
    default=["doublings", "ratio"],
    agreement={"doublings": 0.35},  # over three made waters and the charts of D5, 18 restorers
    variants={
        "doublings": "log2 of (matches restored + 1) / (matches before + 1), the mean over pairs",
        "ratio": "verified matches restored over before; of several pairs the ratio of the sums",
    },
)
@dataclass(frozen=True)
class Matches:
    """Verified matches between neighbouring restored views, compared with those between the photographs.

    A view's neighbours are the two that overlap most with it. Ratios differ between views by orders of magnitude, where
    hazy photographs hardly match: compare methods by their doublings.
    """

    def score_pair(self, pair: RestoredPair, variant: str) -> Iterator[Score]:
        """Yield the score if the two are neighbours.

        Raises NotApplicableError for a ratio if the photographs have no match, and for two views without colours.
        """
        if not pair.are_neighbours:
            return
        if pair.points not in _of_photographs:
            views = (pair.here.view, pair.there.view)
            first, second = (_of_photograph(view.rgb, view.encoding) for view in views)
            _of_photographs[pair.points] = _verified(views, (first, second))
        before = _of_photographs[pair.points]
        after = _after(pair)
        share = float(
            np.mean(
                [
                    np.isfinite(side.shown).all(axis=-1).mean()
                    for side in (pair.here, pair.there)
                ]
            )
        )
        if variant == "ratio":
            if not before:
                raise NotApplicableError("the photographs have no verified matches")
            yield Score(after / before, n_pixels=after, coverage=share, weight=before)
        else:
            if not share:
                raise NotApplicableError("the restored views have no colours")
            yield Score(
                float(np.log2((after + 1) / (before + 1))), n_pixels=after, coverage=share
            )


# The verified matches between the photographs, the same for all methods, which share the pair's points: their key.
_of_photographs: WeakKeyDictionary[CommonPoints, int] = WeakKeyDictionary()


@functools.lru_cache(maxsize=1)  # the variants of a pair are scored one after the other
def _after(pair: RestoredPair) -> int:
    """The verified matches between the restored images."""
    found = (_keypoints(pair.here.shown), _keypoints(pair.there.shown))
    return _verified((pair.here.view, pair.there.view), found)


@dataclass(frozen=True, slots=True, eq=False)
class _Keypoints:
    """The keypoints of a picture."""

    xy: Array
    """Pixel coordinates, (N, 2) float64, pixel centres at +0.5."""

    descriptors: npt.NDArray[np.float32]
    """Shape (N, 128), float32."""


@once
def _of_photograph(rgb: Array, encoding: Encoding) -> _Keypoints:
    """The keypoints of a view as it was taken (H, W, 3)."""
    return _keypoints(locked(display(rgb, "none", encoding)))


@once
def _keypoints(shown: Array) -> _Keypoints:
    """The keypoints of a picture (H, W, 3) in [0, 1], NaN = no colour."""
    import cv2

    usable: AnyArray = np.asarray(np.isfinite(shown).all(axis=-1), np.uint8)
    luma = cv2.cvtColor(to_8bit(shown), cv2.COLOR_RGB2GRAY)
    sums, counts = (
        cv2.blur(
            values.astype(np.float32), (_AROUND_PX, _AROUND_PX), borderType=cv2.BORDER_CONSTANT
        )
        for values in (luma * usable, usable)
    )
    gray: AnyArray = np.where(usable, luma, sums / np.maximum(counts, 1e-6)).astype(np.uint8)
    small = reduced(gray, _SIDE_PX)
    size = small.shape[1::-1]
    usable = cv2.resize(usable, size, interpolation=cv2.INTER_NEAREST)
    points, descriptors = cv2.SIFT.create(nfeatures=_MOST).detectAndCompute(small, usable)
    if descriptors is None:
        return _Keypoints(np.empty((0, 2)), np.empty((0, 128), np.float32))
    xy = (np.array([point.pt for point in points]) + 0.5) * (
        gray.shape[1] / size[0],
        gray.shape[0] / size[1],
    )
    return _Keypoints(xy, np.asarray(descriptors, dtype=np.float32))


def _verified(views: tuple[View, View], found: tuple[_Keypoints, _Keypoints]) -> int:
    """The number of matches that depth and poses confirm."""
    first, second = found
    if min(len(first.xy), len(second.xy)) < 2:
        return 0
    norms = [(features.descriptors**2).sum(axis=1) for features in found]
    squares = norms[0][:, None] + norms[1] - 2 * first.descriptors @ second.descriptors.T
    nearest, is_clear = _nearest(squares)
    nearest_back, is_clear_back = _nearest(squares.T)
    mutual = nearest_back[nearest] == np.arange(len(nearest))
    here = np.flatnonzero(is_clear & is_clear_back[nearest] & mutual)
    there = nearest[here]
    ahead = _errors(views[0], views[1], first.xy[here], second.xy[there])
    back = _errors(views[1], views[0], second.xy[there], first.xy[here])
    # at an outline, one depth may be another surface's
    return int(np.count_nonzero(np.fmin(ahead, back) <= _NEAR))


def _nearest(squares: npt.NDArray[np.float32]) -> tuple[npt.NDArray[np.intp], Mask]:
    """The nearest column of each row, and whether it is much nearer than the second. squares: of distances."""
    rows = np.arange(len(squares))
    nearest = squares.argmin(axis=1)
    best = squares[rows, nearest]
    squares[rows, nearest] = np.inf
    second = squares.min(axis=1)
    squares[rows, nearest] = best
    return nearest, best < _RATIO**2 * second


def _errors(source: View, target: View, xy: Array, matched: Array) -> Array:
    """How far matches lie from where they should, (N,) in diagonals of the target; NaN without depth."""
    (source_camera, source_pose), (camera, pose) = source.placed, target.placed
    depth = depth_at(source.depth, xy)
    points = unproject(source_camera, xy[:, 0], xy[:, 1], depth).T
    expected, _ = project(camera, moved(points, relative_pose(pose, source_pose)))
    errors = np.linalg.norm(expected - matched, axis=1) / np.hypot(camera.width, camera.height)
    return np.where(depth > 0, errors, np.nan)
