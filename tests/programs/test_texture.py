"""Coloured surfaces: where they are, which colours they have, how fine they are, and what files keep of them."""

import json
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import psutil
import pytest
from click.testing import CliRunner
from support.command_line import registry
from support.made_results import make_frame, plain, wall_view
from support.made_scene import BOX, PLANE, make_camera, make_pose, make_view
from support.messages import refused
from support.places import TOYS

from sucre_bench import InputError, View, plugins
from sucre_bench.camera import project, scaled_camera
from sucre_bench.commands.look import texture
from sucre_bench.engine.reopen_results import Frame, revisit
from sucre_bench.engine.run import run
from sucre_bench.imaging.encoding import srgb_decode
from sucre_bench.programs.texture import Cells, Model, choose_cells, fuse, mean_up, rendered, vantage, write_model

GRAY = np.full((48, 64, 3), 0.5, np.float32)
RED, GREEN = (200, 30, 20), (20, 180, 40)
WALL = Cells(0.025, 3072)


def wall(out: Path, picture: np.ndarray, name: str = "a.png", **where: float) -> Frame:
    return make_frame(out, wall_view(name, GRAY, **where), restored=picture)


def test_points_lie_on_the_surface_that_was_seen(tmp_path: Path):
    camera = make_camera(160, 120, 150)
    poses = [make_pose((0, 0, 0)), make_pose((0.4, -0.2, -0.1), -0.12, 0.07, 0.1), make_pose((-0.3, 0.1, 0.2), 0.1)]
    views = [make_view(f"{k}.png", camera, pose) for k, pose in enumerate(poses)]
    frames = [make_frame(tmp_path, view, restored=plain(RED, 120, 160)) for view in views]
    voxel = 0.02
    model = fuse(frames, "restored", Cells(voxel, 20_000), mesh=False)
    points = model.points.astype(float)
    to_plane = np.abs(points @ PLANE - 1) / np.linalg.norm(PLANE)
    outside = np.maximum(BOX[0] - points, points - BOX[1])
    to_box = np.where((outside > 0).any(axis=1), np.linalg.norm(outside.clip(0), axis=1), -outside.max(axis=1))
    nearest = np.minimum(to_plane, to_box)
    assert len(points) > 5000
    assert np.median(nearest) < 0.1 * voxel
    assert np.percentile(nearest, 99) < voxel
    assert (model.colours == RED).all()


def test_a_pixel_colours_what_lies_under_it_and_not_what_is_half_a_pixel_aside(tmp_path: Path):
    picture = plain(RED)
    picture[:, 32:] = GREEN  # the edge is at x = 0 in the world; pixels are 5 cm wide there
    model = fuse([wall(tmp_path, picture)], "restored", Cells(0.0125, 20_000), mesh=False)
    reddish = model.colours[:, 0] > 100
    assert model.points[reddish, 0].max() < 1e-3
    assert model.points[~reddish, 0].min() > -1e-3


def test_what_several_views_show_has_the_mean_of_their_colours(tmp_path: Path):
    frames = [wall(tmp_path, plain((100, 40, 60))), wall(tmp_path, plain((200, 60, 60)), "b.png", x=0.05)]
    model = fuse(frames, "restored", WALL, mesh=False)
    inner = (np.abs(model.points[:, :2]) < 1).all(axis=1)
    assert np.abs(model.colours[inner] - np.array([150, 50, 60])).max() <= 1


def test_black_is_no_colour_and_leaves_a_hole(tmp_path: Path):
    picture = plain(RED)
    picture[:, :32] = 0
    model = fuse([wall(tmp_path, picture)], "restored", WALL)
    assert model.points[:, 0].min() > -0.06
    assert model.points[:, 0].max() > 1.4
    masked = fuse([wall(tmp_path, picture)], "input", WALL, mask="restored")
    assert len(masked.points) == len(model.points)
    assert np.abs(masked.colours.astype(int) - 128).max() <= 1
    with pytest.raises(InputError, match=r"depth.*colour"):
        fuse([wall(tmp_path, plain((0, 0, 0)))], "restored", WALL)


def test_views_without_depth_or_pose_are_passed_over(tmp_path: Path):
    flat = make_frame(tmp_path, View("flat.png", wall_view("w", GRAY).pixels), restored=plain(GREEN))
    assert (fuse([flat, wall(tmp_path, plain(RED))], "restored", WALL, mesh=False).colours == RED).all()
    with pytest.raises(InputError, match="camera, pose and depth"):
        choose_cells([flat])
    with pytest.raises(InputError, match="--picture"):
        vantage([flat])


def test_voxels_are_as_large_as_pixels_on_the_surface_and_what_is_seen_twice_counts_once(tmp_path: Path):
    rgb = np.full((480, 640, 3), 0.5, np.float32)
    views = [wall_view("a.png", rgb, focal=400), wall_view("b.png", rgb, focal=400)]
    frames = [make_frame(tmp_path, view) for view in views]
    cells = choose_cells(frames)
    assert cells.voxel == pytest.approx(2.005 / 400, rel=1e-5)
    assert cells.count == pytest.approx(480 * 640, rel=0.1)
    assert choose_cells(frames, 0.01).count == pytest.approx(480 * 640 / 4, rel=0.15)  # cells at the rim count whole


def test_a_large_surface_gets_larger_voxels_and_too_small_ones_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    frames = [make_frame(tmp_path, wall_view("a.png", GRAY))]
    finest = choose_cells(frames)
    coarser = choose_cells(frames, most_cells=finest.count // 4)
    assert coarser.voxel == pytest.approx(2 * finest.voxel, rel=1e-3)
    with pytest.raises(InputError, match=r"--voxel 0\.001: .* 0\.05 m; .*0\.013"):
        choose_cells(frames, 0.001)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: SimpleNamespace(available=1 << 10))
    with pytest.raises(InputError, match=r"--voxel 0\.02: .* million cells .* GB, .*; give .*\d"):
        choose_cells(frames, 0.02)


def triangle() -> Model:
    points = np.array([[0, 0, 2], [1, 0, 2], [0, 1.5, 3]], np.float32)
    return Model(points, np.array([RED, GREEN, (5, 128, 255)], np.uint8), np.array([[0, 1, 2]], np.int32))


UP = np.array([0.6, -0.8, 0.0])


def test_a_ply_is_read_back_as_it_was(tmp_path: Path):
    import open3d as o3d

    model = triangle()
    write_model(tmp_path / "mesh.ply", model, UP)
    read = o3d.io.read_triangle_mesh(str(tmp_path / "mesh.ply"))
    assert np.array_equal(np.asarray(read.vertices, np.float32), model.points)
    assert np.array_equal(np.asarray(read.triangles), model.triangles)
    assert np.array_equal(np.rint(np.asarray(read.vertex_colors) * 255), model.colours)
    write_model(tmp_path / "points.ply", Model(model.points, model.colours, np.empty((0, 3), np.int32)), UP)
    assert len(o3d.io.read_point_cloud(str(tmp_path / "points.ply")).points) == 3


def test_a_glb_is_read_back_with_colours_in_linear_light(tmp_path: Path):
    import open3d as o3d

    model, path = triangle(), tmp_path / "mesh.glb"
    write_model(path, model, UP)
    read = o3d.io.read_triangle_mesh(str(path))
    turned = np.asarray(read.vertices)
    between = [np.linalg.norm(p - np.roll(p, 1, axis=0), axis=1) for p in (turned, model.points)]
    assert between[0] == pytest.approx(between[1], abs=1e-5)
    assert np.array_equal(np.asarray(read.triangles), model.triangles)
    assert np.asarray(read.vertex_colors) == pytest.approx(srgb_decode(model.colours / 255), abs=1e-4)


def test_a_glb_stands_upright_and_its_material_is_unlit(tmp_path: Path):
    from scipy.spatial.transform import Rotation

    path = tmp_path / "mesh.glb"
    for up in (UP, np.array([0, -1.0, 0]), np.array([0, 1.0, 0])):
        write_model(path, triangle(), up)
        content = path.read_bytes()
        told = json.loads(content[20 : 20 + int.from_bytes(content[12:16], "little")])
        assert Rotation.from_quat(told["nodes"][0]["rotation"]).apply(up) == pytest.approx([0, 1, 0], abs=1e-6)
        assert int.from_bytes(content[8:12], "little") == len(content)
    assert "KHR_materials_unlit" in told["materials"][0]["extensions"]


def test_up_is_where_the_cameras_tops_point():
    views = [
        make_view(f"{k}", make_camera(4, 4, 4), make_pose((0, 0, 0), roll=roll)) for k, roll in enumerate((0.5, -0.5))
    ]
    assert mean_up(views) == pytest.approx([0, -1, 0])
    assert mean_up([]) == pytest.approx([0, -1, 0])


def test_a_rendering_from_a_view_shows_its_picture(tmp_path: Path):
    picture = plain(RED)
    picture[:20, 40:] = GREEN
    frame = wall(tmp_path, picture)
    view = frame.view
    seen = rendered(fuse([frame], "restored", Cells(0.0125, 20_000)), view.camera, np.array(view.cam_from_world))
    inner = np.s_[3:-3, 3:-3]
    differs = np.abs(seen.astype(int) - picture).max(axis=-1) > 30
    assert differs[inner].mean() < 0.03  # along the edge alone
    beyond = make_pose((0, 0, 5))
    assert (rendered(fuse([frame], "restored", WALL), scaled_camera(view.camera, (64, 48), 0.5), beyond) == 255).all()


def test_the_picture_is_taken_from_behind_and_above_and_holds_what_the_view_shows(tmp_path: Path):
    frame = wall(tmp_path, plain(RED))
    camera, pose = vantage([frame])
    eye = np.linalg.inv(pose)[:3, 3]
    assert eye[2] < 0, "behind"
    assert eye[1] < 0, "above: y points down"
    at, depth = project(camera, np.array([[0.0, 0.0, 2.0]]) @ pose[:3, :3].T + pose[:3, 3])
    assert depth[0] > 2
    assert at[0] == pytest.approx([camera.width / 2, camera.height / 2], abs=20)


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The toy scene, a wall of noise two metres away, as it is and darker."""
    out = tmp_path_factory.mktemp("results")
    toys = str(TOYS)
    words = ["dataset=toy", "method=gain", "method.gain=1,0.5", f"out={out}", "metrics=[psnr]"]
    with plugins.using(registry()):
        run([*words, "tracking.uri=off", "report=false", f"plugins=[{toys}]"], True)
    return out


def test_the_command_writes_a_surface_and_a_picture_of_what_a_run_left(results: Path, tmp_path: Path):
    files = [str(tmp_path / "s.glb"), "--picture", str(tmp_path / "p.png")]
    words = [str(results), *files, "--method", "gain,gain=0.5", "--plugin", str(TOYS)]
    done = CliRunner().invoke(texture, words, catch_exceptions=False)
    assert done.exit_code == 0, done.output
    assert "3 views" in done.output
    assert cv2.imread(str(tmp_path / "p.png")).shape == (720, 1920, 3)
    assert (tmp_path / "s.glb").read_bytes().startswith(b"glTF")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["s.obj", "--method", "gain,gain=1"], {"s.obj", ".ply", ".glb"}),
        (["s.ply", "--method", "gain", "--picture", "p.jpg"], {"p.jpg", ".png"}),
        (["s.ply", "--method", "gain,gain=2"], {"method", "'gain,gain=2'", "'gain,gain=1.0'"}),
        (["s.ply", "--method", "input", "--dataset", "toi"], {"dataset", "'toi'", "toy"}),
        (["s.ply", "--method", "input", "--scene", "x"], {"scene", "'x'", "toy"}),
    ],
)
def test_wrong_words_are_named_in_one_line(results: Path, words: list[str], named: set[str]):
    with refused(*named):
        CliRunner().invoke(texture, [str(results), *words], catch_exceptions=False)


@pytest.mark.usefixtures("toys")
def test_data_that_changed_since_the_run_are_refused(results: Path, tmp_path: Path):
    import shutil

    copy = shutil.copytree(results, tmp_path / "copy")
    config = (copy / "config.yaml").read_text()
    (copy / "config.yaml").write_text(config.replace("tag: ''", "tag: other"))
    (data_id,) = set(pd.read_parquet(copy / "scores.parquet")["data_id"])
    with pytest.raises(InputError, match=rf"'toy' .*{data_id}"):
        revisit(copy, ["input"])
    (copy / "config.yaml").write_text(
        config.replace("name: toy", "name: toy\n  label: else").replace("label: null", "")
    )
    with pytest.raises(InputError, match=r"'else', .*'toy'"):
        revisit(copy, ["input"])
    (copy / "config.yaml").unlink()
    with pytest.raises(InputError, match=r"config\.yaml: "):
        revisit(copy, ["input"])
