"""Proposes charts: those that OpenCV's detector finds, and marked ones in the other views, by the scene's geometry.

The detector knows ColorChecker Classics. Its model of the Digital SG is not used: it found clearly visible painted
charts mirrored, or not at all.

A chart is flat: the depth map inside its outline gives the plane of its four corners. These are projected into another
view. They are proposed there if the whole frame is inside the image, seen from the front and large enough to read. It
must not be hidden according to that view's depth.
"""

from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at, moved, project
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.imaging.chart_patches import are_corners, chart_mask, image_from_chart
from sucre_bench.imaging.display import stretch
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.scene import Chart, View

DETECTABLE = ("colorchecker24",)

_MOST = 4  # charts that are detected in an image; more take more time
_AGREES = 0.05  # greatest |Z - d| / Z on the chart: photogrammetry rounds a chart's edges
_FLAT = 0.03  # greatest median |residual| of a chart's plane, relative to depth
_LEAST_PIXELS = 12  # pixels with depth that a plane needs
_LEAST_EDGE_PX = 12.0  # pixels: the smallest readable patch has 2


@dataclass(frozen=True, slots=True, eq=False)
class Proposal:
    """A chart where the geometry expects it."""

    view: str
    """Where it is proposed."""

    chart: Chart

    source: str
    """The view in which it is marked, or "detector"."""


def detect(shown: Array, kind: str) -> list[Chart]:
    """Return the charts of a kind in a picture, named chart1, chart2 from the largest on.

    shown: (H, W, 3) gamma-encoded, [0, 1]. The picture is stretched, because water leaves little contrast; if nothing
    is found, it is tried unchanged. The list is empty for a kind that OpenCV does not know.
    """
    import cv2

    if kind not in DETECTABLE or min(shown.shape[:2]) < 64:
        return []
    shown = np.nan_to_num(shown)
    detector = cv2.mcc.CCheckerDetector.create()
    detector.setColorChartType(cv2.mcc.MCC24)
    pictures = (
        np.ascontiguousarray(to_8bit(tried)[..., ::-1]) for tried in (stretch(shown), shown)
    )
    if not any(detector.process(picture, _MOST) for picture in pictures):
        return []
    boxes = np.array([patch.box for patch in chart_kind(kind).patches])
    centres = (boxes[:, :2] + boxes[:, 2:]) / 2
    unit = np.array([[[0.0, 0], [1, 0], [1, 1], [0, 1]]])
    charts = []
    for checker in detector.getListColorChecker():
        # The detector's patches, row by row, are wider than the chart's; only their centres are right.
        patches = np.array(checker.getColorCharts(), dtype=np.float64).reshape(-1, 4, 2)
        if len(patches) != len(boxes):
            continue
        homography, _ = cv2.findHomography(centres, patches.mean(axis=1))
        corners = np.asarray(cv2.perspectiveTransform(unit, homography)[0], dtype=np.float64)
        corners += 0.5  # OpenCV has pixel centres at whole numbers
        if (
            are_corners(corners)
            and (corners >= 0).all()
            and (corners <= np.array(shown.shape[1::-1])).all()
        ):
            charts.append(corners)
    charts.sort(key=lambda corners: -abs(float(cv2.contourArea(corners.astype(np.float32)))))
    return [Chart(f"chart{number}", kind, corners) for number, corners in enumerate(charts, 1)]


def propose(
    marked: Sequence[tuple[View, Chart]],
    views: Iterable[View],
    only: Container[str] | None = None,
) -> Iterator[Proposal]:
    """Yield proposals for charts that are marked in some views and not in others.

    only: the names of the charts to propose; None for all. The source is the view that shows the chart largest and
    whose corners the other view sees. Views without pose or depth neither give nor get proposals. Depth is read only if
    the poses allow a proposal.
    """
    sources = []  # largest first
    for view, chart in marked:
        points = corner_points(view, chart) if only is None or chart.name in only else None
        if points is not None:
            sources.append((_shortest_edge(chart.corners), view, chart, points))
    sources.sort(key=lambda source: -source[0])
    have = {(view.name, chart.name) for view, chart in marked}
    taken = [(view.name, chart.corners) for view, chart in marked]
    for view in views:
        for _, origin, chart, points in sources:
            if (view.name, chart.name) in have:
                continue
            corners = _seen_at(view, points)
            if corners is None or any(
                name == view.name and overlap(corners, other) for name, other in taken
            ):
                continue
            have.add((view.name, chart.name))
            yield Proposal(view.name, Chart(chart.name, chart.kind, corners), origin.name)


def corner_points(view: View, chart: Chart) -> Array | None:
    """Return a chart's corners (4, 3) float64 in the world, metres; None without pose or enough depth.

    The plane is fitted to inverse depth, which is linear in pixel coordinates, without outliers.
    """
    if view.camera is None or view.cam_from_world is None or not _has_depth(view):
        return None
    v, u = np.nonzero(chart_mask(chart, view.camera.size) & (view.depth > 0))
    if len(v) < _LEAST_PIXELS:
        return None
    design = np.stack([u + 0.5, v + 0.5, np.ones(len(v))], axis=1)
    depth = view.depth[v, u].astype(np.float64)
    weights = np.ones(len(depth), dtype=bool)
    for _ in range(4):
        plane = np.linalg.lstsq(
            design[weights] * depth[weights, None], np.ones(weights.sum()), rcond=None
        )[0]
        off = np.abs(design @ plane * depth - 1)
        weights = off <= max(3 * float(np.median(off)), 1e-4)
    if np.median(off) > _FLAT:
        return None
    homogeneous = np.c_[chart.corners, np.ones(4)]
    inverse = homogeneous @ plane
    if (inverse <= 0).any():
        return None
    points = homogeneous @ np.linalg.inv(view.camera.K).T / inverse[:, None]
    return moved(points, np.linalg.inv(view.cam_from_world))


def _seen_at(view: View, points: Array) -> Array | None:
    """The pixels (4, 2) of a chart's world corners; None if the view does not show all of it, large enough."""
    if view.camera is None or view.cam_from_world is None:
        return None
    corners, z = project(view.camera, moved(points, view.cam_from_world))
    is_within = (corners >= 0).all() and (corners <= view.camera.size).all()
    is_readable = (
        is_within and _shortest_edge(corners) >= _LEAST_EDGE_PX and are_corners(corners)
    )
    if not ((z > 0).all() and is_readable and _has_depth(view)):
        return None
    # Compare the chart's plane with the view's own depth, at a grid of places on the chart.
    steps = (np.arange(9) + 0.5) / 9
    x, y = (one.reshape(-1, 1) for one in np.meshgrid(steps, steps))
    top = (1 - x) * points[0] + x * points[1]
    bottom = (1 - x) * points[3] + x * points[2]
    at, Z = project(view.camera, moved((1 - y) * top + y * bottom, view.cam_from_world))
    d = depth_at(view.depth, at)
    known = d > 0
    agrees = np.abs(Z - d)[known] <= _AGREES * Z[known]
    seen = known.mean() >= 0.5 and agrees.mean() >= 0.8
    return corners if seen else None


def _has_depth(view: View) -> bool:
    try:
        return view.has_depth
    except InputError:
        return False  # methods that need the depth map report its fault


def _shortest_edge(corners: Array) -> float:
    return float(np.linalg.norm(np.roll(corners, -1, axis=0) - corners, axis=1).min())


def overlap(corners: Array, other: Array) -> bool:
    """Whether the middle of one chart lies inside the other; names do not matter."""
    x, y = corners.mean(axis=0)
    mapped = np.linalg.inv(image_from_chart(other)) @ [x, y, 1]
    return bool(mapped[2] and (np.abs(mapped[:2] / mapped[2] - 0.5) < 0.5).all())
