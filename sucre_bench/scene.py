"""Scenes and views: what a dataset yields and a method restores.

Conventions. Pixel coordinates are (x, y) with the top-left corner of the image at (0, 0), so that pixel
(column u, row v) has its centre at (u + 0.5, v + 0.5). Cameras look along +z, x right, y down.
``depth`` is planar, along the optical axis; ``distance`` is Euclidean, from the camera's centre. Both in
metres, 0 where unknown. The last axis of an image is colour, in RGB order.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from cachetools import LRUCache, cached

from sucre_bench.arrays import Array, Mask, coloured
from sucre_bench.camera import Camera
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.machine.shown import counted

__all__ = ["Arrays", "Chart", "Encoding", "Pixels", "Plane", "Restoration", "Scene", "Score", "View", "Water"]

Encoding = Literal["gamma", "linear"]


Plane = Literal["rgb", "depth", "reference"]


# Decoded planes kept for reuse, so that a method may say `view.rgb` five times without five decodes,
# and a 5,000-image dive still does not fill the memory. Small planes decode fast, so few of them are kept.
_KEPT_BYTES = 768 << 20
_LEAST_KEPT_BYTES = _KEPT_BYTES // 512


@dataclass(frozen=True, eq=False)
class Water:
    """The water's colour model, I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 2).

    veiling_light: (3,) B, in image intensity; attenuation: (3,) beta, 1/m; backscatter: (3,) gamma, 1/m. RGB; NaN for
    what a method does not estimate. encoding: of the intensities that it explains; None where those are the view's.

    >>> Water(np.array([0.06, 0.22, 0.30]), np.array([0.42, 0.14, 0.10]), np.array([0.30, 0.17, 0.13]))
    Water           red   green    blue
      B           0.060   0.220   0.300
      beta 1/m    0.420   0.140   0.100
      gamma 1/m   0.300   0.170   0.130
    """

    veiling_light: Array
    attenuation: Array
    backscatter: Array
    encoding: Encoding | None = None

    def __repr__(self) -> str:
        named = {"B": self.veiling_light, "beta 1/m": self.attenuation, "gamma 1/m": self.backscatter}
        lines = ["Water           red   green    blue"]
        lines += [f"  {name:9}" + "".join(f"{value:8.3f}".rjust(8) for value in row) for name, row in named.items()]
        return "\n".join(lines + ([f"  of {self.encoding} intensities"] if self.encoding else []))


@dataclass(frozen=True, eq=False)
class Chart:
    """A colour chart seen in a view.

    name: unique in the view, the same chart has the same name in every view;
    kind: the layout and reference colours: "dgk", "colorchecker24", "colorchecker_sg", or the path of a CSV file;
    corners: (4, 2) float64 pixels, the chart's frame: top left, top right, bottom right, bottom left,
    as the chart is read (not as it lies in the image).

    >>> Chart("near", "dgk", np.array([[10, 10], [90, 10], [90, 60], [10, 60]])).name
    'near'
    """

    name: str
    kind: str
    corners: Array


class Pixels(Protocol):
    """Where a view's pixels come from; asked only when they are needed.

    >>> class Black:
    ...     def load(self, plane):
    ...         return np.zeros((48, 64, 3), np.float32) if plane == "rgb" else None
    >>> View("black.png", Black()).rgb.shape
    (48, 64, 3)
    """

    def load(self, plane: Plane) -> Array | None:
        """Return "rgb" (H, W, 3), "depth" (H, W) metres or "reference" (H, W, 3), float32; None if there is none.

        Raises InputError naming the file when it cannot be read.
        """
        ...


@dataclass(frozen=True, eq=False)
class Arrays:
    """Pixels already in memory: rgb (H, W, 3) in [0, 1]; optional depth (H, W) metres; optional reference (H, W, 3).

    >>> View("a.png", Arrays(np.full((48, 64, 3), 0.5))).rgb.dtype
    dtype('float32')
    """

    rgb: Array
    depth: Array | None = None
    reference: Array | None = None

    def load(self, plane: Plane) -> Array | None:
        values: Array | None = getattr(self, plane)
        return None if values is None else np.array(values, dtype=np.float32)  # a copy: it will be locked


@dataclass(frozen=True, eq=False)
class View:
    """One image of a scene.

    name: path relative to the image folder, unique in the scene;
    pixels: where rgb, depth and reference come from;
    camera, cam_from_world: (4, 4) float64 rigid transform; None when unknown;
    charts: the colour charts seen in it; encoding: of rgb and reference, "gamma" (sRGB-like) or "linear".

    The image planes below are float32, read-only, decoded when asked for and kept only for a while.

    >>> view = View("a.png", Arrays(np.zeros((48, 64, 3)), depth=np.ones((48, 64))))
    >>> view
    View 'a.png': gamma-encoded, no camera, no pose, no charts
    >>> bool(view.valid.all())
    True
    """

    name: str
    pixels: Pixels
    camera: Camera | None = None
    cam_from_world: Array | None = None
    charts: Sequence[Chart] = ()
    encoding: Encoding = "gamma"

    def __repr__(self) -> str:  # of what is known without decoding a file
        size = f"{self.camera.width}x{self.camera.height} pixels" if self.camera else "no camera"
        pose = "a pose" if self.cam_from_world is not None else "no pose"
        charts = f"charts {', '.join(chart.name for chart in self.charts)}" if self.charts else "no charts"
        return f"View '{self.name}': {self.encoding}-encoded, {size}, {pose}, {charts}"

    @property
    def rgb(self) -> Array:
        """(H, W, 3) float32 in [0, 1], encoded as `encoding` says."""
        rgb = _plane(self.pixels, "rgb")
        if rgb is None:
            raise InputError(f"{self.name}: the view has no image; every view needs one")
        return rgb

    @property
    def levels(self) -> npt.NDArray[np.uint8] | None:
        """The image (H, W, 3) in 8 bits, 255 = 1, where it lies on the disk like that; else None. `rgb` is the same."""
        levels = getattr(self.pixels, "levels", None)
        return levels() if levels is not None else None

    @property
    def has_depth(self) -> bool:
        """Whether the view has a depth map (reads it)."""
        return _plane(self.pixels, "depth") is not None

    @property
    def depth(self) -> Array:
        """(H, W) float32 metres along the optical axis, 0 = unknown. InputError when the view has none."""
        depth = _plane(self.pixels, "depth")
        if depth is None:
            raise InputError(f"{self.name}: the view has no depth map; this needs one")
        return depth

    @property
    def distance(self) -> Array:
        """(H, W) float32 metres from the camera's centre, 0 = unknown: ||K^-1 (u + .5, v + .5, 1) d||."""
        from sucre_bench.camera import distance_map

        if self.camera is None:
            raise InputError(f"{self.name}: the view has no camera; distance needs one")
        return distance_map(self.camera, self.depth)

    @property
    def reference(self) -> Array | None:
        """(H, W, 3) float32, the scene as it looks without water, or None."""
        return _plane(self.pixels, "reference")

    @property
    def valid(self) -> Mask:
        """(H, W) bool: pixels with depth; all of them where the view has no depth map."""
        depth = _plane(self.pixels, "depth")
        return np.ones(self.rgb.shape[:2], dtype=bool) if depth is None else np.asarray(depth > 0)


def _size(plane: Array | None) -> int:
    return _LEAST_KEPT_BYTES if plane is None else max(plane.nbytes, _LEAST_KEPT_BYTES)


@cached(LRUCache(_KEPT_BYTES, getsizeof=_size), lock=threading.Lock())
def _plane(pixels: Pixels, plane: Plane) -> Array | None:
    values = pixels.load(plane)
    if values is not None and plane == "depth" and not hasattr(pixels, "levels"):  # what is no distance is unknown
        values = np.where(np.isfinite(values) & (values > 0), values, 0).astype(np.float32)
    if values is not None:
        values.setflags(write=False)  # what one method may not do to the next
    return values


@dataclass(frozen=True, eq=False)
class Scene:
    """Views of one place in one water.

    name: unique in its dataset; views: in capture order; water: the true water, where known;
    has: what the scene offers, of "depth", "poses", "reference", "charts", "truth" (at least one view has it);
    data_id: a short hash of the data, equal exactly where the data are equal.

    A scene is a sequence of views, and finds one by its name too:

    >>> views = [View(name, Arrays(np.zeros((48, 64, 3)))) for name in ("a.png", "b.png")]
    >>> scene = Scene("reef", views, frozenset())
    >>> scene
    Scene 'reef': 2 views, a.png to b.png
      has only images
    >>> scene[0] is scene["a.png"]
    True
    """

    name: str
    views: Sequence[View]
    has: frozenset[str]
    water: Water | None = None
    data_id: str = ""

    def __repr__(self) -> str:
        names = [view.name for view in self.views]
        span = f", {names[0]} to {names[-1]}" if len(names) > 1 else f", {names[0]}" if names else ""
        lines = [f"Scene '{self.name}': {counted(len(names), 'view')}{span}"]
        lines.append(f"  has {', '.join(sorted(self.has)) or 'only images'}")
        return "\n".join(lines + ([repr(self.water)] if self.water else []))

    def __getitem__(self, name: str | int) -> View:
        """Return a view by its name, or by its place (from 0; negative from the end).

        Raises InputError for a name that no view has, IndexError for a place beyond the last.
        """
        if isinstance(name, int):
            return self.views[name]
        for view in self.views:
            if view.name == name:
                return view
        raise InputError(f"{self.name}: no view named '{name}'; {_few(name, [v.name for v in self.views])}")

    def __iter__(self) -> Iterator[View]:
        return iter(self.views)

    def __len__(self) -> int:
        return len(self.views)


def _few(name: str, names: list[str]) -> str:
    """A dive has thousands of names: list them only when that fits on the line."""
    return (
        did_you_mean(name, names)
        if len(names) <= 12
        else did_you_mean(name, names).split("known:")[0]
        + (f"the scene has {len(names)} views, {names[0]} to {names[-1]}")
    )


@dataclass(frozen=True, eq=False)
class Restoration:
    """What a method makes of a view.

    image: (H, W, 3) float in the view's encoding; may leave [0, 1]; NaN where the method gives no colour;
    water: as estimated; confidence: (H, W), posterior standard deviation or the method's own measure;
    info: anything worth keeping: cost, iterations, "device"; filled: (H, W, 3) as image, guessed colours of pixels that
    image has none for, NaN elsewhere: they are drawn and never scored.

    >>> image = np.full((48, 64, 3), 0.5)
    >>> image[:24] = np.nan
    >>> Restoration(image)
    Restoration: 64x48 pixels, 50 % with colour, values 0.5 to 0.5
    """

    image: Array
    water: Water | None = None
    confidence: Array | None = None
    info: dict[str, Any] = field(default_factory=dict)
    filled: Array | None = None

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        valid = self.valid
        values = self.image[valid]
        span = f", values {values.min():.3g} to {values.max():.3g}" if values.size else ""
        line = f"{type(self).__name__}: {width}x{height} pixels, {100 * valid.mean():.0f} % with colour{span}"
        return "\n".join([line, *([repr(self.water)] if self.water else [])])

    @property
    def valid(self) -> Mask:
        """(H, W) bool: pixels where the method gives all three colours."""
        return coloured(self.image)


@dataclass(frozen=True)
class Score:
    """One number a metric gives.

    region: "image", a chart's name, or "<chart>/<patch>"; n_pixels: how many pixels it is made of;
    coverage: the share of the region's pixels that it is made of, 0 to 1; weight: of a score of a pair of views, in the
    mean over a view's pairs.

    >>> Score(0.93, region="near/red", n_pixels=120)
    Score(value=0.93, region='near/red', n_pixels=120, coverage=1.0, weight=1.0)
    """

    value: float
    region: str = "image"
    n_pixels: int = 0
    coverage: float = 1.0
    weight: float = 1.0
