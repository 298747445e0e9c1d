"""Renders a made sea: `render(Nature(condition="fish"))` returns arrays of all views."""

import functools
from collections.abc import Callable, Iterator

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from sucre_bench.arrays import Array, Mask
from sucre_bench.camera import Camera, intrinsics, pose_of
from sucre_bench.datasets.nature import Nature, PathName, Relief, WaterName
from sucre_bench.datasets.nature.conditions import Condition
from sucre_bench.datasets.nature.seabed import FAR_M, RAYS, Seabed, make_seabed, octaves

# Veiling light B, attenuation beta and backscatter gamma (1/m) of red, green, blue.
WATERS: dict[WaterName, tuple[tuple[float, float, float], ...]] = {
    "coastal": ((0.08, 0.30, 0.36), (0.42, 0.16, 0.14), (0.32, 0.19, 0.16)),
    "clear": ((0.04, 0.20, 0.32), (0.30, 0.06, 0.04), (0.24, 0.09, 0.07)),
    "deep": ((0.02, 0.10, 0.18), (0.36, 0.10, 0.07), (0.26, 0.13, 0.10)),
    "green": ((0.10, 0.34, 0.20), (0.48, 0.18, 0.30), (0.36, 0.22, 0.32)),
    "blue": ((0.05, 0.18, 0.38), (0.38, 0.12, 0.06), (0.30, 0.15, 0.08)),
    "haze": ((0.25, 0.42, 0.46), (0.75, 0.45, 0.42), (0.60, 0.40, 0.38)),
}
_RELIEF_M: dict[Relief, float] = {"normal": 0.35, "flat": 0.03, "rough": 0.9}
_MOST_GAIN = 4  # of a camera's automatics
_AT_ONCE = 20_000  # pixels
_MIDDLE = RAYS * RAYS // 2


def _ahead(azimuth: float, pitch_deg: float) -> Array:
    pitch = np.deg2rad(pitch_deg)
    return np.array(
        [np.sin(azimuth) * np.cos(pitch), np.cos(azimuth) * np.cos(pitch), -np.sin(pitch)]
    )


def _round(azimuth: float, pitch_deg: float, distance_m: float) -> tuple[Array, Array]:
    return -distance_m * _ahead(azimuth, pitch_deg), _ahead(azimuth, pitch_deg)


def _down(s: float, height_m: float, length_m: float = 4) -> tuple[Array, Array]:
    return np.array([0.3 * np.sin(7 * s), length_m * (s - 0.5), height_m]), _ahead(0, 78)


# Centre of the camera and the direction in which it looks, at time s from 0 to 1.
_PATHS: dict[PathName, Callable[[float], tuple[Array, Array]]] = {
    "approach": lambda s: _round(0.25 * np.sin(8 * s + 0.5), 60 - 20 * s, 10 * 0.2**s),
    "forward": lambda s: (
        np.array([0.2 * np.sin(6 * s), -2 + 4 * s, 1.8]),
        _ahead(0.1 * np.sin(9 * s), 36),
    ),
    "survey": lambda s: _down(s, 2.5),
    "survey_two_heights": lambda s: _down(2 * s % 1.0001, 2 if s < 0.5 else 4, 2.5),
    "survey_varying": lambda s: _down(s, 2.6 + 1.3 * np.sin(9.4 * s)),
    "orbit": lambda s: _round(2 * s - 1, 40, 4 + 0.6 * np.sin(5 * s)),
}


def _poses(path: PathName, views: int, rng: np.random.Generator) -> Iterator[Array]:
    for s in np.linspace(0, 1, views):
        centre, ahead = _PATHS[path](float(s))
        ahead = ahead + rng.normal(0, 0.02, 3)
        ahead = ahead / np.linalg.norm(ahead)
        right = np.cross(ahead, (0, 0, 1))
        right = right / np.linalg.norm(right)
        roll = rng.normal(0, 0.03)
        across = np.cos(roll) * right + np.sin(roll) * np.cross(ahead, right)
        turn = np.stack([across, np.cross(ahead, across), ahead])
        yield pose_of(turn, -turn @ (centre + rng.normal(0, 0.03, 3)))


def camera_of(width: int, height: int) -> Camera:
    """Return the camera of all views: 64 degrees wide, its principal point a little off the centre."""
    focal = 0.8 * width
    return Camera(intrinsics(focal, focal, 0.502 * width, 0.497 * height), width, height)


def render(options: Nature) -> dict[str, Array]:
    """Return the arrays of a scene, as `Nature.arrays` describes them."""
    spec = options.spec
    rng = np.random.default_rng(
        [options.seed, *repr((spec, options.water, options.path, options.relief)).encode()]
    )
    seabed, poses = _place(options.seed, options.path, options.relief, options.views)
    camera = camera_of(options.width, options.height)
    B, beta, gamma = np.array(WATERS[options.water]) * (not spec.air)
    with_fish = [options.views // 6, options.views // 2][: spec.fish]
    radiances: list[Array] = []
    grounds: list[Array] = []
    depths: list[Array] = []
    waters: list[Array] = []
    for place, pose in enumerate(poses):
        change = np.exp(spec.patchy * rng.normal(size=3))
        water = np.stack([B, beta * change, gamma * change])
        image, ground, depth = _see(seabed, camera, pose, spec, water, rng)
        if place in with_fish:
            image, is_fish = _with_fish(image, depth, water, rng)
            ground = np.where(is_fish[..., None], np.nan, ground)
        if spec.snow:
            bright = np.where(
                rng.random(depth.shape) < spec.snow, rng.uniform(0.4, 0.9, depth.shape), 0
            )
            image = np.maximum(image, bright[..., None])
        radiances.append(image * _lens(camera, spec.vignette))
        grounds.append(ground)
        depths.append(depth)
        waters.append(water)
    water = np.stack(waters)
    gains = _gains(np.stack([image.mean(axis=(0, 1)) for image in radiances]), spec, rng)
    water[:, 0] *= gains
    if spec.tone:
        water[:] = np.nan
    shown_gains = gains
    if spec.strobe_deg:
        water[:, [0, 2]] = np.nan  # the veil of a strobe has another form
        shown_gains = gains / gains.mean()
    lit = [_stored(image * gain, spec) for image, gain in zip(radiances, gains, strict=True)]
    reference = [
        _stored(ground * gain, spec) for ground, gain in zip(grounds, shown_gains, strict=True)
    ]
    return {
        "rgb": np.stack([_file(image, spec, rng) for image in lit]),
        "reference": np.stack(reference).astype(np.float32),
        "depth": np.stack([_wrong_depth(depth, spec, rng) for depth in depths]).astype(
            np.float32
        ),
        "pose": _drifting(poses, np.stack(depths), camera, spec, rng),
        "water": water,
    }


@functools.lru_cache(maxsize=1)
def _place(seed: int, path: PathName, relief: Relief, views: int) -> tuple[Seabed, Array]:
    """Return the ground and the true poses (V, 4, 4), which all conditions share."""
    rng = np.random.default_rng([seed, *repr((path, relief)).encode()])
    seabed = make_seabed(rng, _RELIEF_M[relief])
    return seabed, np.stack(list(_poses(path, views, rng)))


def _see(
    seabed: Seabed,
    camera: Camera,
    pose: Array,
    spec: Condition,
    water: Array,
    rng: np.random.Generator,
) -> tuple[Array, Array, Array]:
    """Return light at the lens (H, W, 3), the ground without water in even light (H, W, 3), and depth (H, W)."""
    caustics = _caustics(rng) if spec.caustics else None
    B, beta, gamma = water

    def of_pixels(first: int, last: int) -> tuple[Array, ...]:
        """Direct light, veil and ground (P, 3), depth and distance (P,) of pixels, row by row."""
        distance, points = seabed.cast(camera.K, pose, camera.width, first, last)
        is_open = distance < 0
        ground = 0.5 + spec.contrast * (seabed.albedo(points) - 0.5)
        ground[is_open] = 0
        t = np.where(is_open, 1e3, distance)[..., None]
        even = ground.mean(axis=1)
        if caustics is not None:
            ground = ground * (1 + spec.caustics * caustics(points))
        direct = spec.daylight * ground * np.exp(-beta * t)
        veil = spec.daylight * (B * (1 - np.exp(-gamma * t))).mean(axis=1)
        middle, is_open = points[:, _MIDDLE], is_open[:, _MIDDLE]
        if spec.strobe_deg:
            light = _strobe(pose, spec.strobe_deg, beta)
            direct = direct + 4 * ground * light(points) * np.exp(-beta * t)
            veil = veil + 4 * _scattered(light, middle, is_open, pose, B, gamma)
        depth = np.where(is_open, 0, middle @ pose[2, :3] + pose[2, 3])
        return direct.mean(axis=1), veil, even, depth, t[:, _MIDDLE, 0]

    n_pixels = camera.height * camera.width
    starts = range(0, n_pixels, _AT_ONCE)
    blocks = [of_pixels(first, min(first + _AT_ONCE, n_pixels)) for first in starts]
    planes = [
        np.concatenate(plane).reshape(camera.height, camera.width, -1)
        for plane in zip(*blocks, strict=True)
    ]
    direct, veil, ground, depth, distance = planes
    if spec.blur_px_m:
        sigma = np.minimum(spec.blur_px_m * distance[..., 0], 7.99)
        stack = np.stack([gaussian_filter(direct, (s, s, 0)) for s in range(9)])
        below = sigma.astype(int)
        v, u = np.indices(below.shape)
        direct = stack[below, v, u] + (sigma - below)[..., None] * (
            stack[below + 1, v, u] - stack[below, v, u]
        )
    return direct + veil, ground, depth[..., 0]


def _caustics(rng: np.random.Generator) -> Callable[[Array], Array]:
    """Return a pattern of bright lines on the ground, of points (P, 9, 3): (P, 9, 1) of mean 0 and deviation 1."""
    lattice, shift = rng.uniform(-1, 1, (256, 256)), rng.uniform(0, 50, 2)

    def lines(places: Array) -> Array:
        return np.asarray(np.exp(-3 * np.abs(octaves(lattice, places, 0.5, 2, 0.5))))

    sample = lines(rng.uniform(0, 50, (20_000, 2)))

    def pattern(points: Array) -> Array:
        found = (lines(points[..., :2].reshape(-1, 2) + shift) - sample.mean()) / sample.std()
        return found.reshape(*points.shape[:2], 1)

    return pattern


def _strobe(pose: Array, width_deg: float, beta: Array) -> Callable[[Array], Array]:
    """Return the light of a strobe beside the camera at points (..., 3) that its water leaves: (..., 3)."""
    turn = pose[:3, :3]
    place = turn.T @ (np.array([0.3, -0.1, 0]) - pose[:3, 3])

    def light(points: Array) -> Array:
        to = points - place
        r = np.linalg.norm(to, axis=-1)
        angle = np.rad2deg(np.arccos(np.clip(to @ turn[2] / r, -1, 1)))
        lobe = np.exp(-0.5 * (angle / width_deg) ** 2)
        return np.asarray(
            (lobe / np.maximum(r, 0.2) ** 2)[..., None] * np.exp(-beta * r[..., None])
        )

    return light


def _scattered(
    light: Callable[[Array], Array],
    points: Array,
    is_open: Mask,
    pose: Array,
    B: Array,
    gamma: Array,
) -> Array:
    """Return the light of a strobe that water scatters once, on the way to points (P, 3): (P, 3)."""
    origin = -pose[:3, :3].T @ pose[:3, 3]
    away = points - origin
    distance = np.linalg.norm(away, axis=1)
    toward = np.where(is_open[:, None], pose[2, :3], away / distance[:, None])[:, None]
    length = np.where(is_open, FAR_M, distance)[:, None, None]
    steps = (np.arange(24) + 0.5)[:, None] / 24
    along = length * steps**2  # finer where the strobe is bright
    weight = length * 2 * steps / 24
    return np.asarray(
        (B * gamma * np.exp(-gamma * along) * light(origin + along * toward) * weight).sum(
            axis=1
        )
    )


def _with_fish(
    image: Array, depth: Array, water: Array, rng: np.random.Generator
) -> tuple[Array, Mask]:
    """Return the image with striped ellipses on 5 to 15 % of it, nearer than the ground, and where they are."""
    B, beta, gamma = water
    height, width = depth.shape
    wanted, covered = rng.uniform(0.07, 0.13), np.zeros((height, width), bool)
    v, u = np.indices(depth.shape)
    while covered.mean() < wanted:
        half = width * rng.uniform(0.05, 0.11)
        centre, turn = rng.uniform((0, 0), (width, height)), rng.uniform(-0.6, 0.6)
        along = (u - centre[0]) * np.cos(turn) + (v - centre[1]) * np.sin(turn)
        across = (v - centre[1]) * np.cos(turn) - (u - centre[0]) * np.sin(turn)
        body = (along / half) ** 2 + (across / (0.45 * half)) ** 2 < 1
        if not body.any():
            continue
        near = rng.uniform(0.4, 0.7) * np.median(depth[depth > 0])
        colour = rng.uniform(0.1, 0.9, 3) * (0.8 + 0.2 * np.sin(across / half * 14)[..., None])
        shown = colour * np.exp(-beta * near) + B * (1 - np.exp(-gamma * near))
        image = np.where(body[..., None], shown, image)
        covered |= body
    return image, covered


def _lens(camera: Camera, vignette: float) -> Array:
    """Return the transmission (H, W, 1) of a lens: cos^4 of an angle, 1 - vignette in the farthest corner."""
    x = np.arange(camera.width) + 0.5 - camera.K[0, 2]
    y = (np.arange(camera.height) + 0.5 - camera.K[1, 2])[:, None]
    r2 = (x**2 + y**2) / (x**2 + y**2).max()
    return np.asarray(1 / (1 + ((1 - vignette) ** -0.5 - 1) * r2) ** 2)[..., None]


def _gains(means: Array, spec: Condition, rng: np.random.Generator) -> Array:
    """Return the gains (V, 3) of views whose channels have means (V, 3)."""
    n = len(means)
    gains = np.exp(
        spec.exposure * rng.normal(size=(n, 1)) + spec.white_balance * rng.normal(size=(n, 3))
    )
    gains = gains * (means.mean(axis=1, keepdims=True) / means) ** spec.auto_white_balance
    if spec.auto_exposure:
        needed = 0.4 / (means * gains).mean(axis=1, keepdims=True)
        gains = gains * (needed if spec.strobe_deg else np.minimum(needed, _MOST_GAIN))
    elif spec.strobe_deg:
        gains = gains * 0.35 / means.mean()
    return np.asarray(gains * spec.gain)


def _stored(image: Array, spec: Condition) -> Array:
    image = np.maximum(image, 0)
    if spec.tone == "srgb":
        return np.where(
            image <= 0.0031308,
            12.92 * image,
            1.055 * np.maximum(image, 1e-9) ** (1 / 2.4) - 0.055,
        )
    if spec.tone == "s":
        inside = np.minimum(image, 1)
        return 0.5 * image + 0.5 * inside**2 * (3 - 2 * inside)
    return image


def _file(image: Array, spec: Condition, rng: np.random.Generator) -> Array:
    """Return what a file of the image (H, W, 3) holds, float32 in [0, 1]."""
    image = np.clip(image + rng.normal(0, spec.noise, image.shape), 0, 1)
    if not (spec.bits or spec.jpeg):
        return image.astype(np.float32)
    levels = np.rint(image * 255).astype(np.uint8)
    if spec.jpeg:
        how = [
            cv2.IMWRITE_JPEG_QUALITY,
            spec.jpeg,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
            cv2.IMWRITE_JPEG_SAMPLING_FACTOR_420,
        ]
        decoded = cv2.imdecode(
            cv2.imencode(".jpg", levels[..., ::-1], how)[1], cv2.IMREAD_COLOR
        )
        levels = np.asarray(decoded)[..., ::-1]
    return levels.astype(np.float32) / np.float32(255)


def _wrong_depth(depth: Array, spec: Condition, rng: np.random.Generator) -> Array:
    """Return the depth map (H, W) that a method is given."""
    patches = gaussian_filter(rng.normal(size=depth.shape), depth.shape[1] / 20)
    error = spec.depth_patches * patches / patches.std() + spec.depth_scale * rng.normal()
    return np.asarray(depth * np.exp(error))


def _drifting(
    poses: Array, depths: Array, camera: Camera, spec: Condition, rng: np.random.Generator
) -> Array:
    """Return the poses (V, 4, 4) that a method is given: turns and shifts that drift along the views.

    Their size is such that the centres of the images move by pose_px, root mean square.
    """
    walk = gaussian_filter1d(np.cumsum(rng.normal(size=(len(poses), 4)), axis=0), 1, axis=0)
    walk -= walk.mean(axis=0)
    moved_px = walk[:, :2] + walk[:, 2:]
    walk *= spec.pose_px / np.sqrt((moved_px**2).sum(axis=1).mean())
    given = poses.copy()
    for pose, depth, (shift_x, shift_y, turn_x, turn_y) in zip(
        given, depths, walk / camera.K[0, 0], strict=True
    ):
        pose[:3] = cv2.Rodrigues(np.array([-turn_y, turn_x, 0]))[0] @ pose[:3]
        pose[:2, 3] += np.median(depth[depth > 0]) * np.array([shift_x, shift_y])
    return given
