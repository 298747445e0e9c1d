"""Finds faults in a scene's data, each with its remedy."""

import re
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from sucre_bench.arrays import CHANNELS
from sucre_bench.multiview.geometry_faults import Fault, geometry_faults
from sucre_bench.multiview.overlaps import Overlap
from sucre_bench.programs.describe.facts import Look, ViewFacts, placed

_PREPARE = "`sucre-bench prepare PHOTOS dive/` makes"
# of full scale: an image with a lower mean or standard deviation shows nothing
_BLACK = 0.02
_FLAT = 0.004
# shares of pixels
_SATURATED = 0.05
_COVERED = 0.5


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
        *(geometry_faults(placed(looks), between) if len(between) > 1 else ()),
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


def _contents(facts: Sequence[ViewFacts], is_prepared: bool) -> list[Fault]:
    """Faults for images and depth maps that show little."""
    seen = [view for view in facts if view.mean]
    black = [v for v in seen if max(v.mean) < _BLACK and max(v.spread) < _FLAT]
    flat = [v for v in seen if max(v.spread) < _FLAT and v not in black]
    alive = [v for v in seen if max(v.spread) >= _FLAT]
    grey = [v for v in alive if v.is_grey]
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
        ("grey", "no colours", "give them in colour, or leave them out", grey),
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
    """Faults for views whose pictures, or depth maps, or both, are equal at reduced size."""
    pictures = defaultdict(list)
    maps = defaultdict(list)
    for look in looks:
        if look.picture is not None and look.picture.std() > 255 * _FLAT:
            pictures[look.picture.tobytes()].append(look.facts.name)
        if look.depth is not None and np.ptp(look.depth) > 0:
            maps[look.depth.tobytes()].append(look.facts.name)
    alike = {tuple(names) for names in pictures.values() if len(names) > 1}
    shared = {tuple(names) for names in maps.values() if len(names) > 1}
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
