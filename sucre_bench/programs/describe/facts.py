"""Facts of each view of a scene: size, camera, colours, depth and charts.

Colours and depth are measured at full size. Distances are Euclidean, in metres. For a view without a
camera, depth along the axis takes their place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array
from sucre_bench.camera import (
    Camera,
    distance_map,
    scaled_camera,
)
from sucre_bench.errors import InputError, one_line
from sucre_bench.imaging.chart_patches import image_from_chart, reading_order
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import converted, is_grey, to_8bit
from sucre_bench.loading.named_sets import Print, print_of
from sucre_bench.multiview.overlaps import LONG_SIDE
from sucre_bench.scene import Arrays, View

Numbers = tuple[float, ...]

_FULL = 0.998  # a channel at or above this counts as saturated


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

    is_grey: bool = False
    """Whether no pixel has a colour."""

    charts: tuple[ChartFacts, ...] = ()


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

    print: Print | None
    """Of the picture, see `named_sets`."""


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
            is_grey=is_grey(rgb),
            charts=_charts(view, rgb, distance),
        )
    shrink = min(1.0, LONG_SIDE / max(width, height, 1))
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
    known_by = None if picture is None else print_of(picture)
    return Look(view, facts, picture, depth, distance, camera, corners, known_by)


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
