"""The whole made scene in memory, with its truth: colours, depth, poses, water; and how it is stored as files."""

import dataclasses
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench import Chart, Water, track
from sucre_bench.arrays import Array
from sucre_bench.camera import Camera, pixel_rays
from sucre_bench.datasets.demo import LAST, Preset, render, seabed, water_of
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import write_png
from sucre_bench.machine.cache import get_or_make

# Texels are as large as a pixel at 2 m, where the cameras come near; elsewhere coarser, on the boards finer, so that
# patches have straight edges.
_NEAR_M = 2.0
_NEAR = (-3.5, -2.3, 7.0, 5.5)  # x0, y0, width, length, metres
_COARSER = 2.5
_FINER = 0.4


@dataclass(frozen=True, eq=False)
class MadeScene:
    """V views of a made seabed, far to near."""

    names: tuple[str, ...]
    """V image names."""

    camera: Camera
    """Of all views."""

    cam_from_world: Array
    """Shape (V, 4, 4), float64."""

    rgb: np.ndarray
    """What the camera recorded, (V, H, W, 3) uint8."""

    reference: Array
    """The views without water, (V, H, W, 3) float32 in [0, 1], gamma-encoded."""

    depth: Array
    """In metres, planar, (V, H, W) float32."""

    charts: tuple[tuple[Chart, ...], ...]
    """Those each view shows."""

    # The water's name and the true water (see `Demo` for "deep_sea").
    preset: Preset
    water: Water


def make(
    views: int = 16,
    width: int = 640,
    height: int = 480,
    seed: int = 0,
    water: Preset = "coastal",
    noise: float = 0.004,
) -> MadeScene:
    """Make a scene; equal arguments give equal scenes. noise: standard deviation of the sensor's, of full scale."""
    camera, poses = render.make_camera(width, height), render.make_path(views, seed)
    texel = float(_NEAR_M / camera.K[0, 0])
    noise_field, terrain = seabed.Noise(seed), _terrain(seed)
    grids = (
        seabed.Grid(*_NEAR, cell=texel),
        dataclasses.replace(seabed.GROUND, cell=_COARSER * texel),
    )
    near, far = (seabed.paint_seabed(terrain, noise_field, grid) for grid in grids)
    boards = [seabed.place_board(site, terrain, _FINER * texel) for site in seabed.SITES]
    surfaces, rays = render.build(terrain, near, far, boards), pixel_rays(camera)
    shape = (views, height, width)
    rgb = np.empty((*shape, 3), dtype=np.uint8)
    reference, depth = (
        np.empty((*shape, 3), dtype=np.float32),
        np.empty(shape, dtype=np.float32),
    )
    for i in track(range(views), "making the demo scene"):
        reference[i], depth[i] = render.render(surfaces, camera, poses[i])
        grain = np.random.default_rng([seed, 41, i]).normal(0, noise, rgb[i].shape)
        rgb[i] = to_8bit(render.underwater(reference[i], rays, depth[i], water) + grain)
    return MadeScene(
        names=tuple(f"view_{i:03d}.png" for i in range(views)),
        camera=camera,
        cam_from_world=poses,
        rgb=rgb,
        reference=reference,
        depth=depth,
        charts=tuple(render.visible_charts(surfaces, camera, pose) for pose in poses),
        preset=water,
        water=water_of(water),
    )


@functools.lru_cache(maxsize=1)  # a third of a small scene's time, the same in every water
def _terrain(seed: int) -> seabed.Terrain:
    return seabed.make_terrain(
        seed, seabed.Noise(seed), [(site.x, site.y) for site in seabed.SITES]
    )


# Writes the made scene as files, in the layout that SUCRe reads and `prepare` writes.
#
# `images/`, `reference/` (8-bit PNG), `depths/depth_<stem>.png` (16-bit, millimetres along the optical axis),
# `sparse/` (a COLMAP text model with the cameras and poses, without points), `charts.json` (corners in pixels),
# `water.json`.


def write_made_scene(made: MadeScene, folder: Path) -> None:
    """Write a made scene into a new folder."""
    from scipy.spatial.transform import Rotation

    for kind in ("images", "reference", "depths", "sparse"):
        (folder / kind).mkdir(parents=True)
    for i, name in enumerate(track(made.names, "writing the demo scene")):
        write_png(folder / "images" / name, made.rgb[i][..., ::-1])
        write_png(folder / "reference" / name, to_8bit(made.reference[i])[..., ::-1])
        write_png(
            folder / "depths" / f"depth_{name}", (made.depth[i] * 1000 + 0.5).astype(np.uint16)
        )
    # COLMAP's text model: its pixel and axis conventions are those of `sucre_bench.scene`.
    K = made.camera.K
    size = f"{made.camera.width} {made.camera.height}"
    images = "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of 2D points (none)\n"
    for i, (name, pose) in enumerate(zip(made.names, made.cam_from_world, strict=True), 1):
        quaternion = np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)  # w first
        numbers = " ".join(repr(float(x)) for x in (*quaternion, *pose[:3, 3]))
        images += f"{i} {numbers} 1 {name}\n\n"
    charts = {
        name: {
            chart.name: {"kind": chart.kind, "corners": chart.corners.round(3).tolist()}
            for chart in of_view
        }
        for name, of_view in zip(made.names, made.charts, strict=True)
    }
    water: dict[str, Any] = {"preset": made.preset}
    for parameter in ("veiling_light", "attenuation", "backscatter"):
        water[parameter] = getattr(made.water, parameter).tolist()
    if made.preset == "deep_sea":
        water["lamp_from_cam"] = render.LAMP.lamp_from_cam.tolist()
        water["lamp_covariance"] = render.LAMP.covariance.tolist()
    texts = {
        "sparse/cameras.txt": f"# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n"
        f"1 PINHOLE {size} {K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n",
        "sparse/images.txt": images,
        "sparse/points3D.txt": "# POINT3D_ID X Y Z R G B ERROR TRACK[]: none\n",
        "charts.json": json.dumps({"images": charts}, indent=1) + "\n",
        LAST: json.dumps(water, indent=1) + "\n",
    }
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")


# Where the made scene is stored, and when it is made again: once for each combination of options.


def make_once(folder: Path, make: Callable[[], MadeScene]) -> Path:
    """Return the folder of a made scene, making it where it is not there or not finished; others who want it wait.

    The scene is written beside its place, and moved there when it is complete. So a killed process leaves no half
    scene.
    """

    def write(work: Path) -> Path:
        write_made_scene(make(), work)
        return folder

    lock = folder.with_name(f".{folder.name}.lock")
    return get_or_make(
        folder, lambda place: place if (place / LAST).is_file() else None, write, lock
    )
