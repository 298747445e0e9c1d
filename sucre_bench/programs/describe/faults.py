"""Finds faults in a scene's data, each with its remedy.

If depth maps of views disagree, the usual mistakes are undone one by one. They are distances in place of depth, depth
in another unit than the poses, inverted poses. A mistake whose undoing makes far more points agree is named.
"""

import re
from collections import defaultdict
from collections.abc import Callable, Sequence
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
    placed,
    seen_from,
    some_points,
)
from sucre_bench.scene import Arrays, View

_PREPARE = "`sucre-bench prepare PHOTOS dive/` makes"
_BLACK, _FLAT = 0.02, 0.004  # of full scale: an image with a lower mean or standard deviation shows nothing
_SATURATED, _COVERED = 0.05, 0.5  # shares of pixels
_DISAGREES, _DOUBTFUL = 0.03, 0.01  # median relative disagreement of depth; photogrammetry that fits is at .0005 to .01
_SAME = 0.5  # 8-bit levels: mean difference of reduced pictures
_FIRM, _LOOSE = 0.01, 0.06  # relative tolerance in the search for mistakes: of one, and of scales on a coarse grid
_SCALES = (0.001, 0.01, *(float(s) for s in np.geomspace(0.1, 10, 41)), 100.0, 1000.0)


@dataclass(frozen=True)
class Fault:
    """A fault. kind: its name; what, remedy: text; views: the views concerned, none for the whole scene."""

    kind: str
    what: str
    remedy: str
    views: tuple[str, ...] = ()

    def __str__(self) -> str:
        which = ", ".join(self.views[:3]) + (f" and {len(self.views) - 3} more" if len(self.views) > 3 else "")
        return f"{which + ': ' if which else ''}{self.what}; {self.remedy}"


def find_faults(looks: Sequence[Look], overlaps: Sequence[Overlap], is_prepared: bool = False) -> list[Fault]:
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
        *(_geometry(looks, overlaps) if len(overlaps) > 1 else ()),
        *_contents(facts, is_prepared),
        *_twins(looks),
        *charts,
    ]


def _files(facts: Sequence[ViewFacts]) -> list[Fault]:
    """Faults for files that cannot be read, and for views without pose or depth."""
    faults = []
    alike = defaultdict(list)  # the same mistake in many files is one fault; numbers and places may differ
    for view in facts:
        for plane, fault in (("image", view.image_fault), ("depth", view.depth_fault)):
            if fault:
                alike[plane, re.sub(r"[\d.]+", "", fault.partition(": ")[2] or fault)].append((view.name, fault))
    for same in alike.values():
        names, (fault, *_) = zip(*same, strict=True)
        what, remedy = fault.rsplit("; ", 1) if "; " in fault else (fault, "mend the file")
        place, _, text = what.partition(": ")
        faults.append(Fault("file", f"{text} (first in {place})" if text and len(names) > 1 else what, remedy, names))
    lost = tuple(view.name for view in facts if view.position is None)
    bare = tuple(view.name for view in facts if not view.has_depth and not view.depth_fault)
    if len(lost) == len(bare) == len(facts):
        remedy = f"{_PREPARE} both of photographs that overlap; methods of one image need neither"
        return [*faults, Fault("no pose and no depth", "the views have no camera positions and no depth", remedy)]
    if lost:
        remedy = f"{_PREPARE} poses of photographs that overlap; other views do not help these"
        faults.append(Fault("no pose", "no pose", remedy, lost))
    if bare:
        remedy = f"{_PREPARE} depth maps; methods that need depth skip these views"
        faults.append(Fault("no depth", "no depth map", remedy, bare))
    return faults


def _geometry(looks: Sequence[Look], overlaps: Sequence[Overlap]) -> list[Fault]:
    """Faults for views whose depth disagrees, or that no other view overlaps."""
    faults = []
    known = [o for o in overlaps if o.disagreement is not None]
    typical = float(np.median([o.disagreement for o in known])) if known else np.inf
    lonely = [o for o in overlaps if not o.partners]
    mistake = _mistake(placed(looks)) if typical > _DOUBTFUL or len(lonely) > len(overlaps) / 2 else None
    if mistake is not None:
        faults.append(mistake)
    elif typical > _DISAGREES:
        differs = f"depth differs by {typical:.1%} (median) where views overlap"
        remedy = "check that depth maps and poses are of one reconstruction, and their scale"
        seen = ("depth differs", differs) if known else ("nothing in common", "views see nothing in common")
        faults.append(Fault(*seen, remedy))
    worse = [o for o in known if (o.disagreement or 0) > max(_DISAGREES, 3 * typical)]
    if worse:
        names, remedy = tuple(o.view for o in worse), "check their depth maps and poses"
        faults.append(Fault("view disagrees", "depth disagrees with other views'", remedy, names))
    # A view whose points project into others at other depths lacks no views in between.
    alone = tuple(o.view for o in lonely if o not in (worse if typical <= _DISAGREES else known))
    if alone and mistake is None:
        remedy = "add views between; SUCRe has single observations there"
        faults.append(Fault("view alone", "no other view sees 5 % of what they show", remedy, alone))
    return faults


def _mistake(views: Sequence[View]) -> Fault | None:
    """The mistake that best explains why depth maps of views disagree; None if no known one does.

    Without it at least half as many points more must agree, and at least a tenth of all.
    """
    targets = evenly(len(views), MOST_TARGETS)
    targets = targets[:: max(1, len(targets) // 8)]
    pairs = [(k, j) for k in targets for j in range(max(0, k - 2), min(len(views), k + 3)) if j != k]
    as_is = _agreeing(views, pairs)
    coarse = max(_SCALES, key=lambda scale: _agreeing(views, pairs, _LOOSE, scale))
    scale = max((coarse * (1 + k / 100) for k in range(-6, 7)), key=lambda s: _agreeing(views, pairs, _FIRM, s))

    def scaled(view: View, factor: float | Array) -> View:
        return replace(view, pixels=Arrays(view.rgb, view.depth * factor))

    tried: list[tuple[str, str, str, Callable[[View], View]]] = [  # kind, what it is, remedy, and what undoes it
        (
            "distance for depth",
            "depth is distance",
            "divide each pixel by the length of its ray, K^-1 (u + .5, v + .5, 1)",
            lambda view: scaled(view, 1 / np.linalg.norm(pixel_rays(view.placed[0]), axis=-1)),
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
        (
            "unit of depth",
            f"depth is {1 / scale:.3g} times that of the poses",
            f"multiply depth by {scale:.3g}, or divide positions",
            lambda view: scaled(view, scale),
        ),
    ]
    shares = [_agreeing([change(view) for view in views], pairs) for *_, change in tried]
    kind, what, remedy, _ = tried[int(np.argmax(shares))]
    if max(shares) <= max(1.5 * as_is, 0.1):
        return None
    agreeing = f"{as_is:.0%} of points agree between views, {max(shares):.0%} without that mistake"
    return Fault(kind, f"{what}: {agreeing}", remedy)


def _agreeing(
    views: Sequence[View], pairs: Sequence[tuple[int, int]], tolerance: float = _FIRM, scale: float = 1.0
) -> float:
    """The share of points that project to a place of the same depth in another view, all depth maps times a factor."""
    points = {k: some_points(views[k], MOST_POINTS)[2][::8] * scale for k in {k for k, _ in pairs}}  # a few are enough
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
    share, least = max((v.saturated for v in burnt), default=0), min((v.coverage for v in holes), default=0)
    lacking = f"depth on less than half of the image (least: {least:.0%}), so most of a restoration is a hole"
    denser = "" if is_prepared else "make denser depth maps with `sucre-bench prepare`, or "
    nearer = "no method brings it back; take nearer or raw images"
    dark = [v for v in alive if max(v.mean) < 0.1 and v.encoding == "gamma"]
    found = [
        ("black", "black image", "leave them out", black),
        ("one colour", "image of one colour", "leave them out", flat),
        *(
            ("empty channel", f"the {colour} channel is empty", nearer, [v for v in alive if v.spread[k] < _FLAT])
            for k, colour in enumerate(CHANNELS)
        ),
        ("dark", "very dark", "if they are linear, say so with dataset.encoding=linear", dark),
        ("saturated", f"up to {share:.0%} of pixels saturated", "mask them, or expose less", burnt),
        ("little depth", lacking, f"{denser}add method.fill=true, or take more photographs", holes),
    ]
    return [Fault(kind, what, remedy, tuple(v.name for v in views)) for kind, what, remedy, views in found if views]


def _twins(looks: Sequence[Look]) -> list[Fault]:
    """Faults for equal pictures (compared at 16 x 16 pixels), equal depth maps, and views with both."""
    import cv2

    tiny: list[tuple[Array, list[str]]] = []
    pictures: list[list[str]] = []  # the names of the views that share each
    maps = defaultdict(list)
    for look in looks:
        if look.picture is not None and look.picture.std() > 255 * _FLAT:
            small = cv2.resize(look.picture.astype(np.float32), (16, 16), interpolation=cv2.INTER_AREA)
            group = next((names for other, names in tiny if np.abs(other - small).mean() < _SAME), None)
            if group is None:
                pictures.append(group := [])
            group.append(look.facts.name)
            tiny.append((np.asarray(small), group))
        if look.depth is not None and np.ptp(look.depth) > 0:
            maps[look.depth.tobytes()].append(look.facts.name)
    alike, shared = ([tuple(names) for names in groups if len(names) > 1] for groups in (pictures, maps.values()))
    kinds = (
        ("twins", "picture and depth map", "keep one", [names for names in alike if names in shared]),
        ("twin pictures", "picture", "keep one", [names for names in alike if names not in shared]),
        ("twin depth maps", "depth map", "give each image its own", [names for names in shared if names not in alike]),
    )
    return [
        Fault(kind, f"the same {what} {'twice' if len(names) == 2 else f'{len(names)} times'}", remedy, names)
        for kind, what, remedy, groups in kinds
        for names in groups
    ]
