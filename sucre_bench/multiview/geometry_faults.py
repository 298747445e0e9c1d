"""Finds faults of poses and depth maps by comparing views of a scene, each with its remedy.

If depth maps of views disagree, the usual mistakes are undone one by one. They are distances or inverse depth in place
of depth, another unit than that of the poses, turned or shifted maps, and poses in other axes or inverted. A mistake is
named if a third of the points agree without it, see docs/prepare.md for what true and false ones reach.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import Array, evenly
from sucre_bench.camera import pixel_rays
from sucre_bench.multiview.overlaps import (
    MOST_POINTS,
    MOST_TARGETS,
    Overlap,
    overlaps,
    reduced,
    seen_from,
    some_points,
)
from sucre_bench.multiview.spread import spread_of, usable
from sucre_bench.scene import Arrays, View

# median relative disagreement of depth; photogrammetry that fits is at .0005 to .01
_DISAGREES = 0.03
_DOUBTFUL = 0.01
_NOTHING = "nothing in common"
# relative tolerance in the search for mistakes: of one, and of scales on a coarse grid
_FIRM = 0.01
_LOOSE = 0.06
_NAMED = 1 / 3  # share of the points that agree without a mistake that is named
_AXES = np.diag([1.0, -1.0, -1.0, 1.0])  # between OpenCV's axes and OpenGL's
_SCALES = (0.001, 0.01, *(float(s) for s in np.geomspace(0.1, 10, 41)), 100.0, 1000.0)


@dataclass(frozen=True)
class Fault:
    """A fault."""

    kind: str
    """Its name, such as "chart"."""

    what: str
    remedy: str

    views: tuple[str, ...] = ()
    """The views concerned, none for the whole scene."""

    def __str__(self) -> str:
        which = ", ".join(self.views[:3]) + (
            f" and {len(self.views) - 3} more" if len(self.views) > 3 else ""
        )
        return f"{which + ': ' if which else ''}{self.what}; {self.remedy}"


def first_look(views: Sequence[View]) -> str:
    """Return what is wrong with units and poses, or else whether the water can be measured; empty if unknown.

    Looks at the views that `usable` takes.
    """
    some = [reduced(view) for view in usable(views)]
    found = geometry_faults(some, overlaps(some)) if len(some) > 1 else []
    wrong = next((fault for fault in found if not fault.views and fault.kind != _NOTHING), None)
    spread = None if wrong else spread_of(some)
    return str(wrong or (spread.sentence("") if spread else ""))


def geometry_faults(views: Sequence[View], between: Sequence[Overlap]) -> list[Fault]:
    """Faults for views whose depth disagrees, or that no other view overlaps."""
    faults = []
    known = [o for o in between if o.disagreement is not None]
    typical = float(np.median([o.disagreement for o in known])) if known else np.inf
    lonely = [o for o in between if not o.partners]
    mistake = _mistake(views) if typical > _DOUBTFUL or len(lonely) > len(between) / 2 else None
    if mistake is not None:
        faults.append(mistake)
    elif typical > _DISAGREES:
        differs = f"depth differs by {typical:.1%} (median) where views overlap"
        remedy = "check that depth maps and poses are of one reconstruction, and their scale"
        seen = (
            ("depth differs", differs) if known else (_NOTHING, "views see nothing in common")
        )
        faults.append(Fault(*seen, remedy))
    worse = [o for o in known if (o.disagreement or 0) > max(_DISAGREES, 3 * typical)]
    if worse:
        names = tuple(o.view for o in worse)
        remedy = "check their depth maps and poses"
        faults.append(
            Fault("view disagrees", "depth disagrees with other views'", remedy, names)
        )
    # A view whose points project into others at other depths lacks no views in between.
    alone = tuple(
        o.view for o in lonely if o not in (worse if typical <= _DISAGREES else known)
    )
    if alone and mistake is None:
        remedy = "add views between; SUCRe has single observations there"
        faults.append(
            Fault("view alone", "no other view sees 5 % of what they show", remedy, alone)
        )
    return faults


def _mistake(views: Sequence[View]) -> Fault | None:
    """The mistake that best explains why depth maps of views disagree; None if no known one does.

    Without it at least half as many points more must agree, and at least a third of all.
    """
    targets = evenly(len(views), MOST_TARGETS)
    targets = targets[:: max(1, len(targets) // 8)]
    pairs = [
        (k, j) for k in targets for j in range(max(0, k - 2), min(len(views), k + 3)) if j != k
    ]
    as_is = _agreeing(views, pairs)
    if 1.5 * as_is >= 1:
        return None
    without = _undone(views, pairs)
    shares = {fault: _agreeing(changed, pairs) for fault, changed in without.items()}
    for fault, changed in without.items():
        # Maps that are alike agree at any scale that makes the cameras' shifts tiny: these say nothing of the scale.
        if (
            fault[0] in ("unit of depth", "inverse depth")
            and 1.5 * _agreeing(changed, pairs, scale=10) > shares[fault]
        ):
            shares[fault] = 0.0
    for before, after in itertools.product((np.eye(4), _AXES), repeat=2):
        axes = "" if (before == after).all() and before[1, 1] > 0 else ", in OpenGL's axes"
        remedy = "give cam_from_world, the inverse of the camera's place in the world"
        undone = [
            replace(view, cam_from_world=before @ np.linalg.inv(view.placed[1]) @ after)
            for view in views
        ]
        fault = "inverted poses", f"poses are inverted{axes}", remedy
        shares[fault] = max(shares.get(fault, 0.0), _agreeing(undone, pairs))
    (kind, what, remedy), share = max(shares.items(), key=lambda item: item[1])
    if share <= max(1.5 * as_is, _NAMED):
        return None
    return Fault(
        kind,
        f"{what}: {as_is:.0%} of points agree between views, {share:.0%} without that mistake",
        remedy,
    )


def _undone(
    views: Sequence[View], pairs: Sequence[tuple[int, int]]
) -> dict[tuple[str, str, str], list[View]]:
    """The views without each known mistake but inverted poses, by its kind, what it is, and the remedy."""
    inverse = [
        _with_depth(
            view, np.divide(1, view.depth, out=np.zeros_like(view.depth), where=view.depth > 0)
        )
        for view in views
    ]
    scale, of_inverse = _best_scale(views, pairs), _best_scale(inverse, pairs)
    rays = "divide each pixel by the length of its ray, K^-1 (u + .5, v + .5, 1)"
    lengths = [np.linalg.norm(pixel_rays(view.placed[0]), axis=-1) for view in views]
    per_m = (
        f"depth is {1 / scale:.3g} times that of the poses",
        f"multiply depth by {scale:.3g}, or divide positions",
    )
    maps = {
        ("distance for depth", "depth is distance", rays): [
            v.depth / n for v, n in zip(views, lengths, strict=True)
        ],
        ("unit of depth", *per_m): [view.depth * scale for view in views],
        ("inverse depth", "depth is 1 / depth", f"write {of_inverse:.3g} / value"): [
            view.depth * of_inverse for view in inverse
        ],
    }
    for how, rows, columns in (
        ("upside down", -1, 1),
        ("mirrored", 1, -1),
        ("turned by 180 degrees", -1, -1),
    ):
        fault = "turned depth maps", f"depth maps are {how}", "write them as the images are"
        maps[fault] = [view.depth[::rows, ::columns] for view in views]
    for step, whose in ((1, "after"), (-1, "before")):
        fault = (
            "shifted depth maps",
            f"each image has the depth map of the one {whose} it",
            "name maps as their images",
        )
        maps[fault] = [views[(k - step) % len(views)].depth for k in range(len(views))]
    without = {fault: [*map(_with_depth, views, depths)] for fault, depths in maps.items()}
    turned = "turn poses by 180 degrees about the camera's x axis, as from OpenGL"
    opengl = [replace(view, cam_from_world=_AXES @ view.placed[1]) for view in views]
    without["OpenGL poses", "cameras look along -z", turned] = opengl
    return without


def _with_depth(view: View, depth: Array) -> View:
    """The view with another depth map; with its own if that has another shape."""
    depth = depth if depth.shape == view.depth.shape else view.depth
    return replace(view, pixels=Arrays(view.rgb, np.ascontiguousarray(depth)))


def _best_scale(views: Sequence[View], pairs: Sequence[tuple[int, int]]) -> float:
    """The factor of all depth maps with which most points agree."""
    coarse = max(_SCALES, key=lambda scale: _agreeing(views, pairs, _LOOSE, scale))
    return max(
        (coarse * (1 + k / 100) for k in range(-6, 7)),
        key=lambda s: _agreeing(views, pairs, _FIRM, s),
    )


def _agreeing(
    views: Sequence[View],
    pairs: Sequence[tuple[int, int]],
    tolerance: float = _FIRM,
    scale: float = 1.0,
) -> float:
    """The share of points that project to a place of the same depth in another view, all depth maps times a factor."""
    # a few are enough
    points = {
        k: some_points(views[k], MOST_POINTS)[2][::8] * scale for k in {k for k, _ in pairs}
    }
    agreeing = [np.empty(0, bool)]
    for k, j in pairs:
        _, _, z, d = seen_from(views[j], views[k], points[k])
        agreeing.append((d > 0) & (np.abs(d * scale - z) <= tolerance * z))
    shared = np.concatenate(agreeing)
    return float(shared.mean()) if shared.size else 0.0
