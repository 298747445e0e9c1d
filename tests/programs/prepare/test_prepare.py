"""From photos to a scene: two slanted planes with a texture, photographed by a distorting camera, are the truth."""

import json
import resource
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image
from PIL.ExifTags import IFD, Base
from support.messages import Lines
from support.photographed_valley import (
    DISTORTION,
    FOCAL,
    NAMES,
    PLACES,
    POSES,
    WIDTH,
    photograph,
    true_depth,
    write,
)

import sucre_bench as sb
from sucre_bench.camera import pixel_rays
from sucre_bench.commands.prepare import prepare as command
from sucre_bench.errors import InputError, OutputError, PluginError
from sucre_bench.imaging.image_files import is_jpeg
from sucre_bench.loading.colmap_model import read_model
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.machine import progress
from sucre_bench.programs.prepare import Options, mapping, result
from sucre_bench.programs.prepare.photos import Photo, find_photos
from sucre_bench.programs.prepare.pipeline import prepare, settled_scale
from sucre_bench.programs.prepare.result import Prepared
from sucre_bench.programs.prepare.scale import known_scale
from sucre_bench.programs.prepare.shots import read_shots, undistort, write_model


@pytest.fixture(scope="module")
def prepared(photos: Path) -> Prepared:
    known = known_scale(distances=[(NAMES[0], NAMES[3], float(np.linalg.norm(PLACES[3])))])
    return prepare(photos / "photos", photos / "out", Options(masks=photos / "masks"), known)


def test_depth_of_a_known_scene_is_metric_and_right(prepared: Prepared):
    scene = next(iter(sb.load_scenes("colmap", root=prepared.out)))
    assert [view.name for view in scene] == NAMES
    assert prepared.scale.is_metric
    for view, pose in zip(scene, POSES, strict=True):
        truth = true_depth(pose, pixel_rays(view.camera))
        filled = view.valid
        assert filled.mean() > 0.6
        error = np.abs(view.depth / truth - 1)[filled]
        assert np.median(error) < 0.01
        assert np.quantile(error, 0.9) < 0.03


def test_a_logo_neither_holds_the_cameras_nor_bends_the_lens(
    prepared: Prepared, tmp_path: Path
):
    assert not any("logo" in warning for warning in prepared.warnings)
    for name, pose in zip(NAMES[:4], POSES[:4], strict=True):
        marked = cv2.putText(
            photograph(pose), "DIVE 7 CAM 2", (6, 172), 0, 0.8, (255, 255, 255), 2
        )
        write(tmp_path / "photos" / name, marked)
    (tmp_path / "work").mkdir()
    found = mapping.map_photos(
        find_photos(tmp_path / "photos", None, 0, tmp_path)[0], tmp_path / "work", RULES
    )
    assert found.has_logo
    assert len(found.registered) == 4
    lens = read_model(found.model, tmp_path, distorted=True)[0].lens
    assert lens is not None
    assert lens.camera.K[0, 0] == pytest.approx(FOCAL, rel=0.02)


def test_masked_pixels_have_no_depth_and_photos_without_a_place_are_named(prepared: Prepared):
    scene = next(iter(sb.load_scenes("colmap", root=prepared.out)))
    assert not any(view.valid[:38, :52].any() for view in scene)
    assert (list(prepared.damaged), list(prepared.unplaced)) == (["cut.png"], ["else.png"])
    record = json.loads((prepared.out / "prepare.json").read_text())
    assert (list(record["damaged"]), list(record["unplaced"])) == (["cut.png"], ["else.png"])
    page = (prepared.out / "quality.html").read_text()
    for left_out in ("cut.png", "else.png"):
        assert sum(left_out in part for part in page.split("<h2>")) == 1
    assert page.count("<figure>") == len(NAMES)
    assert 'src="http' not in page
    assert "<link" not in page


def test_a_second_run_computes_nothing_again_and_may_change_the_scale(
    prepared: Prepared, photos: Path, monkeypatch: pytest.MonkeyPatch
):
    remove = shutil.rmtree

    def check(path: Path, **options: Any) -> None:
        assert path.parent != prepared.out, (
            "an old result is deleted before the new one is in its place"
        )
        remove(path, **options)

    monkeypatch.setattr(shutil, "rmtree", check)
    swept = sorted((prepared.out / ".prepare").rglob("0*.npy"))
    damaged = swept.pop()
    made = [*prepared.out.rglob("images/*/*.png"), *swept]
    before = {path: path.stat().st_mtime_ns for path in made}
    assert len(before) == 2 * len(NAMES) - 1
    whole = damaged.read_bytes()
    damaged.write_bytes(whole[:3000])
    depth = read_depth(prepared.out / "depths" / "dive 1" / "depth_photo 0.png")
    twice = prepare(
        photos / "photos",
        prepared.out,
        Options(masks=photos / "masks"),
        known_scale(factor=2 * prepared.scale.metres_per_unit),
    )
    assert {path: path.stat().st_mtime_ns for path in made} == before
    assert damaged.read_bytes() == whole, "a file that was cut short is made again"
    assert read_depth(
        prepared.out / "depths" / "dive 1" / "depth_photo 0.png"
    ) == pytest.approx(2 * depth, abs=0.0021)
    scene = next(iter(sb.load_scenes("colmap", root=twice.out)))
    centres = [
        np.linalg.inv(scene[name].cam_from_world)[:3, 3] for name in (NAMES[0], NAMES[3])
    ]
    assert np.linalg.norm(centres[0] - centres[1]) == pytest.approx(
        2 * np.linalg.norm(PLACES[3]), rel=1e-6
    )


@pytest.mark.parametrize(
    ("name", "value", "was"), [("depth_size", 300, "800"), ("focal", 1.0, "None")]
)
def test_other_options_are_refused_for_a_folder_made_before(
    name: str, value: Any, was: str, prepared: Prepared, photos: Path
):
    with pytest.raises(InputError, match=rf"{name}={was}, not {value}; .*--again"):
        prepare(
            photos / "photos",
            prepared.out,
            replace(Options(masks=photos / "masks"), **{name: value}),
        )


# -- the scale, as the command takes it ------------------------------------------------------------------


FAR = 10.0  # the made scene may as well be ten times as large


def given_again(
    prepared: Prepared, photos: Path, out: Path, *words: str
) -> tuple[float, dict[str, float], str]:
    """A copy of the result with the scale given by these words: metres by metres of truth, the record, what is said."""
    if not out.exists():
        shutil.copytree(prepared.out, out)
    line = [str(photos / "photos"), str(out), "--masks", str(photos / "masks"), *words]
    result = CliRunner().invoke(command, line, catch_exceptions=False)
    assert result.exit_code == 0
    view = next(iter(sb.load_scenes("colmap", root=out)))[NAMES[1]]
    truth = true_depth(POSES[1], pixel_rays(view.camera))
    record = json.loads((out / "prepare.json").read_text())
    return float(np.median((view.depth / truth)[view.valid])), record["scale"], result.output


def words_of_scale(how: str, tmp_path: Path, prepared: Prepared) -> list[str]:
    """What a user who knows the true scene, FAR times as large, would give."""
    if how == "length":
        view = next(iter(sb.load_scenes("colmap", root=prepared.out)))[NAMES[1]]
        at = [(135, 90), (172, 112)]
        rays = pixel_rays(view.camera)
        ends = [rays[v, u] * true_depth(POSES[1], rays)[v, u] for u, v in at]
        pixels = [str(p + 0.5) for point in at for p in point]
        return ["--length", NAMES[1], *pixels, str(FAR * np.linalg.norm(ends[0] - ends[1]))]
    down = np.array([0.3, 0.6, -0.74162])  # of length 1
    rows = [
        f"{name},{40 + FAR * place @ down:.4f}"
        for name, place in zip(NAMES, np.array(PLACES), strict=True)
    ]
    (tmp_path / "track.csv").write_text("\n".join(["image,depth", *rows]))
    return ["--depth-track", str(tmp_path / "track.csv")]


@pytest.mark.parametrize("how", ["length", "depth-track"])
def test_every_way_to_give_the_scale_makes_metres(
    how: str, prepared: Prepared, photos: Path, tmp_path: Path
):
    words = words_of_scale(how, tmp_path, prepared)
    ratio, scale, said = given_again(prepared, photos, tmp_path / "out", *words)
    assert ratio == pytest.approx(FAR, rel=0.02)
    assert scale["is_metric"]
    factor = scale["metres_per_unit"]
    assert factor == pytest.approx(FAR * prepared.scale.metres_per_unit, rel=0.02)
    assert f"{factor:.3g}"[:4] in said.partition("scale    ")[2].partition("\n")[0]
    assert float(said.partition("focal length ")[2].split()[0]) == pytest.approx(
        FOCAL / WIDTH, rel=0.03
    )
    left_out = [
        line.split(":")[0].split()[-1]
        for line in said.splitlines()
        if line.startswith("left out")
    ]
    assert left_out == ["cut.png", "else.png"]


def test_without_a_scale_the_one_of_before_is_kept_and_nothing_is_done_twice(
    prepared: Prepared, photos: Path, tmp_path: Path
):
    out = tmp_path / "out"
    before = given_again(prepared, photos, out, "--distance", NAMES[0], NAMES[3], "7")
    stamps = {path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()}
    again = given_again(prepared, photos, out)
    assert again[:2] == before[:2]
    assert {
        path: path.stat().st_mtime_ns for path in out.rglob("*") if path.is_file()
    } == stamps
    (out / "depths" / "dive 1" / "depth_photo 0.png").unlink()
    given_again(prepared, photos, out)
    assert (out / "depths" / "dive 1" / "depth_photo 0.png").is_file()


def test_a_scale_outlives_its_model_where_it_can(prepared: Prepared):
    lengths = known_scale(lengths=[("0.png", 1.5, 2.0, 3.0, 4.0, 0.25)])
    other = ("another", "model")
    metric, new = prepared.scale, known_scale(factor=3.0)
    for known in (lengths, known_scale(factor=2.0), known_scale(distances=[("a", "b", 3.0)])):
        before = replace(prepared, known=json.loads(json.dumps(known)))
        assert settled_scale(before, {}, prepared.keys) == (metric, known, True, ())
        assert settled_scale(before, known, prepared.keys)[0] == metric
        assert settled_scale(before, new, prepared.keys) == (None, new, False, ())
        moved = settled_scale(before, {}, other)
        if "distances" in known:
            assert moved == (None, known, True, ())
        else:
            assert moved[:3] == (None, {}, False)
            assert len(moved[3]) == 1


RULES = Options()


@pytest.fixture(scope="module")
def four(tmp_path_factory: pytest.TempPathFactory) -> tuple[list[Photo], mapping.Mapped]:
    """Four photos, and their model."""
    root = tmp_path_factory.mktemp("four")
    for i, pose in enumerate(POSES[:4]):
        write(root / "photos" / f"{i}.png", photograph(pose))
    photos, _ = find_photos(root / "photos", None, 0, root / "out")
    return photos, mapping.map_photos(photos, root / "out", RULES)


def test_equal_photos_give_an_equal_model_and_progress_counts_each_once_where_mapping_begins_again(
    four: tuple[list[Photo], mapping.Mapped], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    import pycolmap

    real = pycolmap.incremental_mapping

    def begins_again(*given: Any, **named: Any) -> Any:
        named["initial_image_pair_callback"]()
        named["next_image_callback"]()
        return real(*given, **named)

    monkeypatch.setattr(pycolmap, "incremental_mapping", begins_again)
    photos, straight = four
    with progress.watched_by(steps := Lines()):
        mapped = mapping.map_photos(photos, tmp_path / "out", RULES)
    assert steps.steps["placing photos"] == len(mapped.registered) == 4
    models = [
        [path.read_bytes() for path in sorted(one.model.glob("*.bin"))]
        for one in (mapped, straight)
    ]
    assert len(models[0]) >= 3
    assert models[0] == models[1]


def test_a_focal_length_is_held_and_the_rest_of_the_lens_is_found(
    four: tuple[list[Photo], mapping.Mapped], tmp_path: Path
):
    mapped = mapping.map_photos(four[0], tmp_path, replace(RULES, focal=0.9))
    assert len(mapped.registered) == 4
    lens = read_model(mapped.model, tmp_path, distorted=True)[0].lens
    assert lens is not None
    assert lens.camera.K[0, 0] == pytest.approx(0.9 * WIDTH, abs=1e-6)  # 0.906 is the true one
    assert lens.coefficients[0] == pytest.approx(DISTORTION[0], abs=0.02)


def test_mapping_starts_from_the_focal_length_in_exif_and_finds_the_true_one(tmp_path: Path):
    import pycolmap

    tags = Image.Exif()
    # in air; the port of a housing makes it 1.33 times longer
    tags.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = 24
    (tmp_path / "photos").mkdir()
    for i, pose in enumerate(POSES[:4]):
        Image.fromarray(photograph(pose)).save(
            tmp_path / "photos" / f"{i}.jpg", quality=95, exif=tags
        )
    found = find_photos(tmp_path / "photos", None, 0, tmp_path)[0]
    mapped = mapping.map_photos(found, tmp_path / "work", RULES)
    with pycolmap.Database.open(mapped.model.parent / "database.db") as opened:
        (camera,) = opened.read_all_cameras()
    assert camera.mean_focal_length() / WIDTH == pytest.approx(24 / 36, rel=0.05)
    outputs = {photo.output: photo for photo in found}
    undistort(
        outputs, mapped.model, tmp_path / "images", tmp_path / "masks", tmp_path / "pinhole"
    )
    assert is_jpeg(tmp_path / "images" / "0.png"), (
        "a method must know that its colours are a JPEG's"
    )
    lens = read_model(mapped.model, tmp_path, distorted=True)[0].lens
    assert lens is not None
    assert lens.camera.K[0, 0] == pytest.approx(FOCAL, rel=0.03)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["--focal", "24"], "24 is not from 0.2 to 10 widths"),
        (["--focal", "nan"], "nan is not from"),
        (["--focal", "1", "--model", "sparse"], "--model"),
    ],
)
def test_a_focal_length_that_no_camera_has_is_refused(
    words: list[str], fault: str, photos: Path, tmp_path: Path
):
    with pytest.raises(InputError, match="--focal") as refused:
        CliRunner().invoke(
            command,
            [str(photos / "photos"), str(tmp_path / "o"), *words],
            catch_exceptions=False,
        )
    assert fault in str(refused.value)
    assert not (tmp_path / "o").exists()


# -- stopped half-way ------------------------------------------------------------------------------------


class _StoppedError(Exception):
    """What stands for a Ctrl-C."""


def _stopping(real: Any, after: int) -> Callable[..., Any]:
    """A function that works so often, and then is stopped."""
    left = [after]

    def stopping(*given: Any, **named: Any) -> Any:
        if not left[0]:
            raise _StoppedError
        left[0] -= 1
        return real(*given, **named)

    return stopping


def test_a_command_stopped_in_features_or_matches_goes_on_and_finds_the_same(
    four: tuple[list[Photo], mapping.Mapped], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    import pycolmap

    monkeypatch.setattr(mapping, "PAIRS_A_STEP", 2)
    monkeypatch.setattr(mapping, "usable_cores", lambda: 1)
    photos, straight = four
    counts = []
    for name, calls in (
        ("extract_features", 2),
        ("extract_features", 1),
        ("match_image_pairs", 1),
    ):
        with monkeypatch.context() as stop:
            stop.setattr(pycolmap, name, _stopping(getattr(pycolmap, name), calls))
            with pytest.raises(PluginError, match="_StoppedError"):
                mapping.map_photos(photos, tmp_path / "two", RULES)
        with pycolmap.Database.open(tmp_path / "two" / "usual" / "database.db") as opened:
            found = sum(
                opened.num_keypoints_for_image(image.image_id) > 1
                for image in opened.read_all_images()
            )
            counts.append((found, opened.num_matched_image_pairs()))
    assert [found for found, _ in counts] == [2, 2, 4], "features that were found stay"
    assert counts[-1][1] == 2
    resumed = mapping.map_photos(photos, tmp_path / "two", RULES)
    assert resumed.registered == straight.registered
    with (
        pycolmap.Database.open(straight.model.parent / "database.db") as one,
        pycolmap.Database.open(tmp_path / "two" / "usual" / "database.db") as two,
    ):
        images = one.read_all_images()
        assert [image.name for image in images] == [
            image.name for image in two.read_all_images()
        ]
        for image in images:
            np.testing.assert_array_equal(
                one.read_keypoints(image.image_id), two.read_keypoints(image.image_id)
            )
        # Not to the match: neighbours are sought by an approximate index, on several threads.
        counts_of = [
            dict(zip(*base.read_two_view_geometry_num_inliers(), strict=True))
            for base in (one, two)
        ]
        assert counts_of[0] == pytest.approx(counts_of[1], abs=10)
    # what was mapped is not mapped again
    monkeypatch.setattr(pycolmap, "incremental_mapping", None)
    assert mapping.map_photos(photos, tmp_path / "two", RULES) == resumed


def test_a_command_stopped_while_writing_leaves_one_scale(
    prepared: Prepared, photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    out = tmp_path / "out"
    before, scale_before, _ = given_again(prepared, photos, out)
    line = [str(photos / "photos"), str(out), "--masks", str(photos / "masks"), "--scale", "7"]
    with monkeypatch.context() as stop:
        stop.setattr(result, "write_depth", _stopping(result.write_depth, 3))
        with pytest.raises(_StoppedError):
            CliRunner().invoke(command, line, catch_exceptions=False)
    view = next(iter(sb.load_scenes("colmap", root=out)))[NAMES[1]]
    other = next(iter(sb.load_scenes("colmap", root=prepared.out)))[NAMES[1]]
    assert np.array_equal(view.depth, other.depth)
    np.testing.assert_array_equal(view.cam_from_world, other.cam_from_world)
    after, scale, _ = given_again(prepared, photos, out, "--scale", "7")
    assert scale["metres_per_unit"] == 7
    assert after / before == pytest.approx(7 / scale_before["metres_per_unit"], rel=0.01)
    assert not list((out / ".prepare").rglob("old-*"))


def test_a_model_that_the_disk_cuts_short_is_an_error(prepared: Prepared, tmp_path: Path):
    import pycolmap

    model, unlimited = (
        pycolmap.Reconstruction(prepared.out / "sparse"),
        resource.getrlimit(resource.RLIMIT_FSIZE),
    )
    for size in (0, 4096):
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, unlimited[1]))
        try:
            with pytest.raises(OutputError, match="disk"):
                write_model(model, tmp_path)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, unlimited)
    write_model(model, tmp_path)
    assert len(read_shots(tmp_path)) == len(NAMES)


def test_without_its_notes_a_prepared_folder_is_refused_in_words(
    prepared: Prepared, photos: Path, tmp_path: Path
):
    shutil.copytree(prepared.out, tmp_path / "out", ignore=shutil.ignore_patterns(".prepare"))
    with pytest.raises(InputError, match=r"no \.prepare "):
        prepare(photos / "photos", tmp_path / "out", Options(masks=photos / "masks"))
