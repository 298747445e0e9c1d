"""Facts of each view of a scene: size, camera, colours, depth, charts, and how much it overlaps with other views.

Colours and depth are measured at full size; views are compared at a reduced size. Distances are Euclidean, in metres.
For a view without a camera, depth along the axis takes their place.

Two views overlap if a point of one projects to a pixel of the other at depth Z, and that view's own depth d agrees:
|d - Z| <= 5 % of Z. In consistent data the median of |d - Z| / Z is a few per mille.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Indices, evenly
from sucre_bench.camera import (
    Camera,
    depth_at,
    distance_map,
    moved,
    project,
    relative_pose,
    scaled_camera,
    unproject,
)
from sucre_bench.errors import InputError, one_line
from sucre_bench.imaging.chart_patches import image_from_chart, reading_order
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import converted, to_8bit
from sucre_bench.loading.named_sets import Print, print_of
from sucre_bench.machine.progress import track
from sucre_bench.multiview.pairing import lift, visible_pixels
from sucre_bench.scene import Arrays, View

Numbers = tuple[float, ...]

_LONG_SIDE = 480  # pixels of a reduced view
_FULL = 0.998  # a channel at or above this counts as saturated
_AGREES = 0.05
_PARTNER = 0.05  # share of a view's points that another one must see to overlap
MOST_TARGETS = 40  # views that are compared with all others, evenly chosen
MOST_POINTS = 8000  # of a view


@dataclass(frozen=True)
class ChartFacts:
    """A chart."""

    name: str
    kind: str

    distance: float | None
    """Metres to its middle, None if unknown."""

    fault: str
    """Of its corners, or empty."""


@dataclass(frozen=True)
class ViewFacts:
    """A view."""

    name: str
    width: int
    height: int
    encoding: str

    # Why a plane cannot be read, or empty.
    image_fault: str
    depth_fault: str

    has_depth: bool
    has_reference: bool

    focal: Numbers | None
    """(fx, fy) in pixels."""

    position: Numbers | None
    """Of the camera in the world, metres."""

    coverage: float
    """Share of pixels with depth."""

    distances: Numbers | None
    """Percentiles 1, 50 and 99 in metres."""

    mean: Numbers = ()
    """Of each channel, as stored."""

    spread: Numbers = ()
    """Standard deviation of each channel, gamma-encoded, so that a dark picture in linear light counts by what eyes see
    in it."""

    saturated: float = 0.0
    """Share of pixels with a full channel."""

    charts: tuple[ChartFacts, ...] = ()


@dataclass(frozen=True)
class Overlap:
    """The overlap of one view with the others."""

    view: str

    seen: float
    """Share of its points that at least one other view sees."""

    partners: int
    """Number of views that see 5 % of its points or more."""

    disagreement: float | None
    """Median of |d - Z| / Z of its points that project into others, None if there are none."""


@dataclass(frozen=True, eq=False)
class Look:
    """A view with its facts, and its planes at reduced size; None for a plane that it lacks."""

    view: View
    facts: ViewFacts

    picture: npt.NDArray[np.uint8] | None
    """(h, w, 3) uint8, as shown."""

    depth: Array | None
    """(h, w) float32, metres along the axis."""

    distance: Array | None
    """(h, w), metres, Euclidean where the view has a camera, 0 = unknown."""

    camera: Camera | None
    """Of the reduced size."""

    charts: Array
    """(C, 4, 2), corners in pixels of the reduced size."""

    # Of the picture and of the reference, see `named_sets`.
    print: Print | None
    reference_print: Print | None


def look_at(view: View, reference: bool) -> Look:
    """Read a view once. reference: whether to read its reference. An unreadable file is a fact, not an exception."""
    import cv2

    rgb, image_fault = _loaded(view, "rgb")
    target = _loaded(view, "reference")[0] if reference else None
    depth, depth_fault = _loaded(view, "depth")
    camera, pose = view.camera, view.cam_from_world
    of_camera = camera.size if camera else (0, 0)
    width, height = next(
        (plane.shape[1::-1] for plane in (rgb, depth) if plane is not None), of_camera
    )
    if camera and of_camera != (width, height):
        fault = f"the image is {width}x{height}, its camera {camera.width}x{camera.height}"
        remedy = "use the images that its camera was found for, uncropped"
        image_fault = image_fault or f"{view.name}: {fault}; {remedy}"
        camera = None
    distance = depth if depth is None or camera is None else distance_map(camera, depth)
    known = np.empty(0) if distance is None else distance[distance > 0]
    facts = ViewFacts(
        name=view.name,
        width=width,
        height=height,
        encoding=view.encoding,
        image_fault=image_fault,
        depth_fault=depth_fault,
        has_depth=depth is not None,
        has_reference=target is not None,
        focal=None if camera is None else _floats(camera.K[[0, 1], [0, 1]]),
        position=None if pose is None else _floats(np.linalg.inv(pose)[:3, 3]),
        coverage=known.size / distance.size if distance is not None and distance.size else 0.0,
        distances=_floats(np.percentile(known, [1, 50, 99])) if known.size else None,
    )
    if rgb is not None:
        facts = replace(
            facts,
            mean=_floats(rgb.mean(axis=(0, 1), dtype=np.float64)),
            spread=_floats(
                converted(rgb, view.encoding, "gamma").std(axis=(0, 1), dtype=np.float64)
            ),
            saturated=float((rgb >= _FULL).any(axis=-1).mean()),
            charts=_charts(view, rgb, distance),
        )
    shrink = min(1.0, _LONG_SIDE / max(width, height, 1))
    small = max(1, round(width * shrink)), max(1, round(height * shrink))
    corners = np.array([chart.corners for chart in view.charts]).reshape(-1, 4, 2)
    corners = corners * np.divide(small, (max(width, 1), max(height, 1)))
    camera = camera and scaled_camera(camera, small)
    picture = None
    if rgb is not None:
        shrunk: Array = np.asarray(cv2.resize(rgb, small, interpolation=cv2.INTER_AREA))
        picture = to_8bit(display(shrunk, "none", view.encoding))
    if depth is not None:  # by picking pixels: a mean of two surfaces would lie on neither
        depth = np.asarray(cv2.resize(depth, small, interpolation=cv2.INTER_NEAREST_EXACT))
        distance = distance_map(camera, depth) if camera else depth
    prints = (None if plane is None else print_of(plane) for plane in (picture, target))
    return Look(view, facts, picture, depth, distance, camera, corners, *prints)


def _loaded(view: View, plane: str) -> tuple[Array | None, str]:
    try:
        return (None if plane == "depth" and not view.has_depth else getattr(view, plane)), ""
    except InputError as fault:
        return None, one_line(fault)


def _charts(view: View, rgb: Array, distance: Array | None) -> tuple[ChartFacts, ...]:
    shown = converted(rgb, view.encoding, "gamma")
    facts = []
    for chart in view.charts:
        metres = None
        try:
            fault = reading_order(shown, chart).fault
            x, y, w = image_from_chart(chart.corners) @ [0.5, 0.5, 1]
            if distance is not None:
                u, v = (
                    int(np.clip(p / w, 0, n - 1))
                    for p, n in ((x, rgb.shape[1]), (y, rgb.shape[0]))
                )
                metres = float(distance[v, u]) or None
        except InputError as wrong:
            fault = one_line(wrong)
        facts.append(ChartFacts(chart.name, chart.kind, metres, fault))
    return tuple(facts)


def _floats(values: Array) -> Numbers:
    return tuple(float(value) for value in values)


def placed(looks: Sequence[Look]) -> list[View]:
    """Return the views that have camera, pose and depth, black and with their depth at reduced size."""
    return [
        replace(
            look.view,
            pixels=Arrays(np.zeros((*look.depth.shape, 3), np.float32), look.depth),
            camera=look.camera,
        )
        for look in looks
        if look.camera is not None
        and look.view.cam_from_world is not None
        and look.depth is not None
    ]


def reduced(view: View) -> View:
    """Return a view with camera, pose and depth as `placed` does. Raises InputError if its depth cannot be read."""
    import cv2

    camera, pose = view.placed
    shrink = min(1.0, _LONG_SIDE / max(camera.size))
    camera = scaled_camera(camera, camera.size, shrink)
    depth = cv2.resize(view.depth, camera.size, interpolation=cv2.INTER_NEAREST_EXACT)
    black = np.zeros((*depth.shape, 3), np.float32)
    return View(view.name, Arrays(black, np.asarray(depth)), camera, pose)


def overlaps(views: Sequence[View]) -> list[Overlap]:
    """Return the overlap of up to 40 views, evenly chosen, with all others; views need pose and depth."""
    between = []
    for view in track([views[k] for k in evenly(len(views), MOST_TARGETS)], "overlaps"):
        *_, points = some_points(view, MOST_POINTS)
        seen = np.zeros(len(points), bool)
        partners = 0
        off = []
        for other, most in zip(views, visible_pixels(lift(view), views), strict=True):
            if other is view or not most:
                continue
            _, _, z, d = seen_from(other, view, points)
            rel = np.abs(np.divide(d - z, z, out=np.full(len(z), np.nan), where=d > 0))
            seen |= rel <= _AGREES
            partners += bool((rel <= _AGREES).mean() >= _PARTNER)
            if np.isfinite(rel).mean() >= _PARTNER:
                off.append(rel[np.isfinite(rel)])
        disagreement = float(np.median(np.concatenate(off))) if off else None
        between.append(
            Overlap(view.name, float(seen.mean()) if len(seen) else 0.0, partners, disagreement)
        )
    return between


def some_points(view: View, most: int) -> tuple[Indices, Indices, Array]:
    """Return row and column (P,) of about so many pixels with depth, and their points (P, 3) in the camera's frame."""
    v, u = np.nonzero(view.depth > 0)
    step = max(1, len(u) // most)
    v, u = v[::step], u[::step]
    return (
        v,
        u,
        unproject(view.placed[0], u + 0.5, v + 0.5, view.depth[v, u].astype(np.float64)).T,
    )


def seen_from(other: View, view: View, points: Array) -> tuple[Array, Array, Array, Array]:
    """Project points (P, 3) of a view's camera into another view.

    Return the points in its camera's frame, their pixels (P, 2), their depth Z there, and that view's own depth d (P,),
    0 where it is unknown or the point is outside.
    """
    there = moved(points, relative_pose(other.placed[1], view.placed[1]))
    at, z = project(other.placed[0], there)
    return there, at, z, depth_at(other.depth, at)


# -- whether views can measure the water -------------------------------------------------------------------
# Water is measured by what changes between a near and a far look at one place. Views from one height over flat ground
# see each place from one distance; then any attenuation explains them, whatever the depth maps.

_VIEWS = 12  # evenly chosen, and as many beside them
_POINTS = 1000  # of each

_FEW = 0.05  # of all places: too few to see the water by

# Distances less unlike than this do not tell the water, see docs/sucre.md, "Which dives measure the water".
_ALIKE = 1.12


@dataclass(frozen=True)
class Spread:
    """How unlike the distances are from which views see the same places."""

    ratio: float
    """The farthest distance of a place over its nearest: the median of places that several views see, 1 without
    such."""

    shared: float
    """The share of places that several views see."""

    # 5 and 95 % of all distances.
    nearest: float
    farthest: float

    def sentence(self, unit: str = "m") -> str:
        """Say whether the water can be measured, and what to use."""
        apart = f"a factor of {self.ratio:.2f}, all from {self.nearest:.3g} to {self.farthest:.3g} {unit}".rstrip()
        if self.shared < _FEW:
            return "No two views show the same places: SUCRe cannot measure the water. Use dive_gray_world or seathru."
        if self.ratio < _ALIKE:
            fault = f"The views show each place from like distances ({apart}): the water cannot be measured."
            return f"{fault} Use dive_gray_world, or photographs from several distances."
        return f"The views show each place from unlike distances ({apart}): SUCRe can measure the water."


def usable(views: Sequence[View]) -> list[View]:
    """Return up to 12 views, evenly chosen, and the next of each, that have camera, pose and readable depth."""
    chosen = sorted(
        {k for n in evenly(len(views), _VIEWS) for k in (n, n + 1) if k < len(views)}
    )
    found = []
    for view in (views[k] for k in chosen):
        with suppress(InputError):  # the run says what is wrong with it
            if view.camera is not None and view.cam_from_world is not None and view.has_depth:
                found.append(view)
    return found


def spread_of(views: Sequence[View]) -> Spread | None:
    """Return the spread of distances of views with poses and depth; None if fewer than two can be read.

    Looks at those that `usable` takes.
    """
    views = usable(views)
    if len(views) < 2:
        return None
    nearest, farthest = [], []
    for view in views:
        *_, points = some_points(view, _POINTS)
        near = far = np.linalg.norm(points, axis=-1)
        for other in views:
            if other is view:
                continue
            there, _, z, d = seen_from(other, view, points)
            distance = np.linalg.norm(there, axis=-1)
            is_seen = (d > 0) & (np.abs(d - z) <= _AGREES * z)
            near = np.where(is_seen, np.minimum(near, distance), near)
            far = np.where(is_seen, np.maximum(far, distance), far)
        nearest.append(near)
        farthest.append(far)
    near, far = np.concatenate(nearest), np.concatenate(farthest)
    if not len(near):
        return None
    is_shared = far > near
    ratio = float(np.median(far[is_shared] / near[is_shared])) if is_shared.any() else 1.0
    low, high = np.quantile(np.concatenate([near, far]), (0.05, 0.95))
    return Spread(ratio, float(is_shared.mean()), float(low), float(high))
