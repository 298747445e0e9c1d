"""Measures how much views overlap and whether their depth maps agree, and finds the mistake that explains it if not.

A point of a view projects to a pixel of another view at depth Z. With that view's own depth d it sees the same place if
|d - Z| <= 5 % of Z. In consistent data the median of |d - Z| / Z is a few per mille. If it is larger, the usual
mistakes are undone one by one: distances in place of depth, depth in another unit than the poses, inverted poses. A
mistake whose undoing makes far more points agree is named.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.camera import depth_at, moved, pixel_rays, project, relative_pose, unproject
from sucre_bench.machine.progress import track
from sucre_bench.multiview.pairing import lift, visible_pixels
from sucre_bench.programs.describe.view_facts import Look
from sucre_bench.scene import Arrays, View

_AGREES = 0.05
_FIRM, _LOOSE = 0.01, 0.06  # relative tolerance in the search for mistakes: of one, and of scales on a coarse grid
_PARTNER = 0.05  # share of a view's points that another one must see to overlap
_MOST_TARGETS = 40  # views that are compared with all others, evenly chosen
_MOST_POINTS = 8000  # of a view
_SCALES = (0.001, 0.01, *(float(s) for s in np.geomspace(0.1, 10, 41)), 100.0, 1000.0)


@dataclass(frozen=True)
class Overlap:
    """The overlap of one view with the others.

    seen: share of its points that at least one other view sees; partners: number of views that see 5 % of them or more;
    disagreement: median of |d - Z| / Z of its points that project into others, None if there are none.
    """

    view: str
    seen: float
    partners: int
    disagreement: float | None


Mistake = Literal["distance for depth", "inverted poses", "OpenGL poses", "unit of depth"]


def overlaps(looks: Sequence[Look]) -> list[Overlap]:
    """Return the overlap of up to 40 views, evenly chosen, with all others; views need pose and depth."""
    views = placed(looks)
    return [_overlap(views[k], views) for k in track(evenly(len(views), _MOST_TARGETS), "overlaps")]


def suspect(looks: Sequence[Look]) -> tuple[Mistake, str, str] | None:
    """Return the mistake that best explains why depth maps disagree, its text and remedy; None if no known one does.

    Without it at least half as many points more must agree, and at least a tenth of all.
    """
    views = placed(looks)
    targets = evenly(len(views), _MOST_TARGETS)
    targets = targets[:: max(1, len(targets) // 8)]
    pairs = [(k, j) for k in targets for j in range(max(0, k - 2), min(len(views), k + 3)) if j != k]
    as_is = _agreeing(views, pairs)
    coarse = max(_SCALES, key=lambda scale: _agreeing(views, pairs, _LOOSE, scale))
    scale = max((coarse * (1 + k / 100) for k in range(-6, 7)), key=lambda s: _agreeing(views, pairs, _FIRM, s))
    remedy = f"multiply depth by {scale:.3g}, or divide positions"
    tried: list[tuple[Mistake, str, str, Callable[[View], View]]] = [
        *_MISTAKES,
        ("unit of depth", f"depth is {1 / scale:.3g} times that of the poses", remedy, lambda v: _scaled(v, scale)),
    ]
    shares = [_agreeing([change(view) for view in views], pairs) for *_, change in tried]
    mistake, what, remedy, _ = tried[int(np.argmax(shares))]
    if max(shares) <= max(1.5 * as_is, 0.1):
        return None
    agreeing = f"{as_is:.0%} of points agree between views, {max(shares):.0%} without that mistake"
    return mistake, f"{what}: {agreeing}", remedy


def placed(looks: Sequence[Look]) -> list[View]:
    """Return the reduced views that have camera, pose and depth."""
    return [view for look in looks if (view := look.small) is not None]


def _overlap(view: View, views: Sequence[View]) -> Overlap:
    *_, points = some_points(view, _MOST_POINTS)
    seen, partners, off = np.zeros(len(points), bool), 0, []
    for other, most in zip(views, visible_pixels(lift(view), views), strict=True):
        if other is view or not most:
            continue
        rel = np.abs(_landing(points, view, other))
        agrees = rel <= _AGREES
        seen |= agrees
        partners += bool(agrees.mean() >= _PARTNER)
        if np.isfinite(rel).mean() >= _PARTNER:
            off.append(rel[np.isfinite(rel)])
    disagreement = float(np.median(np.concatenate(off))) if off else None
    return Overlap(view.name, float(seen.mean()) if len(seen) else 0.0, partners, disagreement)


def _agreeing(
    views: Sequence[View], pairs: Sequence[tuple[int, int]], tolerance: float = _FIRM, scale: float = 1.0
) -> float:
    """The share of points that project to a place of the same depth in another view, all depth maps times a factor."""
    points = {k: some_points(views[k], _MOST_POINTS)[2][::8] for k in {k for k, _ in pairs}}  # a few are enough
    agreeing = [np.abs(_landing(points[k] * scale, views[k], views[j], scale)) <= tolerance for k, j in pairs]
    return float(np.concatenate(agreeing).mean()) if agreeing else 0.0


def some_points(view: View, most: int) -> tuple[Indices, Indices, Array]:
    """Return row and column (P,) of about so many pixels with depth, and their points (P, 3) in the camera's frame."""
    camera, _ = view.placed
    v, u = np.nonzero(view.depth > 0)
    step = max(1, len(u) // most)
    v, u = v[::step], u[::step]
    return v, u, unproject(camera, u + 0.5, v + 0.5, view.depth[v, u].astype(np.float64)).T


def into(other: View, view: View, points: Array) -> Array:
    """Return points (P, 3) of a view's camera in the frame of another one's."""
    return moved(points, relative_pose(other.placed[1], view.placed[1]))


def _landing(points: Array, view: View, other: View, scale: float = 1.0) -> Array:
    """(d - Z) / Z (P,) of a view's points in another view; NaN outside it or without depth there."""
    at, z = project(other.placed[0], into(other, view, points))
    d = depth_at(other.depth, at) * scale
    return np.divide(d - z, z, out=np.full(len(points), np.nan), where=d > 0)


def _scaled(view: View, factor: float | Array) -> View:
    return replace(view, pixels=Arrays(view.rgb, view.depth * factor))


# Each with what it is, its remedy, and what undoes it.
_MISTAKES: tuple[tuple[Mistake, str, str, Callable[[View], View]], ...] = (
    (
        "distance for depth",
        "depth is distance",
        "divide each pixel by the length of its ray, K^-1 (u + .5, v + .5, 1)",
        lambda view: _scaled(view, 1 / np.linalg.norm(pixel_rays(view.placed[0]), axis=-1)),
    ),
    (
        "inverted poses",
        "poses are inverted",
        "give cam_from_world, the inverse of the camera's place in the world",
        lambda view: replace(view, cam_from_world=np.linalg.inv(view.placed[1])),
    ),
    (
        "OpenGL poses",
        "cameras look along -z",
        "turn poses by 180 degrees about the camera's x axis, as from OpenGL",
        lambda view: replace(view, cam_from_world=np.diag([1.0, -1.0, -1.0, 1.0]) @ view.placed[1]),
    ),
)
