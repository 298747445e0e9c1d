"""The whole made scene in memory, with its truth: colours, depth, poses, water."""

import dataclasses
import functools
from dataclasses import dataclass

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, pixel_rays
from sucre_bench.datasets.demo.camera_path import make_camera, make_path
from sucre_bench.datasets.demo.chart_boards import SITES, place_board
from sucre_bench.datasets.demo.noise import Grid, Noise
from sucre_bench.datasets.demo.render import Surfaces, build, render, visible_charts
from sucre_bench.datasets.demo.seabed import paint_seabed
from sucre_bench.datasets.demo.terrain import GROUND, Terrain, make_terrain
from sucre_bench.datasets.demo.water import WATERS, Preset, underwater
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.machine.progress import track
from sucre_bench.scene import Chart, Water

# Texels are as large as a pixel at 2 m, where the cameras come near; elsewhere coarser, on the boards finer, so that
# patches have straight edges.
_NEAR_M = 2.0
_NEAR = (-3.5, -2.3, 7.0, 5.5)  # x0, y0, width, length, metres
_COARSER, _FINER = 2.5, 0.4


@dataclass(frozen=True, eq=False)
class MadeScene:
    """V views of a made seabed, far to near.

    names: V image names; camera: of all views; cam_from_world: (V, 4, 4) float64; rgb: (V, H, W, 3) uint8, what the
    camera recorded; reference: (V, H, W, 3) float32 in [0, 1], gamma-encoded, the same without water; depth: (V, H, W)
    float32 metres, planar; charts: those each view shows; preset, water: the water's name and the true water
    (see `Demo` for "deep_sea").
    """

    names: tuple[str, ...]
    camera: Camera
    cam_from_world: Array
    rgb: np.ndarray
    reference: Array
    depth: Array
    charts: tuple[tuple[Chart, ...], ...]
    preset: Preset
    water: Water


def make(
    views: int = 16, width: int = 640, height: int = 480, seed: int = 0, water: Preset = "coastal", noise: float = 0.004
) -> MadeScene:
    """Make a scene; equal arguments give equal scenes. noise: standard deviation of the sensor's, of full scale.

    InputError where Open3D, which casts the rays, does not load.
    """
    camera = make_camera(width, height)
    poses = make_path(views, seed)
    texel = float(_NEAR_M / camera.K[0, 0])
    surfaces = _make_surfaces(seed, texel)

    rays = pixel_rays(camera)
    shape = (views, height, width)
    rgb = np.empty((*shape, 3), dtype=np.uint8)
    reference, depth = np.empty((*shape, 3), dtype=np.float32), np.empty(shape, dtype=np.float32)
    for i in track(range(views), "making the demo scene"):
        reference[i], depth[i] = render(surfaces, camera, poses[i])
        grain = np.random.default_rng([seed, 41, i]).normal(0, noise, rgb[i].shape)
        rgb[i] = to_8bit(underwater(reference[i], rays, depth[i], water) + grain)
    return MadeScene(
        names=tuple(f"view_{i:03d}.png" for i in range(views)),
        camera=camera,
        cam_from_world=poses,
        rgb=rgb,
        reference=reference,
        depth=depth,
        charts=tuple(visible_charts(surfaces, camera, pose) for pose in poses),
        preset=water,
        water=WATERS[water],
    )


def _make_surfaces(seed: int, texel: float) -> Surfaces:
    noise, terrain = Noise(seed), _terrain(seed)
    grids = Grid(*_NEAR, cell=texel), dataclasses.replace(GROUND, cell=_COARSER * texel)
    near, far = (paint_seabed(terrain, noise, grid) for grid in grids)
    return build(terrain, near, far, [place_board(site, terrain, _FINER * texel) for site in SITES])


@functools.lru_cache(maxsize=1)  # a third of a small scene's time, the same in every water
def _terrain(seed: int) -> Terrain:
    return make_terrain(seed, Noise(seed), [(site.x, site.y) for site in SITES])
