"""Facts of each view of a scene: size, camera, colours, depth, charts, and small pictures of it.

Colours and depth are measured at full size; views are compared at a reduced size. Distances are Euclidean, in metres.
For a view without a camera, depth along the axis takes their place.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from sucre_bench.arrays import Array, Mask
from sucre_bench.camera import Camera, distance_map, scaled_camera
from sucre_bench.errors import InputError, one_line
from sucre_bench.imaging.chart_patches import image_from_chart, reading_order
from sucre_bench.imaging.display import display
from sucre_bench.imaging.encoding import converted, srgb_decode, to_8bit
from sucre_bench.machine.progress import track
from sucre_bench.scene import Arrays, View

_LONG_SIDE = 480  # pixels of a reduced view
_FULL = 0.998  # a channel at or above this counts as saturated


@dataclass(frozen=True)
class ChartFacts:
    """A chart. distance: metres to its middle, None if unknown; fault: of its corners, or empty."""

    name: str
    kind: str
    distance: float | None
    fault: str


@dataclass(frozen=True)
class ViewFacts:
    """A view.

    image_fault, depth_fault: the reason if a plane cannot be read, or empty; focal: (fx, fy) in pixels; position: of
    the camera in the world, metres; mean, spread: of each channel, as stored, and its standard deviation; saturated:
    share of pixels with a full channel; coverage: share of pixels with depth; distances: percentiles 1, 50 and 99 in
    metres.
    """

    name: str
    width: int
    height: int
    encoding: str
    image_fault: str = ""
    depth_fault: str = ""
    has_depth: bool = False
    has_reference: bool = False
    focal: tuple[float, float] | None = None
    position: tuple[float, float, float] | None = None
    mean: tuple[float, ...] = ()
    spread: tuple[float, ...] = ()
    saturated: float = 0.0
    coverage: float = 0.0
    distances: tuple[float, float, float] | None = None
    charts: tuple[ChartFacts, ...] = ()


@dataclass(frozen=True, eq=False)
class Look:
    """A view at reduced size; None for a plane that it lacks.

    picture: (h, w, 3) uint8 as shown; depth: (h, w) float32 metres along the axis; camera: of the reduced size;
    charts: (C, 4, 2) corners in its pixels.
    """

    view: View
    picture: npt.NDArray[np.uint8] | None
    depth: Array | None
    camera: Camera | None
    charts: Array

    @property
    def distance(self) -> Array | None:
        """(h, w) metres, Euclidean where the view has a camera; 0 = unknown."""
        if self.depth is None or self.camera is None:
            return self.depth
        return distance_map(self.camera, self.depth)

    @property
    def small(self) -> View | None:
        """The view at reduced size, with the intensities that its file holds; None without camera, pose or depth."""
        if self.camera is None or self.view.cam_from_world is None or self.depth is None:
            return None
        shown = np.zeros((1, 1, 3), np.float32) if self.picture is None else self.picture.astype(np.float32) / 255
        rgb = srgb_decode(shown) if self.view.encoding == "linear" else shown
        return replace(self.view, pixels=Arrays(rgb, self.depth), camera=self.camera)


def look_at(views: Sequence[View], references: bool) -> list[tuple[ViewFacts, Look]]:
    """Read every view once. references: whether to read references. An unreadable file is a fact, not an exception."""
    return [_look_at(view, references) for view in track(views, "looking at views")]


def _look_at(view: View, references: bool) -> tuple[ViewFacts, Look]:
    import cv2

    rgb, image_fault = _loaded(view, "rgb")
    depth, depth_fault = _loaded(view, "depth")
    camera, pose = view.camera, view.cam_from_world
    width, height = next((p.shape[1::-1] for p in (rgb, depth) if p is not None), _size_of(camera))
    if camera and _size_of(camera) != (width, height):
        fault = f"the image is {width}x{height}, its camera {camera.width}x{camera.height}"
        remedy = "use the images that its camera was found for, uncropped"
        image_fault = image_fault or f"{view.name}: {fault}; {remedy}"
        camera = None
    shrink = min(1.0, _LONG_SIDE / max(width, height, 1))
    small = max(1, round(width * shrink)), max(1, round(height * shrink))
    at_scale = None if camera is None else scaled_camera(camera, small)
    distance = None if depth is None else (distance_map(camera, depth) if camera else depth)
    known = np.zeros(0, bool) if distance is None else distance > 0
    facts = ViewFacts(
        name=view.name,
        width=width,
        height=height,
        encoding=view.encoding,
        image_fault=image_fault,
        depth_fault=depth_fault,
        has_depth=depth is not None,
        has_reference=references and _loaded(view, "reference")[0] is not None,
        focal=None if camera is None else (float(camera.K[0, 0]), float(camera.K[1, 1])),
        position=None if pose is None else _triple(np.linalg.inv(pose)[:3, 3]),
        mean=() if rgb is None else _triple(rgb.mean(axis=(0, 1), dtype=np.float64)),
        spread=() if rgb is None else _triple(rgb.std(axis=(0, 1), dtype=np.float64)),
        saturated=0.0 if rgb is None else float((rgb >= _FULL).any(axis=-1).mean()),
        coverage=float(known.mean()) if known.size else 0.0,
        distances=_triple(np.percentile(distance[known], [1, 50, 99]))
        if distance is not None and known.any()
        else None,
        charts=() if rgb is None else _charts(view, rgb, distance),
    )
    corners = np.array([chart.corners for chart in view.charts]).reshape(-1, 4, 2)
    corners = corners * np.divide(small, (max(width, 1), max(height, 1)))
    picture, sampled = None, depth
    if rgb is not None:
        shrunk: Array = np.asarray(cv2.resize(rgb, small, interpolation=cv2.INTER_AREA))
        picture = to_8bit(display(shrunk, "none", view.encoding))
    if depth is not None:  # by picking pixels: a mean of two surfaces would lie on neither
        sampled = np.asarray(cv2.resize(depth, small, interpolation=cv2.INTER_NEAREST_EXACT))
    return facts, Look(view, picture, sampled, at_scale, corners)


def _size_of(camera: Camera | None) -> tuple[int, ...]:
    return (camera.width, camera.height) if camera else (0, 0)


def _loaded(view: View, plane: str) -> tuple[Array | None, str]:
    try:
        if plane == "depth" and not view.has_depth:
            return None, ""
        return getattr(view, plane), ""
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
                u, v = (int(np.clip(p / w, 0, n - 1)) for p, n in ((x, rgb.shape[1]), (y, rgb.shape[0])))
                metres = float(distance[v, u]) or None
        except InputError as wrong:
            fault = one_line(wrong)
        facts.append(ChartFacts(chart.name, chart.kind, metres, fault))
    return tuple(facts)


def _triple(values: Array | Mask) -> tuple[float, float, float]:
    one, two, three = (float(value) for value in values)
    return one, two, three
