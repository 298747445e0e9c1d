"""Makes a scene worse in a known way: the order of the degradations, and when they are applied.

A degradation wraps a scene: planes are degraded when they are loaded, and files do not change. An image is degraded in
the order of the light: added water, blur of the lens, size of the sensor, noise, bits, JPEG. A depth map is resized to
the image, then gets noise, then holes. Water is added with the original depth. The reference only changes its size.
Random numbers depend on the seed and the names of scene and view. So a view gets the same noise with any selection of
other views.
"""

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import distance_map, scaled_camera
from sucre_bench.degrade import depth_and_pose, sensor
from sucre_bench.degrade.options import VIEWS, Degradation, hashed
from sucre_bench.degrade.random_numbers import generator
from sucre_bench.degrade.views import around
from sucre_bench.degrade.water import under_water
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_patches import scaled_chart
from sucre_bench.scene import Chart, Pixels, Plane, Scene, View


def degraded(scene: Scene, degradation: Degradation | None = None, target: str = "", **options: Any) -> Scene:
    """Return a scene with a degradation applied; pixels are degraded when they are loaded.

    - scene: the scene to degrade;
    - degradation: a `Degradation`, or None if its options are given;
    - target: name of the view to restore. `within` and `keep` choose the views around it, and need it;
    - options: the options of a `Degradation`, for example noise=0.02. Another seed gives other random draws.

    Raises InputError for an unknown option, a value out of range, a missing target, or a scene that lacks the depth or
    poses that an option changes.

    >>> import numpy as np
    >>> from sucre_bench.scene import Arrays, View
    >>> scene = Scene("reef", [View("a.png", Arrays(np.full((48, 64, 3), 0.5)))], frozenset())
    >>> bool(degraded(scene, noise=0.02)[0].rgb.std() > 0.01)
    True
    """
    if degradation is not None and options:
        raise InputError(f"options {', '.join(options)} beside a Degradation", "degraded", "give them when making it")
    degradation = Degradation.of(options) if degradation is None else degradation
    whole = degraded_whole(scene, degradation)
    if target:
        return around(whole, whole[target], degradation)
    if degradation.chooses_views:
        raise InputError("within and keep choose views around one", "degrade", "give target=NAME")
    return whole


def degraded_whole(scene: Scene, degradation: Degradation) -> Scene:
    """Apply every degradation except `within` and `keep` to all views.

    Raises InputError if the scene lacks the depth or poses that are to be degraded.
    """
    done = degradation.identity(without=VIEWS)
    if not done:
        return scene
    for option, needed in degradation.needs():
        if needed not in scene.has:
            raise InputError(f"scene '{scene.name}' has no {needed}", f"degrade.{option}", "leave it out")
    added = {"reference", "truth"} if degradation.water else set()
    return dataclasses.replace(
        scene,
        views=[_view(scene, view, degradation) for view in scene.views],
        has=scene.has | added,
        water=degradation.water or scene.water,
        data_id=hashed(scene.data_id, *done),
    )


def _view(scene: Scene, view: View, d: Degradation) -> View:
    camera, charts, pose = view.camera, list(view.charts), view.cam_from_world
    if d.scale != 1 and camera is not None:
        size = (camera.width, camera.height)
        camera = scaled_camera(camera, size, d.scale)
        charts = [scaled_chart(chart, size, (camera.width, camera.height)) for chart in charts]
    elif d.scale != 1:  # the image's size is unknown: right to half a pixel
        charts = [Chart(chart.name, chart.kind, chart.corners * d.scale) for chart in charts]
    if pose is not None and (d.pose_noise_m or d.pose_noise_deg):
        rng = generator(d.seed, scene.name, view.name, "pose")
        pose = depth_and_pose.noisy_pose(pose, d.pose_noise_m, d.pose_noise_deg, rng)
    pixels = view.pixels
    if d.alters_pixels:
        pixels = _Degraded(view, scene.name, d, "reference" in scene.has)
    return dataclasses.replace(view, pixels=pixels, camera=camera, cam_from_world=pose, charts=charts)


@dataclass(frozen=True, eq=False)
class _Degraded:
    """A view's pixels, degraded when they are loaded. has_references: whether water is added to the reference."""

    view: View
    scene: str
    degradation: Degradation
    has_references: bool

    @property
    def source(self) -> Pixels:
        """The pixels before they are degraded."""
        return self.view.pixels

    @property
    def is_jpeg(self) -> bool:
        """Whether the image was a JPEG file, or is passed through one."""
        return self.degradation.jpeg_quality is not None or self.view.is_jpeg

    def load(self, plane: Plane) -> Array | None:
        """Return a degraded plane. Raises InputError if there is no image to add water to."""
        match plane:
            case "rgb":
                return self._rgb()
            case "depth":
                return self._depth()
            case "reference":
                return self._scaled(self._dry() if self.degradation.water else self.view.pixels.load("reference"))

    def _rgb(self) -> Array | None:
        d, encoding = self.degradation, self.view.encoding
        image = self._wet() if d.water else self.view.pixels.load("rgb")
        if image is None:
            return None
        if d.blur_px:
            image = sensor.blurred(image, d.blur_px, encoding)
        image = self._scaled(image)
        assert image is not None
        if d.noise:
            image = sensor.noisy(image, d.noise, self._rng("noise"))
        if d.bits is not None:
            image = sensor.quantised(image, d.bits)
        if d.jpeg_quality is not None:
            image = sensor.through_jpeg(image, d.jpeg_quality, encoding)
        return image

    def _depth(self) -> Array | None:
        d, depth = self.degradation, self._scaled(self.view.pixels.load("depth"))
        if depth is not None and d.depth_noise:
            depth = depth_and_pose.noisy_depth(depth, d.depth_noise, d.depth_noise_px, self._rng("depth_noise"))
        if depth is not None and d.depth_holes:
            depth = depth_and_pose.with_holes(depth, d.depth_holes, d.depth_hole_px, self._rng("depth_holes"))
        return depth

    def _dry(self) -> Array:
        """The image without water: the reference if the scene has references, else the image."""
        dry = self.view.pixels.load("reference" if self.has_references else "rgb")
        if dry is None:
            raise InputError(
                "has no reference to add water to, but other views have one", self.view.name, "leave the view out"
            )
        return dry

    def _wet(self) -> Array:
        depth, water, camera = self.view.pixels.load("depth"), self.degradation.water, self.view.camera
        if depth is None or not (depth > 0).any():
            raise InputError("has no depth, which added water needs", self.view.name, "leave the view out")
        assert water is not None
        if (water.encoding or self.view.encoding) != self.view.encoding:
            fault = f"degrade.add_water has the encoding {water.encoding}, the view {self.view.encoding}"
            raise InputError(fault, self.view.name, "give water of the view's encoding")
        return under_water(self._dry(), depth if camera is None else distance_map(camera, depth), water)

    def _scaled(self, plane: Array | None) -> Array | None:
        scale = self.degradation.scale
        return plane if plane is None or scale == 1 else sensor.shrunk(plane, scale)

    def _rng(self, what: str) -> np.random.Generator:
        return generator(self.degradation.seed, self.scene, self.view.name, what)
