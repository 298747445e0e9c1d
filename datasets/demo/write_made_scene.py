"""Writes the made scene as files, in the layout that SUCRe reads and `prepare` writes.

`images/`, `reference/` (8-bit PNG), `depths/depth_<stem>.png` (16-bit, millimetres along the optical axis), `sparse/`
(a COLMAP text model with the cameras and poses, without points), `charts.json` (corners in pixels), `water.json`.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.datasets.demo.made_scene import MadeScene
from sucre_bench.datasets.demo.water import LAMP
from sucre_bench.imaging.encoding import to_8bit
from sucre_bench.imaging.image_files import write_png
from sucre_bench.machine.progress import track
from sucre_bench.scene import Chart

LAST = "water.json"  # written after all else: a folder without it is not finished


def write_made_scene(made: MadeScene, folder: Path) -> None:
    """Write a made scene into a new folder."""
    for kind in ("images", "reference", "depths", "sparse"):
        (folder / kind).mkdir(parents=True)
    for i, name in enumerate(track(made.names, "writing the demo scene")):
        write_png(folder / "images" / name, made.rgb[i][..., ::-1])
        write_png(folder / "reference" / name, to_8bit(made.reference[i])[..., ::-1])
        write_png(folder / "depths" / f"depth_{name}", (made.depth[i] * 1000 + 0.5).astype(np.uint16))
    _write_model(made, folder / "sparse")
    _write_json(folder / "charts.json", {"images": dict(zip(made.names, map(_charts, made.charts), strict=True))})
    _write_json(folder / LAST, _water(made))


def _write_json(path: Path, content: Any) -> None:
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def _charts(charts: Sequence[Chart]) -> dict[str, Any]:
    return {chart.name: {"kind": chart.kind, "corners": chart.corners.round(3).tolist()} for chart in charts}


def _water(made: MadeScene) -> dict[str, Any]:
    content: dict[str, Any] = {
        "preset": made.preset,
        "veiling_light": made.water.veiling_light.tolist(),
        "attenuation": made.water.attenuation.tolist(),
        "backscatter": made.water.backscatter.tolist(),
    }
    if made.preset == "deep_sea":
        content["lamp_from_cam"], content["lamp_covariance"] = LAMP.lamp_from_cam.tolist(), LAMP.covariance.tolist()
    return content


def _write_model(made: MadeScene, folder: Path) -> None:
    """Write COLMAP's text model: its pixel and axis conventions are those of `sucre_bench.scene`."""
    K, size = made.camera.K, f"{made.camera.width} {made.camera.height}"
    line = f"1 PINHOLE {size} {K[0, 0]} {K[1, 1]} {K[0, 2]} {K[1, 2]}\n"
    (folder / "cameras.txt").write_text("# CAMERA_ID MODEL WIDTH HEIGHT FX FY CX CY\n" + line, encoding="utf-8")
    lines = ["# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then a line of 2D points (none)\n"]
    for i, (name, pose) in enumerate(zip(made.names, made.cam_from_world, strict=True)):
        numbers = " ".join(repr(float(x)) for x in (*_quaternion(pose), *pose[:3, 3]))
        lines.append(f"{i + 1} {numbers} 1 {name}\n\n")
    (folder / "images.txt").write_text("".join(lines), encoding="utf-8")
    (folder / "points3D.txt").write_text("# POINT3D_ID X Y Z R G B ERROR TRACK[]: none\n", encoding="utf-8")


def _quaternion(pose: Array) -> Array:
    """Return the rotation of a (4, 4) transform as (w, x, y, z)."""
    from scipy.spatial.transform import Rotation

    return np.roll(Rotation.from_matrix(pose[:3, :3]).as_quat(), 1)
