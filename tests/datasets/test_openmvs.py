"""The openmvs dataset against depth maps packed here byte by byte, as OpenMVS's documentation has them."""

import struct
from pathlib import Path

import numpy as np
import pytest
from support.miniatures import (
    BOTH,
    HEIGHT,
    WIDTH,
    Change,
    check_both,
    check_view_fault,
    disk_depth,
    pose_of,
    scene_fault_test,
    seen,
    write_spot,
)

from sucre_bench.datasets.openmvs import Openmvs
from sucre_bench.errors import InputError
from sucre_bench.scene import Scene

# pixel centres at whole numbers, as OpenMVS has them
K = np.array([[210.0, 0, 77.25], [0, 190.0, 61.5], [0, 0, 1]])
METRES = 0.4  # in a unit of the reconstruction


def dmap(
    image: str,
    K: np.ndarray,
    pose: np.ndarray,
    depth: np.ndarray,
    magic: bytes = b"DR",
    views: int = 3,
) -> bytes:
    """Pack a depth map; `pose` is world-from-camera."""
    height, width = depth.shape
    exponent = 3 if magic == b"D2" else 0
    head = magic + struct.pack("<Bb4I2f", 15, exponent, WIDTH, HEIGHT, width, height, 0.5, 20.0)
    if magic == b"D2":
        head += struct.pack("<f", 1.0)
    head += (
        struct.pack("<H", len(image.encode()))
        + image.encode()
        + struct.pack(f"<I{views}I", views, *range(views))
    )
    head += struct.pack("<21d", *K.ravel(), *pose[:3, :3].T.ravel(), *pose[:3, 3])
    stored = (depth / 2**exponent).astype("<f2") if magic == b"D2" else depth.astype("<f4")
    # normals and confidence, which are not ours to read
    return head + stored.tobytes() + bytes(16 * depth.size)


def write_scene(
    root: Path, magic: bytes = b"DR", step: int = 1, name: str = "images/{}.jpg"
) -> Path:
    """Two images with a spot, in units of the reconstruction: lengths are divided by METRES."""
    for number, (where, turn) in enumerate(BOTH):
        pose = pose_of(where, turn)
        at = (K @ seen(pose))[:2] / seen(pose)[2]
        write_spot(root / f"images/{number}.png", at + 0.5)
        coarse = disk_depth(
            (at + 0.5) / step, seen(pose)[2] / METRES, (WIDTH // step, HEIGHT // step)
        )
        pose[:3, 3] /= METRES
        content = dmap(name.format(number), K, pose, coarse, magic)
        (root / f"depth{number:04}.dmap").write_bytes(content)
    return root


def load(root: Path, **options: object) -> Scene:
    (scene,) = Openmvs(root=root, **{"metres_per_unit": METRES, **options}).scenes()
    return scene


@pytest.mark.parametrize("magic", [b"DR", b"D2"], ids=["floats", "halves"])
@pytest.mark.parametrize("step", [1, 2])
def test_a_known_point_is_seen_where_it_is_in_both_views(
    tmp_path: Path, magic: bytes, step: int
) -> None:
    scene = load(write_scene(tmp_path, magic, step))
    assert [view.name for view in scene] == ["images/0.png", "images/1.png"]
    assert scene.has == {"poses", "depth"}
    check_both(*scene)


def test_data_id_changes_with_the_scale_and_with_a_depth(tmp_path: Path) -> None:
    write_scene(tmp_path)
    ids = {load(tmp_path).data_id, load(tmp_path, metres_per_unit=1.0).data_id}
    path = tmp_path / "depth0000.dmap"
    path.write_bytes(path.read_bytes()[:-4] + b"\1\1\1\1")
    assert len(ids | {load(tmp_path).data_id}) == 3


def other_bytes(offset: int, layout: str, *values: object) -> Change:
    def change(root: Path) -> None:
        content = bytearray((root / "depth0000.dmap").read_bytes())
        struct.pack_into("<" + layout, content, offset, *values)
        (root / "depth0000.dmap").write_bytes(content)

    return change


# The name is 12 bytes from 30 on, the ids are from 42, K is from 58, R from 130 to 202.
SCENE: dict[str, tuple[Change, list[str]]] = {
    "another format": (
        other_bytes(0, "2s", b"DX"),
        ["depth0000.dmap: cannot be read", "Densify"],
    ),
    "no depth in it": (other_bytes(2, "B", 2), ["depth0000.dmap", "flags 2"]),
    "a huge depth map": (
        other_bytes(4, "4I", *[2**31] * 4),
        ["depth0000.dmap: cannot be read", "Densify"],
    ),
    "many views": (other_bytes(42, "I", 2**32 - 1), ["depth0000.dmap", "4294967295 views"]),
    "no focal length": (other_bytes(58, "d", 0.0), ["depth0000.dmap", "K is no"]),
    "no rotation": (other_bytes(130, "d", 7.0), ["depth0000.dmap", "no pose"]),
    "two of one image": (
        lambda root: (root / "x.dmap").write_bytes((root / "depth0000.dmap").read_bytes()),
        ["x.dmap: ", "images/0.png", "depth0000.dmap"],
    ),
    "no images": (
        lambda root: [path.unlink() for path in root.glob("images/*")],
        ["0.jpg", "depth0000.dmap"],
    ),
}


test_a_fault_of_the_scene_is_one_line_about_the_file = scene_fault_test(
    write_scene, load, SCENE
)


@pytest.mark.parametrize(
    "name", ["{}/out/0.png", "../out/0.png", "images/../../out/0.png", "C:/out/0.png", "..", ""]
)
def test_nothing_outside_of_root_is_named_or_opened(tmp_path: Path, name: str) -> None:
    """A view's name becomes the path of its results."""
    root = write_scene(tmp_path / "root")
    write_spot(tmp_path / "out/0.png", np.ones(2), (60, 60))
    (root / "images/0.png").unlink()
    depth = np.ones((HEIGHT, WIDTH), np.float32)
    (root / "depth0000.dmap").write_bytes(
        dmap(name.format(tmp_path), K, pose_of(*BOTH[0]), depth)
    )
    before = load(root)
    write_spot(tmp_path / "out/0.png", np.ones(2), (WIDTH, HEIGHT))
    assert load(root).data_id == before.data_id
    (bad,) = (view for view in before if view.name != "images/1.png")
    assert bad.name
    assert not {"..", "", "/", "C:"} & set(Path(bad.name).parts)
    check_view_fault(bad, before["images/1.png"], "rgb", root, ["depth0000.dmap"])


def test_a_pattern_of_depth_maps_outside_of_root_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"openmvs\.dmaps"):
        load(tmp_path, dmaps="../*.dmap")
