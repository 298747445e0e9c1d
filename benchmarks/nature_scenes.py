"""Made scenes in natural conditions, with known truth: `make("fish in 1 view", "coastal", "approach")`.

Light is summed in this order: light that reaches the ground, colour of the ground, water along the ray (the model of
SUCRe, with the distance from the camera), the mean over 3 x 3 rays of a pixel, blur, animals and snow, lens, exposure,
tone curve, noise, file. All views have exact poses, and depth maps of the centres of pixels, except where the condition
is about these.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import astuple, dataclass
from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import cv2
import numpy as np
from nature_seabed import FAR_M, RAYS, Array, Seabed, make_seabed, octaves
from scipy.ndimage import gaussian_filter

import sucre_bench as sb

VIEWS = 12
# Veiling light B, attenuation beta and backscatter gamma (1/m) of red, green, blue.
WATERS = {
    "coastal": ((0.08, 0.30, 0.36), (0.42, 0.16, 0.14), (0.32, 0.19, 0.16)),
    "clear": ((0.04, 0.20, 0.32), (0.30, 0.06, 0.04), (0.24, 0.09, 0.07)),
    "deep": ((0.02, 0.10, 0.18), (0.36, 0.10, 0.07), (0.26, 0.13, 0.10)),
    "green": ((0.10, 0.34, 0.20), (0.48, 0.18, 0.30), (0.36, 0.22, 0.32)),
    "blue": ((0.05, 0.18, 0.38), (0.38, 0.12, 0.06), (0.30, 0.15, 0.08)),
    "haze": ((0.25, 0.42, 0.46), (0.75, 0.45, 0.42), (0.60, 0.40, 0.38)),
    "air": ((0, 0, 0), (0, 0, 0), (0, 0, 0)),
}


@dataclass(frozen=True)
class Condition:
    """What nature, camera and files do. Shares are of 1; a jitter is a standard deviation over the views."""

    noise: float = 0.004  # of a stored intensity
    bits: bool = True  # 8-bit files
    jpeg: int = 0  # quality, colours at half size; 0: no JPEG
    gain: float = 1  # of all views
    exposure: float = 0  # jitter
    swell: float = 0  # brightness of whole views, a wave over time
    auto_exposure: bool = False
    white_balance: float = 0  # jitter of each channel
    vignette: float = 0  # loss in the corners
    strobe_deg: float = 0  # width of the lobe; 0: no strobe
    daylight: float = 1  # beside a strobe
    fish: tuple[int, ...] = ()  # places of views
    snow: float = 0  # share of pixels
    caustics: float = 0  # standard deviation of the light on the ground
    pose_px: float = 0
    depth_jitter: float = 0  # of the scale of a view's depth map
    depth_blur_px: float = 0
    depth_noise: float = 0  # share of the depth
    tone: str = ""  # a number: power of the stored intensity; "s": S-curve; "srgb": linear light stored as sRGB
    veil_by_direction: float = 0
    patchy: float = 0  # jitter of beta and gamma
    blur_px_m: float = 0  # forward scatter: standard deviation, pixels a metre
    daylight_fall: float = 0  # 1/m of height
    shading: float = 0
    ripples_m: float = 0
    contrast: float = 1  # of the ground's colours
    air: bool = False
    wrong: str = ""  # "mirrored", "place", "depth": a fault of view 5


MILD = Condition(pose_px=0.3, exposure=0.03, vignette=0.05, caustics=0.03, fish=(5,), snow=0.001, jpeg=92)
CONDITIONS = {
    "ideal": Condition(noise=0, bits=False),
    "8 bit": Condition(noise=0),
    "plain": Condition(),
    "noise .012": Condition(noise=0.012),
    "noise .025": Condition(noise=0.025),
    "JPEG 95": Condition(jpeg=95),
    "JPEG 90": Condition(jpeg=90),
    "JPEG 75": Condition(jpeg=75),
    "fish in 1 view": Condition(fish=(2,)),
    "fish in 2 views": Condition(fish=(2, 5)),
    "snow .5 %": Condition(snow=0.005),
    "caustics 10 %": Condition(caustics=0.10),
    "caustics 25 %": Condition(caustics=0.25),
    "swell 10 %": Condition(swell=0.10),
    "exposure 5 %": Condition(exposure=0.05),
    "exposure 15 %": Condition(exposure=0.15),
    "exposure 30 %": Condition(exposure=0.30),
    "auto exposure": Condition(auto_exposure=True),
    "white balance 3 %": Condition(white_balance=0.03),
    "white balance 10 %": Condition(white_balance=0.10),
    "vignette 15 %": Condition(vignette=0.15),
    "vignette 35 %": Condition(vignette=0.35),
    "strobe": Condition(strobe_deg=35, daylight=0),
    "strobe narrow": Condition(strobe_deg=20, daylight=0),
    "strobe, day .3": Condition(strobe_deg=35, daylight=0.3),
    "strobe, day 1": Condition(strobe_deg=35),
    "strobe, auto exposure": Condition(strobe_deg=35, daylight=0, auto_exposure=True),
    "all mild": MILD,
    "pose .3 px": Condition(pose_px=0.3),
    "pose 1 px": Condition(pose_px=1),
    "tone 1.3": Condition(tone="1.3"),
    "tone .8": Condition(tone=".8"),
    "tone 1/2.2": Condition(tone="0.4545"),
    "S-curve": Condition(tone="s"),
    "linear light as sRGB": Condition(tone="srgb"),
    "clipping 1.8": Condition(gain=1.8),
    "clipping 2.2": Condition(gain=2.2),
    "depth scale 1 %": Condition(depth_jitter=0.01),
    "depth scale 3 %": Condition(depth_jitter=0.03),
    "depth smooth": Condition(depth_blur_px=2),
    "depth noise 1 %": Condition(depth_noise=0.01),
    "veil by direction": Condition(veil_by_direction=0.3),
    "patchy water 10 %": Condition(patchy=0.1),
    "forward scatter": Condition(blur_px_m=0.5),
    "forward scatter .2": Condition(blur_px_m=0.2),
    "in air": Condition(air=True),
    "in air, auto exposure": Condition(air=True, auto_exposure=True),
    "dark": Condition(gain=0.15, noise=0.006),
    "dark .3": Condition(gain=0.3),
    "low contrast": Condition(contrast=0.2),
    "shading": Condition(shading=0.7),
    "ripples": Condition(ripples_m=0.03, shading=0.7, contrast=0.4),
    "daylight falls": Condition(daylight_fall=0.05),
    "one view mirrored": Condition(wrong="mirrored"),
    "one view elsewhere": Condition(wrong="place"),
    "one wrong depth map": Condition(wrong="depth"),
}


def _ahead(azimuth: float, pitch_deg: float) -> Array:
    pitch = np.deg2rad(pitch_deg)
    return np.array([np.sin(azimuth) * np.cos(pitch), np.cos(azimuth) * np.cos(pitch), -np.sin(pitch)])


# Centre of a camera and the direction in which it looks, at time s from 0 to 1.
Path_ = Callable[[float], tuple[Array, Array]]


def _round(azimuth: float, pitch_deg: float, distance_m: float) -> tuple[Array, Array]:
    return -distance_m * _ahead(azimuth, pitch_deg), _ahead(azimuth, pitch_deg)


def _down(s: float, height_m: float, length_m: float = 4) -> tuple[Array, Array]:
    return np.array([0.3 * np.sin(7 * s), length_m * (s - 0.5), height_m]), _ahead(0, 78)


PATHS: dict[str, Path_] = {
    "approach": lambda s: _round(0.25 * np.sin(8 * s + 0.5), 60 - 20 * s, 10 * 0.2**s),
    "forward": lambda s: (np.array([0.2 * np.sin(6 * s), -2 + 4 * s, 1.8]), _ahead(0.1 * np.sin(9 * s), 36)),
    "survey": lambda s: _down(s, 2.5),
    "survey2": lambda s: _down(2 * s % 1.0001, 2 if s < 0.5 else 4, 2.5),
    "survey_varying": lambda s: _down(s, 2.6 + 1.3 * np.sin(9.4 * s)),
    "orbit": lambda s: _round(2 * s - 1, 40, 4 + 0.6 * np.sin(5 * s)),
    "one_view": lambda s: _round(0, 45, 4),
    "one_point": lambda s: (np.array([0.0, 0, 3]), _ahead(0.4 * np.sin(6 * s), 70 + 8 * np.cos(6 * s))),
}
RELIEF_M = {"": 0.35, "flat": 0.03, "rough": 0.9}  # a path's name may end so: "survey2_flat"


@dataclass(frozen=True, eq=False)
class Rays:
    """What the rays of a view meet: distance (P, 9), points, colours and shading of the ground; and its camera."""

    pose: Array
    distance: Array
    points: Array
    albedo: Array
    shade: Array
    is_open: Array  # (P, 9) bool, no ground


def _pose(centre: Array, ahead: Array, roll: float) -> Array:
    right = np.cross(ahead, (0, 0, 1))
    right = right / np.linalg.norm(right)
    down = np.cross(ahead, right)
    across = np.cos(roll) * right + np.sin(roll) * down
    turn = np.stack([across, np.cross(ahead, across), ahead])
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ centre
    return pose


def camera_of(size: tuple[int, int]) -> sb.Camera:
    """Return the camera of all views: 64 degrees wide, its principal point a little off the centre."""
    width, height = size
    K = np.array([[0.8 * width, 0, 0.502 * width], [0, 0.8 * width, 0.497 * height], [0, 0, 1]])
    return sb.Camera(K, width, height)


def _rays(seabed: Seabed, pose: Array, size: tuple[int, int]) -> Rays:
    distance, points = seabed.cast(camera_of(size).K, pose, size)
    is_open = distance < 0
    shade, albedo = seabed.shading(points), seabed.albedo(points)
    albedo[is_open] = 0
    return Rays(pose, np.where(is_open, 1e3, distance), points, albedo, shade, is_open)


@lru_cache(maxsize=1)
def look(geometry: str, size: tuple[int, int], views: int, seed: int, ripples_m: float) -> list[Rays]:
    """Return the rays of all views, and behind them those of the last view at another place."""
    path, _, relief = geometry.partition("_") if geometry not in PATHS else (geometry, "", "")
    if relief not in RELIEF_M:
        path, relief = geometry.rsplit("_", 1)
    rng = np.random.default_rng([seed, *geometry.encode()])
    seabed = make_seabed(rng, RELIEF_M[relief], ripples_m)
    poses = []
    for s in np.linspace(0, 1, views):
        centre, ahead = PATHS[path](float(s))
        still = path == "one_point"
        ahead = ahead + rng.normal(0, 0.02, 3)
        poses.append(
            _pose(centre + rng.normal(0, 0 if still else 0.03, 3), ahead / np.linalg.norm(ahead), rng.normal(0, 0.03))
        )
    poses.append(poses[-1].copy())
    poses[-1][:3, 3] -= poses[-1][:3, :3] @ (17.3, 21.7, 0)
    return [_rays(seabed, pose, size) for pose in poses]


@dataclass(frozen=True, eq=False)
class Made:
    """A made scene; truth: water and J (H, W, 3), in the exposure of the target, by the names of the targets.

    A parameter of the water that the condition leaves without a true value is NaN.
    """

    scene: sb.Scene
    truth: dict[str, tuple[sb.Water, Array]]

    @property
    def targets(self) -> list[str]:
        return list(self.truth)


def _strobe(rays: Rays, spec: Condition, beta: Array) -> tuple[Array, Callable[[Array], Array]]:
    """Return a strobe's light (P, 9, 3) on the ground, and a function of points (P, ..., 3) that gives it anywhere."""
    turn = rays.pose[:3, :3]
    place = turn.T @ (np.array([0.3, -0.1, 0]) - rays.pose[:3, 3])

    def light(points: Array) -> Array:
        to = points - place
        r = np.linalg.norm(to, axis=-1)
        angle = np.rad2deg(np.arccos(np.clip(to @ turn[2] / r, -1, 1)))
        lobe = np.exp(-0.5 * (angle / spec.strobe_deg) ** 2)
        return np.asarray((lobe / np.maximum(r, 0.2) ** 2)[..., None] * np.exp(-beta * r[..., None]))

    return light(rays.points), light


def radiance(
    rays: Rays, spec: Condition, water: tuple[Array, Array, Array], rng: np.random.Generator, size: tuple[int, int]
) -> tuple[Array, Array]:
    """Return the image (H, W, 3) before the lens, and J, the same without water and in even light."""
    shape = (size[1], size[0], 3)
    B, beta, gamma = water
    ground = 0.5 + spec.contrast * (rays.albedo - 0.5)
    ground = ground * (1 - spec.shading * (1 - rays.shade[..., None]))
    ground = np.where(rays.is_open[..., None], 0, ground * np.exp(spec.daylight_fall * rays.points[..., 2:]))
    J = ground.mean(axis=1).reshape(shape)
    t = rays.distance[..., None]
    if spec.caustics:
        places = rays.points[..., :2].reshape(-1, 2) + rng.uniform(0, 50, 2)
        lattice = rng.uniform(-1, 1, (256, 256))
        lines = np.exp(-3 * np.abs(octaves(lattice, places, 0.5, 2, 0.5))).reshape(*rays.is_open.shape, 1)
        ground = ground * (1 + spec.caustics * (lines - lines.mean()) / lines.std())
    veil = B
    if spec.veil_by_direction:
        aside = (rays.points + rays.pose[:3, :3].T @ rays.pose[:3, 3])[..., 0:1] / t
        veil = B * (1 + spec.veil_by_direction * np.where(rays.is_open[..., None], 0, aside))
    direct = spec.daylight * ground * np.exp(-beta * t)
    scattered = spec.daylight * veil * (1 - np.exp(-gamma * t))
    if spec.daylight_fall:  # the veil has the light of the middle of the ray
        centre = -rays.pose[:3, :3].T @ rays.pose[:3, 3]
        scattered = scattered * np.exp(spec.daylight_fall * 0.5 * (centre[2] + rays.points[..., 2:]).clip(-1, 20))
    if spec.strobe_deg:
        on_ground, light = _strobe(rays, spec, beta)
        direct = direct + 4 * ground * on_ground * np.exp(-beta * t)
        origin = -rays.pose[:3, :3].T @ rays.pose[:3, 3]
        middle = RAYS * RAYS // 2
        length = np.minimum(rays.distance[:, middle], FAR_M)[:, None, None]
        steps = (np.arange(24) + 0.5)[:, None] / 24
        along = length * steps**2  # finer where the strobe is bright
        weight = length * 2 * steps / 24
        toward = (rays.points[:, middle] - origin)[:, None] / rays.distance[:, middle, None, None]
        lit = light(origin + along * np.where(rays.is_open[:, middle, None, None], rays.pose[2, :3], toward))
        scattered = scattered + 4 * (B * gamma * np.exp(-gamma * along) * lit * weight).sum(axis=1)[:, None]
    image = direct.mean(axis=1).reshape(shape)
    if spec.blur_px_m:
        sigma = np.minimum(spec.blur_px_m * rays.distance[:, RAYS * RAYS // 2].reshape(shape[:2]), 7.99)
        stack = np.stack([gaussian_filter(image, (s, s, 0)) for s in range(9)])
        below = sigma.astype(int)
        v, u = np.indices(below.shape)
        image = stack[below, v, u] + (sigma - below)[..., None] * (stack[below + 1, v, u] - stack[below, v, u])
    return image + scattered.mean(axis=1).reshape(shape), J


def _with_fish(image: Array, depth: Array, water: tuple[Array, Array, Array], rng: np.random.Generator) -> Array:
    """Return the image with striped ellipses on 5 to 15 % of it, nearer than the ground."""
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
    return image


def _lens(size: tuple[int, int], vignette: float) -> Array:
    """Return the transmission (H, W, 1) of a lens: cos^4 of an angle, 1 - vignette in the farthest corner."""
    K, (width, height) = camera_of(size).K, size
    x, y = np.arange(width) + 0.5 - K[0, 2], (np.arange(height) + 0.5 - K[1, 2])[:, None]
    r2 = (x**2 + y**2) / (x**2 + y**2).max()
    return np.asarray(1 / (1 + ((1 - vignette) ** -0.5 - 1) * r2) ** 2)[..., None]


def _stored(image: Array, tone: str) -> Array:
    image = np.maximum(image, 0)
    if tone == "srgb":
        return np.where(image <= 0.0031308, 12.92 * image, 1.055 * np.maximum(image, 1e-9) ** (1 / 2.4) - 0.055)
    if tone == "s":
        inside = np.minimum(image, 1)
        return 0.5 * image + 0.5 * inside**2 * (3 - 2 * inside)
    return image ** float(tone) if tone else image


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
        decoded = cv2.imdecode(cv2.imencode(".jpg", levels[..., ::-1], how)[1], cv2.IMREAD_COLOR)
        levels = np.asarray(decoded)[..., ::-1]
    return levels.astype(np.float32) / np.float32(255)


def _gains(radiances: list[Array], spec: Condition, rng: np.random.Generator) -> Array:
    """Return the gains (V, 3) of the views' channels."""
    n = len(radiances)
    gains = np.exp(spec.exposure * rng.normal(size=(n, 1)) + spec.white_balance * rng.normal(size=(n, 3)))
    gains = gains * (1 + spec.swell * 2**0.5 * np.sin(np.arange(n) * 2.1 + rng.uniform(0, 6)))[:, None]
    if spec.auto_exposure:
        gains = gains * 0.4 / np.array([image.mean() for image in radiances])[:, None]
    elif spec.strobe_deg:
        gains = gains * 0.35 / np.mean(radiances)
    return np.asarray(gains * spec.gain)


def _disturbed(pose: Array, depth: Array, f: float, spec: Condition, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the pose and the depth map that a method is given."""
    if spec.pose_px:
        turn = cv2.Rodrigues(rng.normal(0, spec.pose_px / f, 3))[0]
        pose = pose.copy()
        pose[:3] = turn @ pose[:3]
        pose[:3, 3] += rng.normal(0, 0.5 * spec.pose_px / f * np.median(depth[depth > 0]), 3)
    if spec.depth_blur_px:
        known = gaussian_filter((depth > 0).astype(float), spec.depth_blur_px)
        depth = np.where(depth > 0, gaussian_filter(depth, spec.depth_blur_px) / np.maximum(known, 1e-6), 0)
    depth = depth * np.exp(spec.depth_jitter * rng.normal()) * (1 + spec.depth_noise * rng.normal(size=depth.shape))
    return pose, depth.astype(np.float32)


def _render(
    spec: Condition, water: str, geometry: str, size: tuple[int, int], seed: int, views: int
) -> dict[str, Array]:
    """Return rgb, depth and poses of all views, places of the targets, and their J and water, as arrays."""
    *cast, elsewhere = look(geometry, size, views, seed, spec.ripples_m)
    rng = np.random.default_rng([seed, *repr((spec, water, geometry)).encode()])
    B, beta, gamma = (np.array(values, float) for values in WATERS["air" if spec.air else water])
    camera = camera_of(size)
    images: list[Array] = []
    colours: list[Array] = []
    depths: list[Array] = []
    poses: list[Array] = []
    for place, rays in enumerate(cast):
        change = np.exp(spec.patchy * rng.normal(size=3))
        here = (B, beta * change, gamma * change)
        middle = RAYS * RAYS // 2
        ahead = rays.points[:, middle] @ rays.pose[2, :3] + rays.pose[2, 3]
        depth = np.where(rays.is_open[:, middle], 0, ahead).reshape(size[::-1])
        is_wrong = place == 5
        seen = elsewhere if spec.wrong == "place" and is_wrong else rays
        image, J = radiance(seen, spec, here, rng, size)
        if place in spec.fish:
            image = _with_fish(image, depth, here, rng)
        if spec.snow:
            bright = np.where(rng.random(depth.shape) < spec.snow, rng.uniform(0.4, 0.9, depth.shape), 0)
            image = np.maximum(image, bright[..., None])
        image = image * _lens(size, spec.vignette)
        images.append(image[:, ::-1] if spec.wrong == "mirrored" and is_wrong else image)
        colours.append(J)
        depths.append(depths[0] if spec.wrong == "depth" and is_wrong else depth)
        poses.append(rays.pose)
    gains = _gains(images, spec, rng)
    rgb = [_file(_stored(image * gain, spec.tone), spec, rng) for image, gain in zip(images, gains, strict=True)]
    given = [_disturbed(*both, camera.K[0, 0], spec, rng) for both in zip(poses, depths, strict=True)]
    targets = sorted({views // 6, 2 * views // 3})
    waters = np.stack([[B * gain, beta, gamma] for gain in gains[targets]])
    if spec.tone:
        waters[:] = np.nan
    if spec.strobe_deg:
        waters[:, [0, 2]] = np.nan  # the veil of a strobe has another form
    return {
        "rgb": np.stack(rgb),
        "depth": np.stack([depth for _, depth in given]),
        "pose": np.stack([pose for pose, _ in given]),
        "target": np.array(targets),
        "J": np.stack([_stored(colours[k] * gains[k], spec.tone) for k in targets]),
        "water": waters,
    }


def make(
    condition: str | Condition,
    water: str = "coastal",
    geometry: str = "approach",
    size: tuple[int, int] = (192, 144),
    seed: int = 0,
    views: int = VIEWS,
    cache: Path | None = None,
) -> Made:
    """Return a made scene with its truth; cache: a folder in which scenes are stored for the next call."""
    spec = CONDITIONS[condition] if isinstance(condition, str) else condition
    views = 1 if geometry == "one_view" else views
    code = b"".join(path.read_bytes() for path in sorted(Path(__file__).parent.glob("nature_s*.py")))
    key = sha256(repr((astuple(spec), WATERS[water], geometry, size, seed, views)).encode() + code).hexdigest()[:16]
    stored = cache / f"{key}.npz" if cache else None
    if stored and stored.exists():
        with np.load(stored) as file:
            arrays = dict(file)
    else:
        arrays = _render(spec, water, geometry, size, seed, views)
        if stored:
            stored.parent.mkdir(parents=True, exist_ok=True)
            np.savez(stored, **arrays)  # type: ignore[arg-type]
    suffix = "jpg" if spec.jpeg else "png"
    camera, planes = camera_of(size), zip(arrays["rgb"], arrays["depth"], arrays["pose"], strict=True)
    made = [
        sb.View(f"{k:02}.{suffix}", sb.Arrays(rgb, depth), camera, pose) for k, (rgb, depth, pose) in enumerate(planes)
    ]
    truth = {
        made[k].name: (sb.Water(*water_of), J)
        for k, water_of, J in zip(arrays["target"], arrays["water"], arrays["J"], strict=True)
    }
    return Made(sb.Scene(f"{condition} {water} {geometry}", made, frozenset({"depth", "poses"}), data_id=key), truth)
