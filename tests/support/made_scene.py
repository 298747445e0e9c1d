"""A scene that can be computed by hand: a slanted plane and a box before it, ray-cast in float64, in known water."""

import numpy as np

from sucre_bench import Arrays, Camera, InputError, Scene, View, Water
from sucre_bench.arrays import Array
from sucre_bench.imaging.chart_kinds import ChartKind
from sucre_bench.scene import Encoding, Pixels
from support.forward_model import CLEAR, in_water, photographed

# The plane n . X = 1 (about 3 m away) and the box's least and greatest corner, in metres, seen along +z.
PLANE = np.array([0.06, -0.04, 0.33])
BOX = np.array([[-0.5, -0.4, 1.9], [0.2, 0.3, 2.3]])
WATER = CLEAR


class Watched:
    """Pixels that tell which planes were loaded, one entry a load; a fault is that of the image."""

    def __init__(self, pixels: Pixels, fault: str = "") -> None:
        self.pixels, self.fault = pixels, fault
        self.loaded: list[str] = []

    def load(self, plane: str) -> Array | None:
        self.loaded.append(plane)
        if plane == "rgb" and self.fault:
            raise InputError(self.fault)
        return self.pixels.load(plane)


def make_camera(width: int, height: int, focal: float) -> Camera:
    """A camera whose principal point is a little off the middle."""
    return Camera(
        np.array(
            [[focal, 0, width / 2 + 0.7], [0, focal * 1.02, height / 2 - 0.4], [0, 0, 1.0]]
        ),
        width,
        height,
    )


def make_pose(
    position: tuple[float, float, float],
    yaw: float = 0.0,
    pitch: float = 0.0,
    roll: float = 0.0,
) -> np.ndarray:
    """cam_from_world of a camera at a position in metres, turned by angles in radians."""
    (cy, sy), (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in (yaw, pitch, roll))
    turns = (
        np.array([[cr, -sr, 0], [sr, cr, 0], [0, 0, 1]]),
        np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]]),
        np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]]),
    )
    pose = np.eye(4)
    pose[:3, :3] = turns[0] @ turns[1] @ turns[2]
    pose[:3, 3] = -pose[:3, :3] @ np.array(position)
    return pose


def hit(origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """How far along rays (..., 3) the first surface is, in lengths of the ray; 0 where there is none."""
    with np.errstate(divide="ignore", invalid="ignore"):
        plane = (1 - PLANE @ origin) / (rays @ PLANE)
        faces = (BOX[:, *(None,) * (rays.ndim - 1)] - origin) / rays
        enter, leave = faces.min(axis=0).max(axis=-1), faces.max(axis=0).min(axis=-1)
    hits = np.stack(
        [
            np.where(plane > 1e-9, plane, np.inf),
            np.where((enter < leave) & (enter > 0), enter, np.inf),
        ]
    )
    nearest = hits.min(axis=0)
    return np.where(np.isfinite(nearest), nearest, 0)


def make_view(
    name: str,
    camera: Camera,
    pose: np.ndarray,
    water: Water | None = WATER,
    blind: tuple[slice, slice] | None = None,
) -> View:
    """The scene as the camera sees it, 8 bit; blind: a part of the image whose depth is unknown."""
    u, v = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.K).T
    world_from_cam = np.linalg.inv(pose)
    depth = hit(world_from_cam[:3, 3], rays @ world_from_cam[:3, :3].T)
    points = (rays * depth[..., None]) @ world_from_cam[:3, :3].T + world_from_cam[:3, 3]
    rgb = texture(points)
    if water is not None:
        z = np.linalg.norm(rays * depth[..., None], axis=-1)
        rgb = in_water(rgb, z, water)
    if blind is not None:
        depth[blind] = 0
    return View(name, Arrays(photographed(rgb), depth), camera, pose)


def texture(points: np.ndarray) -> np.ndarray:
    """The colour (..., 3), in [0.1, 0.9], of points of the world; smooth over a few centimetres."""
    waves = points @ np.array([[5.0, 2.0, 3.0], [-3.0, 6.0, 2.0], [2.0, 1.0, -4.0]])
    return 0.5 + 0.4 * np.sin(waves + np.array([0.0, 1.0, 2.0]))


def make_scene() -> Scene:
    """Four views of different size, focal length and distance; the target "a.png" has pixels without depth."""
    views = [
        make_view(
            "near.png", make_camera(52, 40, 44), make_pose((0.1, 0.05, 0.6), 0.06, -0.05)
        ),
        make_view(
            "a.png",
            make_camera(60, 44, 56),
            make_pose((0, 0, 0)),
            blind=(slice(0, 6), slice(20, 60)),
        ),
        make_view(
            "side.png", make_camera(64, 48, 60), make_pose((0.5, -0.2, -0.1), -0.12, 0.07, 0.1)
        ),
        make_view("far.png", make_camera(56, 50, 90), make_pose((-0.3, 0.1, -2.4), 0.04, 0.02)),
    ]
    return Scene("made", views, frozenset({"depth", "poses", "truth"}), WATER)


NINE = (0.1, 0.2, 0.3, 0.4, 0.2, 0.1, 0.3, 0.2, 0.15)


def of(
    rgb: Array,
    depth: Array | None = None,
    reference: Array | None = None,
    encoding: Encoding = "gamma",
    camera: Camera | None = None,
) -> Scene:
    """A scene of one view "a.png"."""
    planes = {"depth": depth, "reference": reference, "poses": camera}
    view = View(
        "a.png",
        Arrays(rgb, depth, reference),
        camera,
        None if camera is None else np.eye(4),
        (),
        encoding,
    )
    has = frozenset(name for name, value in planes.items() if value is not None)
    return Scene("one", [view], has, data_id="one")


def photo(height: int = 60, width: int = 80) -> Array:
    """A smooth picture of known 8-bit values."""
    v, u = np.mgrid[:height, :width]
    waves = [0.5 + 0.4 * np.sin(u / 7 + v / 11 + c) for c in range(3)]
    return np.asarray(np.rint(np.stack(waves, axis=-1) * 255) / 255, dtype=np.float32)


def many(count: int = 9) -> Scene:
    """Views v0.png, v1.png, ... in that order, 1 m apart."""
    camera = Camera(np.diag([50.0, 50, 1]), 20, 16)
    views = [
        View(
            f"v{n}.png",
            Arrays(photo(16, 20), np.full((16, 20), 2.0)),
            camera,
            make_pose((n, 0, 0), 0.1 * n),
        )
        for n in range(count)
    ]
    return Scene("many", views, frozenset({"depth", "poses"}), data_id="many")


TILTED = np.array([[61.0, 40.0], [352.0, 22.0], [377.0, 268.0], [33.0, 241.0]])


def painted(
    kind: ChartKind, corners: Array, size: tuple[int, int] = (300, 420), share: float = 1.0
) -> Array:
    """A white image with every patch in its sRGB colour, on the middle `share` of its box (in x and y)."""
    import cv2

    image = np.ones((*size, 3), np.float32)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    homography = cv2.getPerspectiveTransform(np.asarray(corners, np.float32), unit)
    v, u = np.mgrid[: size[0], : size[1]] + 0.5
    x, y = cv2.perspectiveTransform(np.stack([u, v], -1).reshape(1, -1, 2), homography)[
        0
    ].T.reshape(2, *size)
    for patch in kind.patches:
        x0, y0, x1, y1 = patch.box
        inside = np.abs(x - (x0 + x1) / 2) <= share * (x1 - x0) / 2
        inside &= np.abs(y - (y0 + y1) / 2) <= share * (y1 - y0) / 2
        image[inside] = patch.srgb
    return image
