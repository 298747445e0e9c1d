"""Writes coloured surfaces: PLY (points or triangles) and binary glTF 2.0, .glb (triangles).

Vertex colours of glTF are linear light, so they are decoded from sRGB and stored with 16 bits. The material is unlit
(KHR_materials_unlit): a viewer's lamps would change the colours. In glTF y is up, so a node rotates the cameras' mean
upward direction to y. PLY has the scene's coordinates.
"""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.machine.files import write_atomically
from sucre_bench.programs.texture.surface import Model
from sucre_bench.scene import View

_FLOAT, _UINT16, _UINT32 = 5126, 5123, 5125  # glTF's names of types
_VERTICES, _INDICES = 34962, 34963  # and of what buffers hold


def write_model(path: Path, model: Model, up: Array) -> None:
    """Write a surface as .ply or .glb. up: (3,) the scene's upward direction. Raises OutputError if that fails."""
    content = _glb(model, up) if path.suffix.lower() == ".glb" else _ply(model)
    write_atomically(path, content)


def mean_up(views: Sequence[View]) -> Array:
    """Return the mean upward direction (3,) of views' cameras, a unit vector; -y of the world if they cancel out."""
    poses = [view.cam_from_world for view in views if view.cam_from_world is not None]
    total = -np.sum([pose[1, :3] for pose in poses], axis=0) if poses else np.zeros(3)
    length = float(np.linalg.norm(total))
    return np.asarray(total / length) if length > 1e-3 * len(poses) > 0 else np.array([0.0, -1.0, 0.0])


def _ply(model: Model) -> bytes:
    vertices = np.empty(len(model.points), [("xyz", "<f4", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = model.points, model.colours
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in "xyz"]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    faces = np.empty(len(model.triangles), [("count", "u1"), ("corners", "<i4", 3)])
    if len(faces):
        faces["count"], faces["corners"] = 3, model.triangles
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    return "\n".join([*header, "end_header\n"]).encode() + vertices.tobytes() + faces.tobytes()


def _glb(model: Model, up: Array) -> bytes:
    levels = (srgb_decode(np.arange(256) / 255) * 65535 + 0.5).astype("<u2")
    colours = np.full((len(model.points), 4), 65535, "<u2")  # with alpha: each vertex is to begin at a multiple of four
    colours[:, :3] = levels[model.colours]
    parts = (model.points.astype("<f4"), colours, model.triangles.astype("<u4"))
    sizes = [part.nbytes for part in parts]
    starts = np.cumsum([0, *sizes]).tolist()
    kinds = ((_FLOAT, "VEC3", _VERTICES), (_UINT16, "VEC4", _VERTICES), (_UINT32, "SCALAR", _INDICES))
    counts = (len(model.points), len(model.points), model.triangles.size)
    accessors = [
        {"bufferView": k, "componentType": kind, "type": of, "count": n}
        for k, ((kind, of, _), n) in enumerate(zip(kinds, counts, strict=True))
    ]
    low, high = (bound(model.points, axis=0).tolist() for bound in (np.min, np.max))
    accessors[0] |= {"min": low, "max": high}
    accessors[1] |= {"normalized": True}
    told = {
        "asset": {"version": "2.0", "generator": "sucre_bench"},
        "extensionsUsed": ["KHR_materials_unlit"],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "rotation": _turn_to_y(up)}],
        "meshes": [
            {"primitives": [{"attributes": {"POSITION": 0, "COLOR_0": 1}, "indices": 2, "material": 0, "mode": 4}]}
        ],
        "materials": [{"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": size, "target": target}
            for start, size, (_, _, target) in zip(starts, sizes, kinds, strict=False)
        ],
        "buffers": [{"byteLength": starts[-1]}],
    }
    text = json.dumps(told).encode()
    text += b" " * (-len(text) % 4)
    total = 12 + 8 + len(text) + 8 + starts[-1]
    head = b"glTF" + np.array([2, total, len(text)], "<u4").tobytes() + b"JSON"
    return b"".join([head, text, np.uint32(starts[-1]).tobytes(), b"BIN\0", *(part.tobytes() for part in parts)])


def _turn_to_y(up: Array) -> list[float]:
    """The rotation, as quaternion (x, y, z, w), that brings a unit vector to y by the shortest way."""
    from scipy.spatial.transform import Rotation

    y = np.array([0.0, 1.0, 0.0])
    axis = np.cross(up, y)
    angle = np.arctan2(np.linalg.norm(axis), up @ y)
    axis = axis / np.linalg.norm(axis) if np.linalg.norm(axis) > 1e-9 else np.array([1.0, 0.0, 0.0])
    return [float(q) for q in Rotation.from_rotvec(axis * angle).as_quat()]
