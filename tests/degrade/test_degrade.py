"""Degradations: each against what it says it does, and through a run."""

from __future__ import annotations

import itertools
import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.made_scene import WATER, make_camera, make_pose, make_scene, make_view

from sucre_bench import Arrays, Camera, Chart, InputError, Scene, View, Water, plugins
from sucre_bench.arrays import Array
from sucre_bench.camera import project
from sucre_bench.degrade import Degradation, degraded
from sucre_bench.engine import preflight, sweep
from sucre_bench.engine.outcome import Outcome
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.jobs import command
from sucre_bench.scene import Encoding, Plane

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
    view = View("a.png", Arrays(rgb, depth, reference), camera, None if camera is None else np.eye(4), (), encoding)
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
        View(f"v{n}.png", Arrays(photo(16, 20), np.full((16, 20), 2.0)), camera, make_pose((n, 0, 0), 0.1 * n))
        for n in range(count)
    ]
    return Scene("many", views, frozenset({"depth", "poses"}), data_id="many")


# -- the sensor --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("encoding", ["gamma", "linear"])
def test_noise_has_the_standard_deviation_asked_for_in_stored_intensities(encoding: Encoding):
    view = degraded(of(np.full((200, 300, 3), 0.5), encoding=encoding), noise=0.02)["a.png"]
    error = view.rgb.astype(float) - 0.5
    assert error.std(axis=(0, 1)) == pytest.approx([0.02] * 3, rel=0.02)
    assert abs(error.mean()) < 4 * 0.02 / np.sqrt(error.size)
    assert abs(np.corrcoef(error[..., 0].ravel(), error[..., 1].ravel())[0, 1]) < 0.02
    assert abs(np.corrcoef(error[:, 1:].ravel(), error[:, :-1].ravel())[0, 1]) < 0.02


def test_bits_leave_that_many_levels_from_black_to_white():
    ramp = np.linspace(0, 1, 3000, dtype=np.float32).reshape(10, 100, 3)
    rgb = degraded(of(ramp), bits=3)["a.png"].rgb
    np.testing.assert_allclose(np.unique(rgb), np.arange(8) / 7, atol=1e-6)
    assert np.abs(rgb - ramp).max() <= 0.5 / 7 + 1e-6
    noisy = degraded(of(ramp), bits=1, noise=0.3)["a.png"].rgb  # noise comes before the bits
    assert set(np.unique(noisy)) == {0, 1}


def test_jpeg_is_what_a_jpeg_file_gives_back():
    stored = np.rint(photo() * 255).astype(np.uint8)
    _, file = cv2.imencode(".jpg", stored[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 30])
    expected = cv2.imdecode(file, cv2.IMREAD_COLOR)[..., ::-1] / 255
    np.testing.assert_allclose(degraded(of(photo()), jpeg_quality=30)["a.png"].rgb, expected, atol=1e-6)
    linear = of(srgb_decode(photo()), encoding="linear")  # the file holds the picture as it is shown
    view = degraded(linear, jpeg_quality=30)["a.png"]
    assert view.encoding == "linear"
    np.testing.assert_allclose(srgb_encode(view.rgb), expected, atol=1e-5)


@pytest.mark.parametrize("encoding", ["gamma", "linear"])
def test_blur_spreads_light_by_its_standard_deviation_and_loses_none(encoding: Encoding):
    image = np.zeros((61, 61, 3), dtype=np.float32)
    image[30, 30] = 0.6  # 0.319 in linear light, by sRGB's formula
    rgb = degraded(of(image, encoding=encoding), blur_px=2.0)["a.png"].rgb.astype(float)
    light = (rgb if encoding == "linear" else srgb_decode(rgb))[..., 1]
    total = 0.6 if encoding == "linear" else ((0.6 + 0.055) / 1.055) ** 2.4
    assert light.sum() == pytest.approx(total, abs=1e-3)
    light = light / light.sum()
    offsets = np.arange(61) - 30.0
    assert light.sum(axis=0) @ offsets == pytest.approx(0, abs=1e-3)
    assert np.sqrt(light.sum(axis=0) @ offsets**2) == pytest.approx(2, rel=0.02)


def test_the_sensor_alters_neither_reference_nor_depth():
    scene = of(photo(), np.full((60, 80), 2.0), photo()[::-1])
    view = degraded(scene, blur_px=1, noise=0.1, bits=4, jpeg_quality=20)["a.png"]
    assert view.reference is not None
    assert np.array_equal(view.reference, photo()[::-1])
    assert np.array_equal(view.depth, np.full((60, 80), 2.0))
    assert not np.array_equal(view.rgb, photo())


# -- size --------------------------------------------------------------------------------------------------


def test_a_point_still_falls_on_its_pixels_in_a_smaller_image():
    """A block of 3 x 3 pixels of one colour, with its own depth: in every plane it lies where its point projects."""
    camera = Camera(np.array([[70.0, 0, 31.5], [0, 80, 22.5], [0, 0, 1]]), 90, 60)
    rgb, depth = np.zeros((60, 90, 3)), np.full((60, 90), 9.0)
    rgb[36:39, 66:69], depth[36:39, 66:69] = 1, 5
    point = np.array([(67.5 - 31.5) / 70 * 5, (37.5 - 22.5) / 80 * 5, 5])
    scene = of(rgb, depth, rgb, camera=camera)
    chart = Chart("c", "dgk", np.array([[66.0, 36], [69, 36], [69, 39], [66, 39]]))
    scene = replace(scene, views=[replace(scene.views[0], charts=[chart])])
    view = degraded(scene, scale=1 / 3)["a.png"]
    assert view.camera is not None
    assert view.reference is not None
    assert (view.camera.width, view.camera.height, view.rgb.shape) == (30, 20, (20, 30, 3))
    (u, v), _ = project(view.camera, point)
    assert (u, v) == (pytest.approx(22.5), pytest.approx(12.5))
    for plane in (view.rgb[..., 0], view.reference[..., 0], view.depth == 5):
        assert np.argwhere(plane).tolist() == [[12, 22]]
    np.testing.assert_allclose(view.charts[0].corners, [[22, 12], [23, 12], [23, 13], [22, 13]])
    assert set(np.unique(degraded(scene, scale=0.4)["a.png"].depth)) == {5, 9}  # nothing in between
    without_camera = replace(scene, views=[replace(scene.views[0], camera=None)])
    corners = degraded(without_camera, scale=1 / 3)["a.png"].charts[0].corners
    np.testing.assert_allclose(corners, view.charts[0].corners)


# -- water -------------------------------------------------------------------------------------------------


def test_added_water_follows_the_model_at_the_distance_from_the_camera():
    """A corner pixel 2 m deep, seen at an angle: z = 2 sqrt(1 + x^2 + y^2), by hand."""
    camera = Camera(np.array([[40.0, 0, 40], [0, 40, 30], [0, 0, 1]]), 80, 60)
    made = degraded(of(photo(), np.full((60, 80), 2.0), camera=camera), add_water=NINE)
    view = made["a.png"]
    z = 2 * np.sqrt(1 + (39.5 / 40) ** 2 + (29.5 / 40) ** 2)
    J, B, beta, gamma = photo()[0, 0], *np.reshape(NINE, (3, 3))
    np.testing.assert_allclose(view.rgb[0, 0], J * np.exp(-beta * z) + B * (1 - np.exp(-gamma * z)), atol=1e-6)
    assert view.reference is not None
    assert np.array_equal(view.reference, photo())
    assert made.has == {"depth", "poses", "reference", "truth"}
    assert made.water is not None
    assert np.array_equal(made.water.attenuation, beta)


def test_a_dry_scene_under_water_is_the_wet_scene():
    camera, pose = make_camera(60, 44, 56), make_pose((0.1, 0, 0))
    dry, wet = (make_view("a.png", camera, pose, water) for water in (None, WATER))
    scene = Scene("made", [dry], frozenset({"depth"}))
    np.testing.assert_allclose(degraded(scene, add_water=WATER)["a.png"].rgb, wet.rgb, atol=1.01 / 255)


def test_water_goes_over_the_reference_where_the_scene_has_some():
    depth = np.full((60, 80), 2.0)
    dry = degraded(of(photo(), depth), add_water=NINE)["a.png"]
    wet = degraded(of(photo() * 0.2, depth, photo()), add_water=NINE)["a.png"]
    assert np.array_equal(wet.rgb, dry.rgb)
    lacking = replace(of(photo(), depth), has=frozenset({"depth", "reference"}))
    with pytest.raises(InputError, match=r"a\.png: has no reference to add water to"):
        _ = degraded(lacking, add_water=NINE)["a.png"].rgb


def test_a_pixel_without_depth_is_as_deep_under_water_as_its_nearest_neighbour():
    depth = np.full((60, 80), 2.0)
    depth[:, 40:] = 6
    holes = depth.copy()
    holes[10:20, 10:20] = holes[10:20, 60:70] = 0
    whole, pierced = (degraded(of(photo(), d), add_water=NINE)["a.png"] for d in (depth, holes))
    assert np.array_equal(whole.rgb, pierced.rgb)
    assert not pierced.valid[15, 15]
    with pytest.raises(InputError, match=r"a\.png: has no depth, which added water needs"):
        _ = degraded(of(photo(), np.zeros((60, 80))), add_water=NINE)["a.png"].rgb


def test_water_is_given_as_numbers_or_a_file_or_itself(tmp_path: Path):
    file = tmp_path / "bay.json"
    B, beta, gamma = np.reshape(NINE, (3, 3))
    file.write_text(json.dumps({"B": list(B), "beta": list(beta), "gamma": list(gamma), "else": 1}))
    given = [Degradation(add_water=w) for w in (list(NINE), str(file), file, Water(B, beta, gamma), np.array(NINE))]
    assert len({d.data_id("x") for d in given}) == 1
    assert given[0].labelled("air") == "air,add_water=0.1_0.2_0.3_0.4_0.2_0.1_0.3_0.2_0.15"
    assert given[1].labelled("air").startswith("air,add_water=bay-")
    other = tmp_path / "sub" / "bay.json"
    other.parent.mkdir()
    other.write_text(file.read_text().replace("0.15", "0.16"))
    assert Degradation(add_water=other).labelled("air") != given[1].labelled("air")


# -- depth and poses ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("grain", [0.0, 3.0])
def test_depth_noise_is_relative_and_as_smooth_as_asked(grain: float):
    """Neighbours of white noise smoothed by a Gaussian of sd s correlate by exp(-1 / (4 s^2))."""
    depth = np.where(np.arange(300) < 150, 2.0, 8.0) * np.ones((200, 1))
    depth[:20] = 0
    view = degraded(of(photo(200, 300), depth), depth_noise=0.05, depth_noise_px=grain)["a.png"]
    assert np.array_equal(view.depth == 0, depth == 0)
    relative = (view.depth.astype(float) / np.where(depth == 0, 1, depth))[20:] - 1
    near, far = relative[:, :150], relative[:, 150:]
    assert (near.std(), far.std()) == (pytest.approx(0.05, rel=0.15), pytest.approx(0.05, rel=0.15))
    correlation = (relative[:, 1:] * relative[:, :-1]).mean() / (relative**2).mean()
    assert correlation == pytest.approx(np.exp(-1 / (4 * grain**2)) if grain else 0, abs=0.02)
    assert np.array_equal(view.rgb, photo(200, 300))


@pytest.mark.parametrize(("grain", "alike"), [(0.0, 0.75), (10.0, 1.0)])
def test_holes_take_the_share_asked_for_of_the_known_pixels(grain: float, alike: float):
    """alike: of a hole's pixels, how many have another to their right: the share itself where each is its own."""
    depth = np.full((200, 300), 3.0)
    depth[:, :100] = 0
    got = degraded(of(photo(200, 300), depth), depth_holes=0.75, depth_hole_px=grain)["a.png"].depth
    lost = (got == 0)[:, 100:]
    assert lost.mean() == pytest.approx(0.75, abs=1e-3)
    assert (got[got > 0] == 3).all()
    assert lost[:, 1:][lost[:, :-1]].mean() == pytest.approx(alike, abs=0.03)


def test_pose_noise_moves_the_centre_and_turns_the_camera_by_what_is_asked():
    from scipy.spatial.transform import Rotation

    scene = many(600)
    moved, turned = degraded(scene, pose_noise_m=0.05), degraded(scene, pose_noise_deg=2.0)
    shifts, turns = [], []
    for view in scene:
        at, before, after = view.cam_from_world, moved[view.name].cam_from_world, turned[view.name].cam_from_world
        assert at is not None
        assert before is not None
        assert after is not None
        shifts.append(np.linalg.inv(before)[:3, 3] - np.linalg.inv(at)[:3, 3])
        np.testing.assert_allclose(before[:3, :3], at[:3, :3], atol=1e-12)
        turns.append(Rotation.from_matrix(after[:3, :3] @ at[:3, :3].T).as_rotvec(degrees=True))
        np.testing.assert_allclose(np.linalg.inv(after)[:3, 3], np.linalg.inv(at)[:3, 3], atol=1e-9)
        np.testing.assert_allclose(after[:3, :3] @ after[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.std(shifts, axis=0) == pytest.approx([0.05] * 3, rel=0.1)
    assert np.std(turns, axis=0) == pytest.approx([2.0] * 3, rel=0.1)
    assert moved["v0.png"].pixels is scene["v0.png"].pixels  # nothing is decoded twice


# -- what belongs to what ----------------------------------------------------------------------------------

RANDOM = {"noise": 0.1, "depth_noise": 0.1, "depth_holes": 0.2, "pose_noise_m": 0.1, "pose_noise_deg": 1.0}


def planes(view: View) -> list[Array]:
    assert view.cam_from_world is not None
    return [view.rgb, view.depth, view.cam_from_world]


def test_random_numbers_are_a_views_own_whatever_else_there_is():
    scene = many()
    part = replace(scene, views=[scene.views[5], scene.views[2]])
    for options in (RANDOM, {"noise": 0.1}):
        whole, fewer = degraded(scene, **options), degraded(part, **options)
        for one, other in zip(planes(whole["v2.png"]), planes(fewer["v2.png"]), strict=True):
            assert np.array_equal(one, other)
    whole, again, reseeded = (degraded(scene, seed=seed, **RANDOM) for seed in (0, 0, 1))
    for one, same, other, neighbour in zip(
        *(planes(v) for v in (whole["v2.png"], again["v2.png"], reseeded["v2.png"], whole["v3.png"])), strict=True
    ):
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)
        assert not np.array_equal(one, neighbour)
    alone = degraded(scene, noise=0.1)["v2.png"]  # one kind of noise does not shift another's numbers
    assert np.array_equal(alone.rgb, whole["v2.png"].rgb)


def test_all_at_once_is_one_after_the_other_in_the_order_of_light():
    scene = of(photo(), np.full((60, 80), 2.0), camera=Camera(np.diag([50.0, 50, 1]), 80, 60))
    at_once = degraded(scene, jpeg_quality=40, bits=5, noise=0.05, scale=0.5, blur_px=1.5, add_water=NINE)["a.png"]
    for step in (
        {"add_water": NINE}, {"blur_px": 1.5}, {"scale": 0.5}, {"noise": 0.05}, {"bits": 5}, {"jpeg_quality": 40},
    ):  # fmt: skip
        scene = degraded(scene, **step)
    assert np.array_equal(at_once.rgb, scene["a.png"].rgb)
    depths = [{"scale": 0.5}, {"depth_noise": 0.1}, {"depth_holes": 0.2}]
    scene = start = of(photo(), np.full((60, 80), 2.0))
    for step in depths:
        scene = degraded(scene, **step)
    both = degraded(start, depth_holes=0.2, depth_noise=0.1, scale=0.5)
    assert np.array_equal(both["a.png"].depth, scene["a.png"].depth)


@dataclass(frozen=True, eq=False)
class Counting:
    """Pixels that tell what is asked of them."""

    asked: list[Plane]

    def load(self, plane: Plane) -> Array | None:
        self.asked.append(plane)
        return None if plane == "reference" else photo()[..., 0] if plane == "depth" else photo()


def test_nothing_is_decoded_before_it_is_asked_for_and_planes_are_locked():
    asked: list[Plane] = []
    scene = Scene("lazy", [View("a.png", Counting(asked))], frozenset({"depth"}), data_id="lazy")
    made = degraded(scene, noise=0.1, scale=0.5, depth_noise=0.1, add_water=NINE)
    assert asked == []
    assert made["a.png"].depth.shape == (30, 40)
    assert asked == ["depth"]
    with pytest.raises(ValueError, match="read-only"):
        made["a.png"].rgb[:] = 0


def test_within_and_keep_choose_views_in_capture_order():
    scene = many()

    def names(**options: int) -> list[str]:
        return [view.name for view in degraded(scene, target="v4.png", **options)]

    assert names(within=2) == ["v2.png", "v3.png", "v4.png", "v5.png", "v6.png"]
    assert names(within=0) == names(keep=1) == ["v4.png"]
    assert [v.name for v in degraded(scene, target="v1.png", within=2)] == ["v0.png", "v1.png", "v2.png", "v3.png"]
    drawn = [names(keep=count) for count in range(1, 10)]
    for count, chosen in enumerate(drawn, start=1):
        assert len(chosen) == count
        assert chosen == sorted(chosen)
        assert "v4.png" in chosen
    assert all(set(few) < set(more) for few, more in itertools.pairwise(drawn))
    assert len({tuple(names(keep=3, seed=seed)) for seed in range(20)}) > 5
    both = names(within=2, keep=3)
    assert len(both) == 3
    assert set(both) <= set(names(within=2))
    assert degraded(scene, target="v4.png", within=2)["v3.png"] is scene["v3.png"]


# -- labels, hashes, runs ----------------------------------------------------------------------------------


def test_data_are_equal_exactly_where_their_hashes_are():
    scene = many()
    options: list[dict[str, object]] = [
        {}, {"noise": 0.1}, {"noise": 0.2}, {"noise": 0.1, "seed": 1}, {"bits": 8}, {"jpeg_quality": 8}, {"blur_px": 1},
        {"scale": 0.5}, {"depth_noise": 0.1}, {"depth_noise": 0.1, "depth_noise_px": 2.0}, {"depth_holes": 0.1},
        {"depth_holes": 0.1, "depth_hole_px": 2.0}, {"pose_noise_m": 0.1}, {"pose_noise_deg": 0.1}, {"add_water": NINE},
        {"within": 2, "target": "v4.png"}, {"within": 2, "target": "v3.png"}, {"keep": 2, "target": "v4.png"},
    ]  # fmt: skip
    ids = [degraded(scene, **one).data_id for one in options]
    assert len(set(ids)) == len(ids)
    assert ids[0] == scene.data_id
    same = [{"bits": 8, "seed": 3}, {"bits": 8, "depth_hole_px": 4.0}, {"bits": 8, "target": "v4.png", "within": 99}]
    assert {degraded(scene, **one).data_id for one in same} == {ids[4]}
    assert degraded(replace(scene, data_id="other"), bits=8).data_id != ids[4]
    assert degraded(replace(scene, data_id=""), bits=8).data_id == ""


def test_no_degradation_is_the_scene_itself():
    scene = make_scene()
    assert degraded(scene) is scene
    assert degraded(scene, scale=1, noise=0.0, seed=4) is scene


METHOD = '''
from dataclasses import dataclass
from pathlib import Path
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Diary:
    """Notes which views it is given, and how worn the target is."""

    log: Path
    """Where."""

    def restore(self, scene, view):
        with self.log.open("a") as file:
            file.write(f"{view.name}:{'+'.join(v.name for v in scene)}:{len(set(view.rgb[..., 0].ravel()))}\\n")
        return Restoration(view.rgb * 1.0)
'''


@pytest.fixture
def run(tmp_path: Path, toys: str):
    (tmp_path / "diary.py").write_text(METHOD)
    plugins.load_file(tmp_path / "diary.py")
    base = ["dataset=toy", "method=diary", f"method.log={tmp_path / 'log'}", "metrics=[psnr]", "report=false"]

    def run(*overrides: str) -> tuple[Outcome, list[str]]:
        before = len((tmp_path / "log").read_text().split()) if (tmp_path / "log").exists() else 0
        outcome = sweep.run([*base, "tracking.uri=off", f"out={tmp_path / 'out'}", *overrides], multirun=True)
        return outcome, (tmp_path / "log").read_text().split()[before:]

    return run


def test_a_sweep_over_degradations_keeps_them_apart_and_goes_on_where_it_stopped(run, tmp_path: Path):
    swept = ("degrade.bits=2,null", "degrade.within=1")
    first, told = run(*swept)
    assert (first.ok, first.failed) == (6, ())
    seen = {"v0.png": "v0.png+v1.png", "v1.png": "v0.png+v1.png+v2.png", "v2.png": "v1.png+v2.png"}
    assert {tuple(line.split(":")[:2]) for line in told} == set(seen.items())
    assert sorted(int(line.split(":")[2]) <= 4 for line in told) == [False] * 3 + [True] * 3
    ids = first.rows.groupby("dataset")["data_id"].unique()
    assert set(ids.index) == {"toy,within=1", "toy,within=1,bits=2"}
    assert all(len(one) == 1 for one in ids)  # one per scene, whichever the target, as comparisons want it
    assert len({one[0] for one in ids}) == 2
    assert (tmp_path / "out" / "restored" / "toy,within=1,bits=2" / "diary" / "v1.png").is_file()
    assert set(json.loads((tmp_path / "out" / "environment.json").read_text())["data"]) == set(ids.index)
    again, told = run(*swept)
    assert (again.cached, told) == (6, [])
    more, told = run("degrade.bits=2,3", "degrade.within=1", "views=[v1.png]")
    assert (more.ok, [line.split(":")[0] for line in told]) == (2, ["v1.png"])


def test_a_scene_that_lacks_what_is_to_be_degraded_is_refused_before_any_work(toys: str, tmp_path: Path):
    base = ["dataset=two_scenes", "method=gain", "metrics=[redness]", f"out={tmp_path}", "tracking.uri=off"]
    for option, lacking in (("depth_holes=0.1", "depth"), ("pose_noise_m=1", "poses")):
        with pytest.raises(preflight.ProblemsError, match=f"scene 'left' has no {lacking}; leave it out"):
            sweep.run([*base, f"degrade.{option}"], multirun=False)


@pytest.mark.parametrize(
    ("override", "said"),
    [
        ("nois=1", "did you mean 'noise'"),
        ("noise=-1", "degrade.noise: -1.0; give a number in [0, 1]"),
        ("noise=nan", "degrade.noise: nan; give a number"),
        ("noise=lots", "degrade.noise: 'lots' is not a number"),
        ("bits=0", "degrade.bits: 0; give a whole number in [1, 16]"),
        ("jpeg_quality=101", "give a whole number in [1, 100]"),
        ("keep=0", "degrade.keep: 0; give a whole number in [1, inf)"),
        ("scale=0", "degrade.scale: 0.0; give a number in [0.01, 1]"),
        ("scale=null", "degrade.scale"),
        ("add_water=5", "degrade.add_water: not a water; give nine numbers"),
        ("add_water=[1,2,3]", "degrade.add_water: not a water; give nine numbers"),
        ("add_water=[.1,.1,.1,.2,.2,-1,.1,.1,.1]", "degrade.add_water: no water has these values"),
        ("add_water=[1.1,.1,.1,.2,.2,1,.1,.1,.1]", "degrade.add_water: no water has these values"),
        ("add_water=absent.json", "absent.json: no such file; write "),
    ],
)
def test_a_wrong_option_is_said_in_one_line(toys: str, override: str, said: str):
    with pytest.raises(InputError) as fault:
        command.jobs(["dataset=toy", "method=gain", "metrics=[psnr]", f"degrade.{override}"], multirun=False)
    assert said in str(fault.value)
    assert "\n" not in str(fault.value)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("{", "does not hold B, beta and gamma"),
        ("[1]", "no B, beta and gamma in it"),
        ('{"B": [1, 1, 1], "beta": [1, 1, 1]}', "no water has these values"),
        ('{"B": 1, "beta": [1, 1, 1], "gamma": [1, 1, 1]}', "B must be three numbers"),
        ('{"B": [1, 1, 1], "beta": [1, 1, null], "gamma": [1, 1, 1]}', "no water has these values"),
    ],
)
def test_a_water_file_that_is_none_is_named(tmp_path: Path, content: str, said: str):
    (tmp_path / "w.json").write_text(content)
    with pytest.raises(InputError, match=said) as fault:
        Degradation(add_water=tmp_path / "w.json")
    assert str(fault.value).startswith(str(tmp_path / "w.json"))


def test_a_water_that_a_run_left_is_added_again_to_intensities_that_it_explains(tmp_path: Path):
    told = {"B": [0.1, 0.2, 0.3], "beta": [0.4, 0.2, 0.1], "gamma": [0.3, 0.2, 0.1], "encoding": "gamma", "cost": [1]}
    (tmp_path / "w.json").write_text(json.dumps(told))
    scene = degraded(many(), add_water=tmp_path / "w.json")
    numbers = [*told["B"], *told["beta"], *told["gamma"]]  # type: ignore[misc]
    view = scene.views[0].name
    np.testing.assert_array_equal(scene[view].rgb, degraded(many(), add_water=numbers)[view].rgb)
    (tmp_path / "w.json").write_text(json.dumps(told | {"encoding": "linear"}))
    with pytest.raises(InputError, match="has the encoding linear, the view gamma"):
        _ = degraded(many(), add_water=tmp_path / "w.json")[view].rgb


def test_python_callers_are_told_as_well():
    scene = many()
    with pytest.raises(InputError, match="did you mean 'depth_noise'"):
        degraded(scene, depth_nois=0.1)
    with pytest.raises(InputError, match="give target=NAME"):
        degraded(scene, within=1)
    with pytest.raises(InputError, match=r"no view named 'v77\.png'"):
        degraded(scene, within=1, target="v77.png")
    with pytest.raises(InputError, match="beside a Degradation"):
        degraded(scene, Degradation(bits=8), noise=0.1)
    assert np.array_equal(degraded(scene, Degradation(bits=2))["v1.png"].rgb, degraded(scene, bits=2)["v1.png"].rgb)
