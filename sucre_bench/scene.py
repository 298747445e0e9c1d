"""Scenes and views: what a dataset yields and a method restores.

Conventions. Pixel coordinates are (x, y) with the top-left corner of the image at (0, 0), so that pixel
(column u, row v) has its centre at (u + 0.5, v + 0.5). Cameras look along +z, x right, y down.
``depth`` is planar, along the optical axis; ``distance`` is Euclidean, from the camera's centre. Both in
metres, 0 where unknown. The last axis of an image is colour, in RGB order.
"""

import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

import numpy as np
import numpy.typing as npt
from cachetools import LRUCache, cached

from sucre_bench.arguments import array_of, checked, checked_fields
from sucre_bench.arrays import Array, Mask, coloured, evenly
from sucre_bench.camera import Camera, distance_map, is_rigid
from sucre_bench.errors import InputError, did_you_mean
from sucre_bench.machine.text_formats import counted
from sucre_bench.thumbnails import as_html

Encoding = Literal["gamma", "linear"]


Plane = Literal["rgb", "depth", "reference"]

# what views of a scene may have
HAS = frozenset({"depth", "poses", "reference", "charts", "truth"})


# A cache of decoded planes. A method may use `view.rgb` five times and the file is decoded once; a dive of 5,000 images
# still does not fill the memory. Small planes decode fast, so few of them are kept.
_KEPT_BYTES = 768 << 20
_LEAST_KEPT_BYTES = _KEPT_BYTES // 256


@dataclass(frozen=True, eq=False)
@checked_fields
class Water:
    """The parameters of the water's colour model, I = J exp(-beta z) + B (1 - exp(-gamma z)) (SUCRe, eq. 2).

    I is the photograph, J the colour without water, z the distance in metres. All three arrays are RGB; a parameter
    that a method does not estimate is NaN.

    >>> Water(np.array([0.06, 0.22, 0.30]), np.array([0.42, 0.14, 0.10]), np.array([0.30, 0.17, 0.13]))
    Water           red   green    blue
      B           0.060   0.220   0.300
      beta 1/m    0.420   0.140   0.100
      gamma 1/m   0.300   0.170   0.130
    """

    veiling_light: Array
    """(3,): B, in image intensity."""

    attenuation: Array
    """(3,): beta, 1/m."""

    backscatter: Array
    """(3,): gamma, 1/m."""

    encoding: Encoding | None = None
    """Of I and J, "gamma" or "linear"; None if it is that of the view."""

    def __post_init__(self) -> None:
        for name in ("veiling_light", "attenuation", "backscatter"):
            object.__setattr__(
                self, name, array_of(f"Water.{name}", getattr(self, name), (3,), kinds="fiu")
            )

    def __repr__(self) -> str:
        named = {
            "B": self.veiling_light,
            "beta 1/m": self.attenuation,
            "gamma 1/m": self.backscatter,
        }
        lines = ["Water           red   green    blue"]
        lines += [
            f"  {name:9}" + "".join(f"{value:8.3f}".rjust(8) for value in row)
            for name, row in named.items()
        ]
        return "\n".join(
            lines + ([f"  of {self.encoding} intensities"] if self.encoding else [])
        )


@dataclass(frozen=True, eq=False)
@checked_fields
class Chart:
    """A colour chart in a view.

    >>> Chart("near", "dgk", np.array([[10, 10], [90, 10], [90, 60], [10, 60]])).name
    'near'
    """

    name: str
    """Unique in the view. A chart has the same name in all views."""

    kind: str
    """Layout and reference colours: "dgk", "colorchecker24", "colorchecker_sg", or the path of a CSV file."""

    corners: Array
    """(4, 2) float64 pixels: the corners of the chart's frame, top left, top right, bottom right, bottom left, as one
    reads the chart (not as it lies in the image)."""

    def __post_init__(self) -> None:
        object.__setattr__(
            self,
            "corners",
            array_of("Chart.corners", self.corners, (4, 2), finite=True, kinds="fiu"),
        )


class Pixels(Protocol):
    """The source of a view's pixels. The view calls `load` when a plane is needed.

    >>> class Black:
    ...     def load(self, plane):
    ...         return np.zeros((48, 64, 3), np.float32) if plane == "rgb" else None
    >>> View("black.png", Black()).rgb.shape
    (48, 64, 3)
    """

    def load(self, plane: Plane) -> Array | None:
        """Return a plane as float32: "rgb" (H, W, 3), "depth" (H, W) in metres, or "reference" (H, W, 3).

        Return None if the view has no such plane. Raise InputError with the name of the file if it cannot be read.
        """
        ...


# Restored images may exceed 1, in places by far; their typical values stay below this. Those of 0 to 255 do not.
_MOST_TYPICAL = 16.0
_DOUBLE = 2.0  # of white: the median of a photograph is not above this
# below black, and share of the pixels of a photograph that may be lower
_NOISE = 0.05
_STRAY = 0.01

# Rows and columns of an image that tell its range.
_LOOKED_AT = 48

_MOST_SHOWN = 4  # views of a scene, in a notebook


def _intensities(given: object, place: str, is_input: bool = False) -> Array:
    """Return an image as (H, W, 3) floats with 1 for white. place: its name; is_input: it is of a photograph.

    Raises InputError for another shape, and for an image of 0 to 255 or 0 to 65535, by its type or a sample of its
    values.
    """
    image: Array = array_of(place, given, ("H", "W", 3), kinds="fiu")
    white = np.iinfo(np.uint16).max
    height, width = image.shape[:2]
    sample = image[:: max(1, height // _LOOKED_AT), :: max(1, width // _LOOKED_AT)]
    sample = sample[np.isfinite(sample)]
    if not sample.size:
        return image
    low = sample.min()
    top = sample.max()
    typical = np.median(sample)
    # a dark image of 0 to 255
    is_whole = top > 1 and (sample == np.rint(sample)).all() and np.unique(sample).size > 2
    if image.dtype.kind in "iu":
        fault = f"is {image.dtype}"
    elif is_input and (typical > _DOUBLE or (sample < -_NOISE).mean() > _STRAY or top > white):
        fault = f"has values from {low:g} to {top:g}"
    # no file has values below 0 or above white, but a strong restoration
    elif (is_input or (low >= 0 and top <= white)) and (is_whole or typical > _MOST_TYPICAL):
        fault = f"has values up to {top:g}"
    else:
        return image
    if low < 0:
        raise InputError(
            fault, place, "pass intensities: floats with 0 for black and 1 for white"
        )
    remedy = (
        f"divide by {255 if top <= 255 else white}: intensities are floats with 1 for white"
    )
    raise InputError(fault, place, remedy)


@dataclass(frozen=True, eq=False)
@checked_fields
class Arrays:
    """Pixels that are already in memory.

    Raises InputError for an image of 0 to 255, and for planes of different sizes.

    >>> View("a.png", Arrays(np.full((48, 64, 3), 0.5))).rgb.dtype
    dtype('float32')
    """

    rgb: Array
    """(H, W, 3) floats in [0, 1]."""

    depth: Array | None = None
    """(H, W) metres along the optical axis, 0 = unknown; or None."""

    reference: Array | None = None
    """(H, W, 3) floats in [0, 1]: the view without water; or None."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rgb", _intensities(self.rgb, "Arrays.rgb", True))
        size = self.rgb.shape[:2]
        if self.depth is not None:
            object.__setattr__(
                self, "depth", array_of("Arrays.depth", self.depth, size, kinds="fiu")
            )
        if self.reference is not None:
            array_of("Arrays.reference", self.reference, (*size, 3), kinds="fiu")
            object.__setattr__(
                self, "reference", _intensities(self.reference, "Arrays.reference", True)
            )

    def load(self, plane: Plane) -> Array | None:
        values: Array | None = getattr(self, plane)
        # a copy: it will be locked
        return None if values is None else np.array(values, dtype=np.float32)


@dataclass(frozen=True, eq=False)
@checked_fields
class View:
    """One photograph of a scene, with its camera, pose, depth and charts.

    The planes below are float32 and read-only. They are decoded when they are needed, and kept only for a while.

    >>> view = View("a.png", Arrays(np.zeros((48, 64, 3)), depth=np.ones((48, 64))))
    >>> view
    View 'a.png': gamma-encoded, no camera, no pose, no charts
    >>> bool(view.valid.all())
    True
    """

    name: str
    """Path relative to the image folder, unique in the scene."""

    pixels: Pixels
    """The source of `rgb`, `depth` and `reference`."""

    camera: Camera | None = None
    """The pinhole camera; None if unknown."""

    cam_from_world: Array | None = None
    """The pose, a (4, 4) float64 rigid transform; None if unknown."""

    charts: Sequence[Chart] = ()
    """The colour charts in the view."""

    encoding: Encoding = "gamma"
    """Of `rgb` and `reference`: "gamma" (sRGB-like) or "linear"."""

    def __post_init__(self) -> None:
        if not callable(getattr(self.pixels, "load", None)):
            raise InputError(
                f"is {type(self.pixels).__name__}",
                "View.pixels",
                "pass Arrays(rgb), floats 0 to 1",
            )
        if self.cam_from_world is not None:
            pose = array_of(
                "View.cam_from_world", self.cam_from_world, (4, 4), finite=True, kinds="fiu"
            )
            if not is_rigid(pose, 1e-2):
                raise InputError(
                    "is no rotation with a shift",
                    "View.cam_from_world",
                    "pass [R t; 0 0 0 1], metres",
                )
            object.__setattr__(self, "cam_from_world", pose)

    def __repr__(self) -> str:  # of what is known without decoding a file
        size = (
            f"{self.camera.width}x{self.camera.height} pixels" if self.camera else "no camera"
        )
        pose = "a pose" if self.cam_from_world is not None else "no pose"
        charts = (
            f"charts {', '.join(chart.name for chart in self.charts)}"
            if self.charts
            else "no charts"
        )
        return f"View '{self.name}': {self.encoding}-encoded, {size}, {pose}, {charts}"

    def _repr_html_(self) -> str:
        return as_html(repr(self), _pictures([self]))

    @property
    def rgb(self) -> Array:
        """(H, W, 3) float32 in [0, 1], in the encoding of the view. Raises InputError if the view has no image."""
        rgb = _plane(self.pixels, "rgb")
        if rgb is None:
            raise InputError(f"{self.name}: the view has no image; every view needs one")
        return self._of_camera(rgb)

    @property
    def levels(self) -> npt.NDArray[np.uint8] | None:
        """(H, W, 3) uint8, the image with 255 = 1, if the file has 8 bits; otherwise None. `rgb` has the same
        values."""
        levels = getattr(self.pixels, "levels", None)
        return levels() if levels is not None else None

    @property
    def is_jpeg(self) -> bool:
        """Whether the image comes from a JPEG file, which stores colours at half size. Where its source does not say
        so, its name does."""
        said = getattr(self.pixels, "is_jpeg", None)
        return self.name.lower().endswith((".jpg", ".jpeg")) if said is None else bool(said)

    @property
    def has_depth(self) -> bool:
        """Whether the view has a depth map. Reads the map."""
        return _plane(self.pixels, "depth") is not None

    @property
    def depth(self) -> Array:
        """(H, W) float32 metres along the optical axis, 0 = unknown. Raises InputError if the view has no depth map."""
        depth = _plane(self.pixels, "depth")
        if depth is None:
            raise InputError(f"{self.name}: the view has no depth map; this needs one")
        return self._of_camera(depth)

    def _of_camera(self, plane: Array) -> Array:
        height, width = plane.shape[:2]
        if self.camera is not None and (width, height) != self.camera.size:
            fault = f"is {width}x{height}, its camera {self.camera.width}x{self.camera.height}"
            raise InputError(fault, self.name, "give it the camera of this image")
        return plane

    @property
    def distance(self) -> Array:
        """(H, W) float32 metres from the camera's centre, 0 = unknown: ||K^-1 (u + .5, v + .5, 1) depth||.

        Raises InputError if the view has no camera or no depth map.
        """
        if self.camera is None:
            raise InputError(
                f"{self.name}: the view has no camera; distance needs one: write needs of depth and poses"
            )
        return distance_map(self.camera, self.depth)

    @property
    def placed(self) -> tuple[Camera, Array]:
        """The camera and the pose. Raises InputError if the view lacks one of them."""
        if self.camera is None or self.cam_from_world is None:
            raise InputError(
                f"{self.name}: the view has no {'pose' if self.camera else 'camera'}; this needs one"
            )
        return self.camera, self.cam_from_world

    @property
    def reference(self) -> Array | None:
        """(H, W, 3) float32 in [0, 1], the view as it would look without water; None if unknown."""
        return _plane(self.pixels, "reference")

    @property
    def valid(self) -> Mask:
        """(H, W) bool, the pixels with depth; all pixels if the view has no depth map."""
        return (
            np.asarray(self.depth > 0)
            if self.has_depth
            else np.ones(self.rgb.shape[:2], dtype=bool)
        )


def _pictures(views: Sequence[View]) -> dict[str, Array]:
    """The images of views by name, roughly encoded where they are linear; one that cannot be read is left out."""
    pictures = {}
    for view in views:
        with suppress(InputError):
            pictures[view.name] = (
                view.rgb if view.encoding == "gamma" else view.rgb ** (1 / 2.2)
            )
    return pictures


class _Same:
    """A key that is equal to one of the same object only, whatever that is equal to."""

    def __init__(self, thing: object) -> None:
        self._thing = thing  # kept, so that no other gets its id

    def __hash__(self) -> int:
        return id(self._thing)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and self._thing is other._thing


@cached(
    LRUCache(
        _KEPT_BYTES,
        getsizeof=lambda plane: max(0 if plane is None else plane.nbytes, _LEAST_KEPT_BYTES),
    ),
    key=lambda pixels, plane: (_Same(pixels), plane),
    lock=threading.Lock(),
)
def _plane(pixels: Pixels, plane: Plane) -> Array | None:
    loaded = pixels.load(plane)
    if loaded is None:
        return None
    place = f"{type(pixels).__name__}.load('{plane}')"
    if plane == "depth":
        values = array_of(place, loaded, ("H", "W"), kinds="fiu")
    else:
        values = _intensities(loaded, place)
    # a view of it: its owner may go on writing into it
    values = values.astype(np.float32, copy=False).view()
    # What is no distance is unknown. Shared pixels are so already, and a copy of them would not be shared.
    if plane == "depth" and not hasattr(pixels, "levels"):
        values = np.where(np.isfinite(values) & (values > 0), values, 0).astype(np.float32)
    values.setflags(write=False)  # so that no method changes the input of the next
    return values


@dataclass(frozen=True, eq=False)
@checked_fields
class Scene:
    """Views of one place in one water.

    Index a scene by the place or the name of a view:

    >>> views = [View(name, Arrays(np.zeros((48, 64, 3)))) for name in ("a.png", "b.png")]
    >>> scene = Scene("reef", views, frozenset())
    >>> scene
    Scene 'reef': 2 views, a.png to b.png
      has only images
    >>> scene[0] is scene["a.png"]
    True
    """

    name: str
    """Unique in its dataset."""

    views: Sequence[View]
    """In capture order."""

    has: frozenset[str]
    """What at least one view has: "depth", "poses", "reference", "charts", "truth"."""

    water: Water | None = None
    """The true water; None if unknown."""

    data_id: str = ""
    """A short hash of the data. Equal data have equal ids, other data other ids."""

    dataset: str = ""
    """The name of the dataset that it was loaded from, "" for a scene made in Python."""

    degraded: str = ""
    """What `degraded` did to it, "depth_noise=0.05" for example."""

    def __post_init__(self) -> None:
        if unknown := sorted(set(self.has) - HAS):
            raise InputError(
                f"holds '{unknown[0]}'", "Scene.has", f"pass a set of {', '.join(sorted(HAS))}"
            )
        names = Counter(view.name for view in self.views)
        if twice := [name for name, n in names.items() if n > 1]:
            raise InputError(
                f"two views are called '{twice[0]}'",
                "Scene.views",
                "give each view a name of its own",
            )

    def __repr__(self) -> str:
        names = [view.name for view in self.views]
        span = f", {names[0]}" if names else ""
        if len(names) > 1:
            span += f" to {names[-1]}"
        lines = [f"Scene '{self.name}': {counted(len(names), 'view')}{span}"]
        lines.append(f"  has {', '.join(sorted(self.has)) or 'only images'}")
        if self.degraded:
            lines.append(f"  degraded: {self.degraded}")
        return "\n".join(lines + ([repr(self.water)] if self.water else []))

    def _repr_html_(self) -> str:
        return as_html(
            repr(self), _pictures([self.views[n] for n in evenly(len(self.views), _MOST_SHOWN)])
        )

    @checked
    def __getitem__(self, name: str | int) -> View:
        """Return the view with this name, or at this place (from 0; negative from the end).

        Raises InputError if no view has the name, or there is no such place.
        """
        if not isinstance(name, str):
            if -len(self) <= name < len(self):
                return self.views[name]
            remedy = f"the scene has {counted(len(self), 'view')}"
            raise InputError(f"no view at place {name}", self.name, remedy)
        for view in self.views:
            if view.name == name:
                return view
        remedy = did_you_mean(name, [view.name for view in self.views])
        raise InputError(f"no view named '{name}'", self.name, remedy)

    def __iter__(self) -> Iterator[View]:
        return iter(self.views)

    def __len__(self) -> int:
        return len(self.views)


@dataclass(frozen=True, eq=False)
@checked_fields
class Restoration:
    """The result of a method for a view.

    Raises InputError for an image of 0 to 255.

    >>> image = np.full((48, 64, 3), 0.5)
    >>> image[:24] = np.nan
    >>> Restoration(image)
    Restoration: 64x48 pixels, 50 % with colour, values 0.5 to 0.5
    """

    image: Array
    """(H, W, 3) float: J in the encoding of the view. Values may leave [0, 1]; NaN means "no colour"."""

    water: Water | None = None
    """The estimated water, or None."""

    confidence: Array | None = None
    """(H, W): the standard deviation of `image` or the method's own measure; or None."""

    info: dict[Any, Any] = field(default_factory=dict)
    """Any other results by name, for example cost, iterations, "device". They are stored beside the picture."""

    filled: Array | None = None
    """(H, W, 3) like `image`: guessed colours for pixels without colour, NaN elsewhere; or None. Pictures show these
    colours; metrics never score them."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "image", _intensities(self.image, "Restoration.image"))
        if self.filled is not None:
            object.__setattr__(self, "filled", _intensities(self.filled, "Restoration.filled"))
            array_of("Restoration.filled", self.filled, self.image.shape)
        if self.confidence is not None:
            confidence = array_of(
                "Restoration.confidence", self.confidence, self.image.shape[:2], kinds="fiu"
            )
            object.__setattr__(self, "confidence", confidence)

    def __repr__(self) -> str:
        height, width = self.image.shape[:2]
        valid = self.valid
        values = self.image[valid]
        span = f", values {values.min():.3g} to {values.max():.3g}" if values.size else ""
        line = f"{type(self).__name__}: {width}x{height} pixels, {100 * valid.mean():.0f} % with colour{span}"
        return "\n".join([line, *([repr(self.water)] if self.water else [])])

    def _repr_html_(self) -> str:
        return as_html(repr(self), {"": self.image})

    @property
    def valid(self) -> Mask:
        """(H, W) bool, the pixels that have a colour: all three channels are finite."""
        return coloured(self.image)


@dataclass(frozen=True)
@checked_fields
class Score:
    """One number of a metric, for one region of a view.

    >>> Score(0.93, region="near/red", n_pixels=120)
    Score(value=0.93, region='near/red', n_pixels=120, coverage=1.0, weight=1.0)
    """

    value: float
    """In the unit of the metric; NaN if there is nothing to score."""

    region: str = "image"
    """It is "image", the name of a chart, or "<chart>/<patch>"."""

    n_pixels: int = 0
    """Number of pixels that were scored."""

    coverage: float = 1.0
    """Share of the region's pixels that were scored, 0 to 1."""

    weight: float = 1.0
    """For metrics of pairs, the weight of this pair in the mean over the pairs of a view."""
