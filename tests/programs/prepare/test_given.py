"""Poses, meshes and depth maps of other programs: a made valley, photographed by a distorting camera, is the truth."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from support.photographed_valley import (
    CAMERA,
    DISTORTION,
    HEIGHT,
    PLANES,
    POSES,
    WIDTH,
    make_shots,
    photograph,
    true_depth,
    write,
)

import sucre_bench as sb
from sucre_bench.arrays import Array
from sucre_bench.camera import depth_at, pixel_rays
from sucre_bench.commands.prepare import prepare as command
from sucre_bench.errors import InputError
from sucre_bench.loading.lens import Lens
from sucre_bench.programs.prepare import Options
from sucre_bench.programs.prepare.given import mesh_maps
from sucre_bench.programs.prepare.pipeline import prepare

USED = POSES[:4]


def write_mesh(path: Path, points: Array) -> None:
    """Write the mesh of a grid of points (n, n, 3)."""
    import open3d as o3d

    n = len(points)
    corner = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).reshape(-1, 1)
    faces = o3d.utility.Vector3iVector(
        np.concatenate([corner + np.array(three) for three in ((0, 1, n), (1, n + 1, n))])
    )
    mesh = o3d.geometry.TriangleMesh(o3d.utility.Vector3dVector(points.reshape(-1, 3)), faces)
    o3d.io.write_triangle_mesh(str(path), mesh)


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four photos, their true cameras for nerfstudio and COLMAP, and a mesh of the valley; .glb has y up."""
    from scipy.spatial.transform import Rotation

    root = tmp_path_factory.mktemp("given")
    flip = np.diag([1.0, -1, -1, 1])
    frames = []
    for i, pose in enumerate(USED):
        name, matrix = f"photos/{i}.png", np.linalg.inv(pose) @ flip
        write(root / name, photograph(pose))
        frames.append({"file_path": name, "transform_matrix": matrix.tolist()})
    (fx, _, cx), (_, fy, cy) = CAMERA.K[:2].tolist()
    camera = {"fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy, "w": WIDTH, "h": HEIGHT}
    camera["k1"] = DISTORTION[0]
    (root / "transforms.json").write_text(json.dumps(camera | {"frames": frames}))
    x, y = np.meshgrid(np.linspace(-6, 8, 281), np.linspace(-6, 8, 281))
    z = ((1 - x[..., None] * PLANES[:, 0] - y[..., None] * PLANES[:, 1]) / PLANES[:, 2]).min(
        axis=-1
    )
    for name, factor, shift in (
        ("valley.ply", 1, 0),
        ("millimetres.glb", 1000, 0),
        ("elsewhere.ply", 1, 1.5),
    ):
        points = np.stack([x, y, z], -1) * factor + shift
        if name.endswith(".glb"):
            up = -np.mean([pose[1, :3] for pose in USED], axis=0)
            points = points @ Rotation.align_vectors([[0, 1, 0]], [up])[0].as_matrix().T
        write_mesh(root / name, points)
    return root


def errors(out: Path) -> dict[str, Array]:
    """Relative errors of the depth maps of a result whose unit is the metre."""
    found = {}
    for i, view in enumerate(next(iter(sb.load_scenes("colmap", root=out)))):
        if not (out / "depths" / f"depth_{i}.png").is_file():
            continue
        np.testing.assert_allclose(view.cam_from_world, USED[i], atol=1e-9)
        truth = true_depth(USED[i], pixel_rays(view.camera))
        found[view.name] = np.abs(view.depth / truth - 1)[view.valid]
    return found


@pytest.fixture(scope="module")
def colmap(dive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A COLMAP model of the photos with their distorting camera, true poses, and points."""
    out = tmp_path_factory.mktemp("colmap") / "out"
    prepare(
        dive / "photos", out, Options(model=dive / "transforms.json", mesh=dive / "valley.ply")
    )
    return next((out / ".prepare").glob("model-*/usual/model"))


def test_given_poses_stay_and_a_mesh_gives_every_pixel_its_depth(
    dive: Path, colmap: Path, tmp_path: Path
):
    line = [str(dive / "photos"), str(tmp_path / "out"), "--model", str(colmap), "--scale", "1"]
    result = CliRunner().invoke(
        command, [*line, "--mesh", str(dive / "millimetres.glb")], catch_exceptions=False
    )
    assert result.exit_code == 0
    assert "4 of 4 photos, 100 %" in result.output
    for out in (tmp_path / "out", colmap.parents[3]):  # the latter is of a mesh in metres
        for off in errors(out).values():
            assert np.median(off) < 0.001


def test_poses_of_a_model_get_depth_of_its_photos_and_a_model_of_other_photos_is_refused(
    dive: Path, tmp_path: Path
):
    made = prepare(dive / "photos", tmp_path / "out", Options(model=dive))
    for off in errors(tmp_path / "out").values():
        assert off.size > 0.65 * WIDTH * HEIGHT
        assert np.median(off) < 0.01
    # The result is a COLMAP model with points: they are taken as they are.
    again = prepare(
        tmp_path / "out" / "images",
        tmp_path / "again",
        Options(model=tmp_path / "out" / "sparse", surface="sparse"),
    )
    assert again.scale.metres_per_unit == 1
    assert [q.points for q in again.qualities] == [q.points for q in made.qualities]
    for i in range(2):
        write(tmp_path / "others" / f"x{i}.png", photograph(POSES[0]))
    with pytest.raises(InputError, match=r"sparse: none of its 4 images .*0\.png.*; "):
        prepare(
            tmp_path / "others", tmp_path / "none", Options(model=tmp_path / "out" / "sparse")
        )
    points = tmp_path / "out/sparse/points3D.bin"
    points.write_bytes(points.read_bytes()[:5000])
    with pytest.raises(InputError, match=r"points3D\.bin: breaks off.*; "):
        prepare(
            tmp_path / "out/images",
            tmp_path / "again",
            Options(model=points.parent),
            again=True,
        )


def test_the_unit_of_a_mesh_is_the_one_that_fits_best(tmp_path: Path):
    def height(
        x: Array, y: Array
    ) -> Array:  # of a seabed through the origin, which stays there in any unit
        return x / 10 + 0.06 * np.sin(7 * x) * np.cos(5 * y)

    shot = make_shots(np.array([[0.0, 0, -2]]))[0]
    shot = replace(
        shot, points=np.array([[x / 6, y / 6, height(x / 6, y / 6)] for x, y, _ in shot.points])
    )
    x, y = np.meshgrid(np.linspace(-3, 3, 601), np.linspace(-3, 3, 601))
    write_mesh(tmp_path / "inches.ply", np.stack([x, y, height(x, y)], -1) / 0.0254)
    xy, z = shot.seen_points()
    off = depth_at(mesh_maps(tmp_path / "inches.ply", [shot])(shot).depth, xy) / z - 1
    assert np.median(np.abs(off)) < 0.002


def test_a_mesh_of_another_frame_or_without_a_model_is_refused(
    dive: Path, colmap: Path, tmp_path: Path
):
    options = Options(model=colmap, mesh=dive / "elsewhere.ply")
    with pytest.raises(InputError, match=r"elsewhere\.ply: .*frame.* %.*; "):
        prepare(dive / "photos", tmp_path / "out", options)
    with pytest.raises(InputError, match=r"--mesh: .*; add --model"):
        prepare(dive / "photos", tmp_path / "out", Options(mesh=dive / "valley.ply"))


@pytest.fixture(scope="module")
def truth() -> list[Array]:
    """Planar depth of the distorted photos."""
    u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
    rays = Lens(CAMERA, "perspective", (float(DISTORTION[0]),)).rays(
        np.stack([u.ravel(), v.ravel()], 1)
    )
    ahead = np.column_stack([rays, np.ones(len(rays))]).reshape(HEIGHT, WIDTH, 3)
    return [true_depth(pose, ahead) for pose in USED]


@pytest.mark.parametrize("kind", ["disparity", "depth", "millimetres"])
def test_maps_of_a_network_are_fitted_and_those_that_do_not_fit_are_named(
    kind: str, dive: Path, colmap: Path, truth: list[Array], tmp_path: Path
):
    folder = tmp_path / "maps"
    folder.mkdir()
    for i, depth in enumerate(truth):
        if kind == "millimetres":
            write(folder / f"{i}.png", np.rint(1000 * depth).astype(np.uint16))
        elif kind == "disparity":
            np.save(folder / f"{i}.npy", (3 + i) / depth[None, ::2, ::2] + 0.7)
        else:
            np.savez(folder / f"{i}.npz", depth=0.1 * (i + 1) * depth + 0.3)
    if kind == "disparity":
        np.save(folder / "1.npy", truth[1])  # the others are inverse to it
        np.save(folder / "2.npy", truth[2][:, :200])
    elif kind == "depth":
        (folder / "3.npz").unlink()
    done = prepare(dive / "photos", tmp_path / "out", Options(model=colmap, depth=folder))
    covered = [q.coverage > 0.9 for q in done.qualities]
    assert covered == {
        "disparity": [True, False, False, True],
        "depth": [True] * 3 + [False],
    }.get(kind, [True] * 4)
    named = " ".join(done.warnings)
    assert all((f"{i}.png" in named) != covered[i] for i in range(4))
    for off in errors(tmp_path / "out").values():
        assert np.median(off) < 0.005


def test_maps_without_photos_or_fit_are_refused(dive: Path, colmap: Path, tmp_path: Path):
    noise = np.random.default_rng(0)
    for i in range(4):
        for folder, name in (("other", f"left_{i}.npy"), ("noise", f"{i}.npy")):
            (tmp_path / folder).mkdir(exist_ok=True)
            np.save(tmp_path / folder / name, noise.uniform(1, 9, (HEIGHT, WIDTH)))
    for folder in ("other", "noise"):
        with pytest.raises(InputError, match=rf"/{folder}: .*; "):
            prepare(
                dive / "photos",
                tmp_path / "out",
                Options(model=colmap, depth=tmp_path / folder),
                again=True,
            )
