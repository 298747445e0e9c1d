"""Makes a scene worse in a known way: the order of the degradations, and when they are applied.

A degradation wraps a scene: planes are degraded when they are loaded, and files do not change. An image is degraded in
the order of the light: added water, blur of the lens, size of the sensor, noise, bits, JPEG. A depth map is resized to
the image, then gets noise, then holes. Water is added with the original depth. The reference only changes its size.
Random numbers depend on the seed and the names of scene and view. So a view gets the same noise with any selection of
other views.
"""

import dataclasses
import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from sucre_bench.arguments import checked
from sucre_bench.arrays import Array
from sucre_bench.camera import distance_map, scaled_camera
from sucre_bench.degrade.options import VIEWS, Degradation, hashed
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_patches import scaled_chart
from sucre_bench.imaging.colour_profiles import Profile
from sucre_bench.imaging.encoding import converted
from sucre_bench.scene import Chart, Encoding, Pixels, Plane, Scene, View, Water

__all__ = ["Degradation", "around", "degraded", "degraded_whole"]


@checked
def degraded(
    scene: Scene, degradation: Degradation | None = None, target: str = "", **options: Any
) -> Scene:
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
        raise InputError(
            f"options {', '.join(options)} beside a Degradation",
            "degraded",
            "give them when making it",
        )
    degradation = Degradation.of(options) if degradation is None else degradation
    words = degradation.labelled(scene.degraded).removeprefix(",")
    whole = degraded_whole(scene, degradation)
    if degradation.identity():
        whole = dataclasses.replace(whole, degraded=words)
    if target:
        return around(whole, whole[target], degradation)
    if degradation.chooses_views:
        raise InputError(
            "within and keep choose views around one", "degrade", "give target=NAME"
        )
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
            raise InputError(
                f"scene '{scene.name}' has no {needed}", f"degrade.{option}", "leave it out"
            )
    d = degradation
    views = []
    for view in scene.views:
        camera = view.camera
        charts = list(view.charts)
        pose = view.cam_from_world
        if d.scale != 1 and camera is not None:
            size = camera.size
            camera = scaled_camera(camera, size, d.scale)
            charts = [scaled_chart(chart, size, camera.size) for chart in charts]
        elif d.scale != 1:  # the image's size is unknown: right to half a pixel
            charts = [
                Chart(chart.name, chart.kind, chart.corners * d.scale) for chart in charts
            ]
        if pose is not None and (d.pose_noise_m or d.pose_noise_deg):
            rng = generator(d.seed, scene.name, view.name, "pose")
            pose = noisy_pose(pose, d.pose_noise_m, d.pose_noise_deg, rng)
        pixels = (
            _Degraded(view, scene.name, d, "reference" in scene.has)
            if d.alters_pixels
            else view.pixels
        )
        views.append(
            dataclasses.replace(
                view, pixels=pixels, camera=camera, cam_from_world=pose, charts=charts
            )
        )
    added = {"reference", "truth"} if degradation.water else set()
    return dataclasses.replace(
        scene,
        views=views,
        has=scene.has | added,
        water=degradation.water or scene.water,
        data_id=hashed(scene.data_id, *done),
    )


@dataclass(frozen=True, eq=False)
class _Degraded:
    """A view's pixels, degraded when they are loaded."""

    view: View
    scene: str
    degradation: Degradation

    has_references: bool
    """Whether water is added to the reference."""

    @property
    def source(self) -> Pixels:
        """The pixels before they are degraded."""
        return self.view.pixels

    @property
    def is_jpeg(self) -> bool:
        """Whether the image was a JPEG file, or is passed through one."""
        return self.degradation.jpeg_quality is not None or self.view.is_jpeg

    @property
    def profile(self) -> Profile | None:
        """The colour profile of the image; of a reference that water was added to, none: references are in sRGB."""
        has_srgb = bool(self.degradation.water) and self.has_references
        return None if has_srgb else getattr(self.source, "profile", None)

    def load(self, plane: Plane) -> Array | None:
        """Return a degraded plane. Raises InputError if there is no image to add water to."""
        d = self.degradation
        if plane == "rgb":
            return self._image()
        if plane == "reference" and d.water:
            dry = self._dry()
            values = self.profile.to_srgb(dry, self.view.encoding) if self.profile else dry
            return shrunk(values, d.scale)
        stored = self.source.load(plane)
        if stored is None:
            return None
        values = shrunk(stored, d.scale)
        return self._worse_depth(values) if plane == "depth" else values

    def _image(self) -> Array | None:
        """The degraded image."""
        d = self.degradation
        encoding = self.view.encoding
        image = self._under_water(d.water) if d.water else self.source.load("rgb")
        if image is None:
            return None
        if d.blur_px:
            image = blurred(image, d.blur_px, encoding)
        image = shrunk(image, d.scale)
        if d.noise:  # independent in every pixel and channel
            noise = self._random("noise").standard_normal(image.shape, dtype=np.float32)
            image = np.asarray((image + np.float32(d.noise) * noise).clip(0, 1))
        if d.bits is not None:  # 2^bits levels, 0 and 1 among them
            top = np.float32(2**d.bits - 1)
            image = np.asarray(np.rint(image.clip(0, 1) * top) / top)
        if d.jpeg_quality is not None:
            image = through_jpeg(image, d.jpeg_quality, encoding)
        return image

    def _worse_depth(self, depth: Array) -> Array:
        """A depth map with noise and holes; 0 = unknown stays."""
        d = self.degradation
        shape = (depth.shape[0], depth.shape[1])
        if d.depth_noise:
            field = random_field(self._random("depth_noise"), shape, d.depth_noise_px)
            depth = np.asarray((depth * (1 + d.depth_noise * field)).clip(0), dtype=np.float32)
        known = depth > 0
        if d.depth_holes and known.any():  # where a random field is lowest
            field = random_field(self._random("depth_holes"), shape, d.depth_hole_px)
            lowest = field < np.quantile(field[known], d.depth_holes)
            depth = np.where(lowest, np.float32(0), depth)
        return depth

    def _random(self, quantity: str) -> np.random.Generator:
        return generator(self.degradation.seed, self.scene, self.view.name, quantity)

    def _under_water(self, water: Water) -> Array:
        depth = self.source.load("depth")
        if depth is None or not (depth > 0).any():
            fault = "has no depth, which added water needs"
            raise InputError(fault, self.view.name, "leave the view out")
        if (water.encoding or self.view.encoding) != self.view.encoding:
            fault = f"degrade.add_water has the encoding {water.encoding}, the view {self.view.encoding}"
            raise InputError(fault, self.view.name, "give water of the view's encoding")
        camera = self.view.camera
        distance = depth if camera is None else distance_map(camera, depth)
        return under_water(self._dry(), distance, water)

    def _dry(self) -> Array:
        """The image without water: the reference if the scene has references, else the image."""
        dry = self.view.pixels.load("reference" if self.has_references else "rgb")
        if dry is None:
            fault = "has no reference to add water to, but other views have one"
            raise InputError(fault, self.view.name, "leave the view out")
        return dry


def generator(seed: int, *names: str) -> np.random.Generator:
    """Return the generator of a seed and names: of the scene, the view and the quantity."""
    digest = hashlib.blake2b(repr((seed, names)).encode(), digest_size=16).digest()
    return np.random.default_rng(np.random.SeedSequence(int.from_bytes(digest, "big")))


def random_field(rng: np.random.Generator, shape: tuple[int, int], grain_px: float) -> Array:
    """Return a Gaussian random field (H, W) float32 whose root mean square is 1.

    grain_px: standard deviation in pixels of the Gaussian that white noise is smoothed by, 0 for none. The smoothing
    goes round the borders, so that the field is as strong there as elsewhere.
    """
    import scipy.fft
    from scipy.ndimage import fourier_gaussian

    field = rng.standard_normal(shape, dtype=np.float32)
    if grain_px > 0:
        spectrum = fourier_gaussian(scipy.fft.rfft2(field), grain_px, n=shape[1])
        field = scipy.fft.irfft2(spectrum, s=shape).astype(np.float32)
    return np.asarray(field / np.sqrt(np.mean(field**2, dtype=np.float64)), dtype=np.float32)


def noisy_pose(
    cam_from_world: Array, sd_m: float, sd_deg: float, rng: np.random.Generator
) -> Array:
    """Return a (4, 4) pose whose centre is moved along each axis, and which is turned about each of the camera's axes.

    sd_m, sd_deg: standard deviations of each of the three, in metres and degrees; the camera turns about its centre.
    """
    from scipy.spatial.transform import Rotation

    shift, turn = rng.standard_normal((2, 3)) * [[sd_m], [sd_deg]]
    rotation = cam_from_world[:3, :3]
    centre = -rotation.T @ cam_from_world[:3, 3] + shift
    noisy = np.eye(4)
    noisy[:3, :3] = Rotation.from_rotvec(turn, degrees=True).as_matrix() @ rotation
    noisy[:3, 3] = -noisy[:3, :3] @ centre
    return noisy


# Images are (H, W, 3) float32 in [0, 1], RGB.


def blurred(image: Array, sd_px: float, encoding: Encoding) -> Array:
    """Return an image blurred by a Gaussian in linear light, like a lens."""
    import cv2

    light: Array = np.asarray(
        cv2.GaussianBlur(converted(image, encoding, "linear"), (0, 0), sd_px), dtype=np.float32
    )
    return np.asarray(converted(light, "linear", encoding), dtype=np.float32)


def shrunk(plane: Array, scale: float) -> Array:
    """Return a plane (H, W, 3) or (H, W) in another size: colours by area, depths by the nearest value."""
    import cv2

    if scale == 1:
        return plane
    how = cv2.INTER_AREA if plane.ndim == 3 else cv2.INTER_NEAREST_EXACT
    size = [max(1, round(side * scale)) for side in plane.shape[1::-1]]
    return np.asarray(cv2.resize(plane, size, interpolation=how))


def through_jpeg(image: Array, quality: int, encoding: Encoding) -> Array:
    """Return an image after storage in an 8-bit JPEG file (libjpeg's quality, 4:2:0).

    JPEG files are gamma-encoded: a linear image is encoded and decoded again.
    """
    import cv2

    picture = np.rint(converted(image, encoding, "gamma").clip(0, 1) * 255).astype(np.uint8)
    written, file = cv2.imencode(
        ".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality]
    )
    assert written
    read = cv2.imdecode(file, cv2.IMREAD_COLOR)
    assert read is not None
    return np.asarray(
        converted(read[..., ::-1] / np.float32(255), "gamma", encoding), dtype=np.float32
    )


def under_water(image: Array, z: Array, water: Water) -> Array:
    """Return an image (H, W, 3) float32 as it looks through water, of stored intensities, clipped to [0, 1].

    z: (H, W) metres, 0 = unknown. A pixel without distance gets that of the nearest pixel with one; there must be one.
    It would otherwise look as in air, for which no image-only method is made.
    """
    if (z == 0).any():
        from scipy.ndimage import distance_transform_edt

        nearest = distance_transform_edt(z == 0, return_distances=False, return_indices=True)
        z = z[tuple(nearest)]
    seen = np.empty(image.shape, dtype=np.float32)
    for c in range(3):  # a channel at a time, to save memory: 24 megapixels
        B, beta, gamma = (
            float(p[c]) for p in (water.veiling_light, water.attenuation, water.backscatter)
        )
        seen[..., c] = (image[..., c] * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z))).clip(
            0, 1
        )
    return seen


def around(scene: Scene, target: View, degradation: Degradation) -> Scene:
    """Return a scene with only the views that `within` and `keep` leave around a target, in capture order.

    With the same seed, a smaller `keep` gives a subset of a larger one.
    """
    if not degradation.chooses_views:
        return scene
    within, keep = degradation.within, degradation.keep
    at = [view.name for view in scene.views].index(target.name)
    first, last = (
        (0, len(scene) - 1)
        if within is None
        else (max(0, at - within), min(len(scene) - 1, at + within))
    )
    others = [place for place in range(first, last + 1) if place != at]
    if keep is not None:
        rng = generator(degradation.seed, scene.name, target.name, "keep")
        others = [others[n] for n in rng.permutation(len(others))[: keep - 1]]
    if len(others) == len(scene) - 1:
        return scene
    views = [scene.views[place] for place in sorted([at, *others])]
    data_id = hashed(scene.data_id, "views", [view.name for view in views])
    return dataclasses.replace(scene, views=views, data_id=data_id)
