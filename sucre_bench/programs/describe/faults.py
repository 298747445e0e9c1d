"""Faults of a scene's data, each with its remedy."""

import re
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from sucre_bench.programs.describe.depth_and_poses import Mistake, Overlap, suspect
from sucre_bench.programs.describe.view_facts import Look, ViewFacts

_PREPARE = "`sucre-bench prepare PHOTOS dive/` makes"
_BLACK, _FLAT = 0.02, 0.004  # of full scale: an image with a lower mean or standard deviation shows nothing
_SATURATED, _COVERED = 0.05, 0.5  # shares of pixels
_DISAGREES, _DOUBTFUL = 0.03, 0.01  # median relative disagreement of depth; photogrammetry that fits is at .0005 to .01
_NARROW = 1.3  # farthest by nearest distance; at 4 m by 3 m the normal equations of the water are as good as singular
_SAME = 0.5  # 8-bit levels: mean difference of reduced pictures


Kind = (
    Mistake
    | Literal[
        "file", "no pose", "no depth", "no pose and no depth", "depth differs", "nothing in common", "view disagrees"
    ]
    | Literal["view alone", "black", "one colour", "empty channel", "dark", "saturated", "little depth", "narrow range"]
    | Literal["twins", "twin pictures", "twin depth maps", "chart"]
)


@dataclass(frozen=True)
class Fault:
    """A fault. what, remedy: text; views: the views concerned, none for the whole scene."""

    kind: Kind
    what: str
    remedy: str
    views: tuple[str, ...] = ()

    def __str__(self) -> str:
        which = ", ".join(self.views[:3]) + (f" and {len(self.views) - 3} more" if len(self.views) > 3 else "")
        return f"{which + ': ' if which else ''}{self.what}; {self.remedy}"


def find_faults(
    facts: Sequence[ViewFacts], looks: Sequence[Look], overlaps: Sequence[Overlap], unit: str = "m"
) -> list[Fault]:
    """Return the faults of single views and of views compared with each other, the gravest kinds first.

    unit: of distances.
    """
    remedy = "mark it again with `sucre-bench charts`"
    charts = [
        Fault("chart", f"{chart.name}: {chart.fault}", remedy, (view.name,))
        for view in facts
        for chart in view.charts
        if chart.fault
    ]
    of_views = (*_images(facts), *_depth(facts, unit), *_twins(looks), *charts)
    return [*_files(facts), *_geometry(looks, overlaps), *of_views]


def _files(facts: Sequence[ViewFacts]) -> Iterator[Fault]:
    alike = defaultdict(list)  # the same mistake in many files is one fault; numbers and places may differ
    for view in facts:
        for plane, fault in (("image", view.image_fault), ("depth", view.depth_fault)):
            if fault:
                said = fault.partition(": ")[2] or fault
                alike[plane, re.sub(r"[\d.]+", "", said)].append((view.name, fault))
    for same in alike.values():
        names, (fault, *_) = zip(*same, strict=True)
        what, remedy = fault.rsplit("; ", 1) if "; " in fault else (fault, "mend the file")
        place, _, said = what.partition(": ")
        yield Fault("file", f"{said} (first in {place})" if said and len(names) > 1 else what, remedy, names)
    lost = [view for view in facts if view.position is None]
    bare = [view for view in facts if not view.has_depth and not view.depth_fault]
    if len(lost) == len(bare) == len(facts):
        remedy = f"{_PREPARE} both of photographs that overlap; methods of one image need neither"
        yield Fault("no pose and no depth", "the views have no camera positions and no depth", remedy)
        return
    remedy = f"{_PREPARE} poses of photographs that overlap; other views do not help these"
    yield from _where("no pose", lost, "no pose", remedy)
    remedy = f"{_PREPARE} depth maps; methods that need depth skip these views"
    yield from _where("no depth", bare, "no depth map", remedy)


def _geometry(looks: Sequence[Look], overlaps: Sequence[Overlap]) -> Iterator[Fault]:
    if len(overlaps) < 2:
        return
    known = [o.disagreement for o in overlaps if o.disagreement is not None]
    typical = float(np.median(known)) if known else np.inf
    lonely = [o for o in overlaps if not o.partners]
    suspicion = suspect(looks) if typical > _DOUBTFUL or len(lonely) > len(overlaps) / 2 else None
    if suspicion is not None:
        yield Fault(*suspicion)
    elif typical > _DISAGREES:
        differs = f"depth differs by {typical:.1%} (median) where views overlap"
        remedy = "check that depth maps and poses are of one reconstruction, and their scale"
        if known:
            yield Fault("depth differs", differs, remedy)
        else:
            yield Fault("nothing in common", "views see nothing in common", remedy)
    worse = [o for o in overlaps if o.disagreement is not None and o.disagreement > max(_DISAGREES, 3 * typical)]
    if worse:
        names = tuple(o.view for o in worse)
        yield Fault("view disagrees", "depth disagrees with other views'", "check their depth maps and poses", names)
    # A view whose points project into others at other depths lacks no views in between.
    astray = worse if typical <= _DISAGREES else [o for o in overlaps if o.disagreement is not None]
    alone = [o.view for o in lonely if o not in astray]
    if alone and suspicion is None:
        what = "no other view sees 5 % of what they show"
        yield Fault("view alone", what, "add views between; SUCRe has single observations there", tuple(alone))


def _images(facts: Sequence[ViewFacts]) -> Iterator[Fault]:
    seen = [view for view in facts if view.mean]
    black = [v for v in seen if max(v.mean) < _BLACK and max(v.spread) < _FLAT]
    flat = [v for v in seen if max(v.spread) < _FLAT and v not in black]
    yield from _where("black", black, "black image", "leave them out")
    yield from _where("one colour", flat, "image of one colour", "leave them out")
    alive = [v for v in seen if v not in black and v not in flat]
    for channel, colour in enumerate(("red", "green", "blue")):
        dead = [v for v in alive if v.spread[channel] < _FLAT]
        remedy = "no method brings it back; take nearer or raw images"
        yield from _where("empty channel", dead, f"the {colour} channel is empty", remedy)
    dark = [v for v in alive if max(v.mean) < 0.1 and v.encoding == "gamma"]
    yield from _where("dark", dark, "very dark", "if they are linear, say so with dataset.encoding=linear")
    burnt = [v for v in alive if v.saturated > _SATURATED]
    share = max((v.saturated for v in burnt), default=0)
    yield from _where("saturated", burnt, f"up to {share:.0%} of pixels saturated", "mask them, or expose less")


def _depth(facts: Sequence[ViewFacts], unit: str) -> Iterator[Fault]:
    holes = [v for v in facts if v.has_depth and v.coverage < _COVERED]
    least = min((v.coverage for v in holes), default=0)
    what = f"depth on less than half of the image (least: {least:.0%}), so restorations are mostly holes"
    remedy = "make denser depth maps with `sucre-bench prepare`, or leave the views out"
    yield from _where("little depth", holes, what, remedy)
    ranges = np.array([v.distances for v in facts if v.distances])
    if len(ranges):
        nearest, farthest = ranges[:, 0].min(), ranges[:, 2].max()
        if farthest < _NARROW * nearest:
            what = f"all is seen from {nearest:.2f} to {farthest:.2f} {unit}, too narrow a range to tell the water from"
            yield Fault("narrow range", what, "add nearer or farther views, or give the water another way")


def _twins(looks: Sequence[Look]) -> Iterator[Fault]:
    """Faults for equal pictures, equal depth maps, and views with both."""
    pictures, maps = _same_pictures(looks), _same_maps(looks)
    for first, group in pictures.items():
        both = maps.get(first) == group
        what = f"the same picture{' and depth map' * both} {_times(group)}"
        yield Fault("twins" if both else "twin pictures", what, "keep one", (first, *group))
    for first, group in maps.items():
        if pictures.get(first) != group:
            yield Fault(
                "twin depth maps", f"the same depth map {_times(group)}", "give each image its own", (first, *group)
            )


def _times(group: Sequence[str]) -> str:
    return "twice" if len(group) == 1 else f"{len(group) + 1} times"


def _same_pictures(looks: Sequence[Look]) -> dict[str, list[str]]:
    """The first of each and its copies; compared at 16 x 16 pixels."""
    import cv2

    seen = [look for look in looks if look.picture is not None and look.picture.std() > 255 * _FLAT]
    shown = [look.picture.astype(np.float32) for look in seen if look.picture is not None]
    tiny = np.array([cv2.resize(picture, (16, 16), interpolation=cv2.INTER_AREA).ravel() for picture in shown])
    copies = defaultdict(list)
    for k in range(1, len(tiny)):
        same = np.flatnonzero(np.abs(tiny[:k] - tiny[k]).mean(axis=1) < _SAME)
        if same.size:
            copies[seen[same[0]].view.name].append(seen[k].view.name)
    return copies


def _same_maps(looks: Sequence[Look]) -> dict[str, list[str]]:
    names = defaultdict(list)
    for look in looks:
        if look.depth is not None and np.ptp(look.depth) > 0:
            names[look.depth.tobytes()].append(look.view.name)
    return {first: others for first, *others in names.values() if others}


def _where(kind: Kind, facts: Sequence[ViewFacts], what: str, remedy: str) -> Iterator[Fault]:
    """One fault for all of these views; nothing if there are none."""
    if facts:
        yield Fault(kind, what, remedy, tuple(view.name for view in facts))
