"""Finds faults in a scene's data, each with its remedy.

If depth maps of views disagree, the usual mistakes are undone one by one. They are distances or inverse depth in place
of depth, another unit than that of the poses, turned or shifted maps, and poses in other axes or inverted. A mistake is
named if a third of the points agree without it, see docs/prepare.md for what true and false ones reach.
"""

import itertools
import re
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sucre_bench.arrays import CHANNELS, Array, evenly
from sucre_bench.camera import pixel_rays
from sucre_bench.programs.describe.facts import (
    MOST_POINTS,
    MOST_TARGETS,
    Look,
    Overlap,
    ViewFacts,
    overlaps,
    placed,
    reduced,
    seen_from,
    some_points,
    spread_of,
    usable,
)
from sucre_bench.scene import Arrays, View

_PREPARE = "`sucre-bench prepare PHOTOS dive/` makes"
# of full scale: an image with a lower mean or standard deviation shows nothing
_BLACK = 0.02
_FLAT = 0.004
# shares of pixels
_SATURATED = 0.05
_COVERED = 0.5
# median relative disagreement of depth; photogrammetry that fits is at .0005 to .01
_DISAGREES = 0.03
_DOUBTFUL = 0.01
_NOTHING = "nothing in common"
_SAME = 0.5  # 8-bit levels: mean difference of reduced pictures
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


def find_faults(
    looks: Sequence[Look], between: Sequence[Overlap], is_prepared: bool = False
) -> list[Fault]:
    """Return the faults of single views and of views compared with each other, the gravest kinds first.

    is_prepared: whether `sucre-bench prepare` made the scene, so that it cannot help.
    """
    facts = [look.facts for look in looks]
    remedy = "mark it again with `sucre-bench charts`"
    charts = [
        Fault("chart", f"{chart.name}: {chart.fault}", remedy, (view.name,))
        for view in facts
        for chart in view.charts
        if chart.fault
    ]
    return [
        *_files(facts),
        *(_geometry(placed(looks), between) if len(between) > 1 else ()),
        *_contents(facts, is_prepared),
        *_twins(looks),
        *charts,
    ]


def _files(facts: Sequence[ViewFacts]) -> list[Fault]:
    """Faults for files that cannot be read, and for views without pose or depth."""
    faults = []
    # the same mistake in many files is one fault; numbers and places may differ
    alike = defaultdict(list)
    for view in facts:
        for plane, fault in (("image", view.image_fault), ("depth", view.depth_fault)):
            if fault:
                alike[plane, re.sub(r"[\d.]+", "", fault.partition(": ")[2] or fault)].append(
                    (view.name, fault)
                )
    for same in alike.values():
        names, (fault, *_) = zip(*same, strict=True)
        what, remedy = fault.rsplit("; ", 1) if "; " in fault else (fault, "mend the file")
        place, _, text = what.partition(": ")
        faults.append(
            Fault(
                "file",
                f"{text} (first in {place})" if text and len(names) > 1 else what,
                remedy,
                names,
            )
        )
    lost = tuple(view.name for view in facts if view.position is None)
    bare = tuple(view.name for view in facts if not view.has_depth and not view.depth_fault)
    if len(lost) == len(bare) == len(facts):
        remedy = (
            f"{_PREPARE} both of photographs that overlap; methods of one image need neither"
        )
        return [
            *faults,
            Fault(
                "no pose and no depth",
                "the views have no camera positions and no depth",
                remedy,
            ),
        ]
    if lost:
        remedy = f"{_PREPARE} poses of photographs that overlap; other views do not help these"
        faults.append(Fault("no pose", "no pose", remedy, lost))
    if bare:
        remedy = f"{_PREPARE} depth maps; methods that need depth skip these views"
        faults.append(Fault("no depth", "no depth map", remedy, bare))
    return faults


def first_look(views: Sequence[View]) -> str:
    """Return what is wrong with units and poses, or else whether the water can be measured; empty if unknown.

    Looks at the views that `usable` takes.
    """
    some = [reduced(view) for view in usable(views)]
    found = _geometry(some, overlaps(some)) if len(some) > 1 else []
    wrong = next((fault for fault in found if not fault.views and fault.kind != _NOTHING), None)
    spread = None if wrong else spread_of(some)
    return str(wrong or (spread.sentence("") if spread else ""))


def _geometry(views: Sequence[View], between: Sequence[Overlap]) -> list[Fault]:
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


def _contents(facts: Sequence[ViewFacts], is_prepared: bool) -> list[Fault]:
    """Faults for images and depth maps that show little."""
    seen = [view for view in facts if view.mean]
    black = [v for v in seen if max(v.mean) < _BLACK and max(v.spread) < _FLAT]
    flat = [v for v in seen if max(v.spread) < _FLAT and v not in black]
    alive = [v for v in seen if max(v.spread) >= _FLAT]
    burnt = [v for v in alive if v.saturated > _SATURATED]
    holes = [v for v in facts if v.has_depth and v.coverage < _COVERED]
    share = max((v.saturated for v in burnt), default=0)
    least = min((v.coverage for v in holes), default=0)
    lacking = f"depth on less than half of the image (least: {least:.0%}), so most of a restoration is a hole"
    denser = "" if is_prepared else "make denser depth maps with `sucre-bench prepare`, or "
    nearer = "no method brings it back; take nearer or raw images"
    dark = [v for v in alive if max(v.mean) < 0.1 and v.encoding == "gamma"]
    found = [
        ("black", "black image", "leave them out", black),
        ("one colour", "image of one colour", "leave them out", flat),
        *(
            (
                "empty channel",
                f"the {colour} channel is empty",
                nearer,
                [v for v in alive if v.spread[k] < _FLAT],
            )
            for k, colour in enumerate(CHANNELS)
        ),
        ("dark", "very dark", "if they are linear, say so with dataset.encoding=linear", dark),
        (
            "saturated",
            f"up to {share:.0%} of pixels saturated",
            "mask them, or expose less",
            burnt,
        ),
        (
            "little depth",
            lacking,
            f"{denser}add method.fill=true, or take more photographs",
            holes,
        ),
    ]
    return [
        Fault(kind, what, remedy, tuple(v.name for v in views))
        for kind, what, remedy, views in found
        if views
    ]


def _twins(looks: Sequence[Look]) -> list[Fault]:
    """Faults for equal pictures (compared at 16 x 16 pixels), equal depth maps, and views with both."""
    import cv2

    tiny: list[
        tuple[Array, list[str]]
    ] = []  # a picture, and the names of the views that have it
    maps = defaultdict(list)
    for look in looks:
        name = look.facts.name
        if look.picture is not None and look.picture.std() > 255 * _FLAT:
            small: Array = np.asarray(
                cv2.resize(
                    look.picture.astype(np.float32), (16, 16), interpolation=cv2.INTER_AREA
                )
            )
            same = (names for other, names in tiny if np.abs(other - small).mean() < _SAME)
            if group := next(same, None):
                group.append(name)
            else:
                tiny.append((small, [name]))
        if look.depth is not None and np.ptp(look.depth) > 0:
            maps[look.depth.tobytes()].append(name)
    alike, shared = (
        {tuple(names) for names in groups if len(names) > 1}
        for groups in ([names for _, names in tiny], maps.values())
    )
    kinds = (
        ("twins", "picture and depth map", "keep one", alike & shared),
        ("twin pictures", "picture", "keep one", alike - shared),
        ("twin depth maps", "depth map", "give each image its own", shared - alike),
    )
    return [
        Fault(kind, f"the same {what} {_times(len(names))}", remedy, names)
        for kind, what, remedy, groups in kinds
        for names in sorted(groups)
    ]


def _times(n: int) -> str:
    return "twice" if n == 2 else f"{n} times"
