"""sucre-bench describe: what it says of a made scene, and that it finds what was made wrong in it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from support.colmap_folder import write_dive
from support.command_line import Done
from support.made_ground import WATERS, make_ground
from support.made_scene import TILTED, make_scene, painted
from support.messages import refused

from sucre_bench.camera import pixel_rays
from sucre_bench.commands.data import describe
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.imaging.image_files import is_jpeg
from sucre_bench.multiview.geometry_faults import Fault, first_look
from sucre_bench.multiview.overlaps import overlaps
from sucre_bench.multiview.spread import Spread, spread_of
from sucre_bench.programs.describe.facts import look_at, placed
from sucre_bench.programs.describe.faults import find_faults
from sucre_bench.scene import Arrays, Chart, View

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # from OpenCV axes to those of OpenGL


def found(views: Sequence[View]) -> list[Fault]:
    looks = [look_at(view, False) for view in views]
    return find_faults(looks, overlaps(placed(looks)))


def kinds(views: Sequence[View]) -> list[tuple[str, ...]]:
    """Of each fault: its kind, and its views."""
    return [(fault.kind, *fault.views) for fault in found(views)]


def with_planes(
    view: View, rgb: np.ndarray | None = None, depth: np.ndarray | None = None
) -> View:
    return replace(
        view,
        pixels=Arrays(view.rgb if rgb is None else rgb, view.depth if depth is None else depth),
    )


def test_a_consistent_scene_has_no_faults_and_its_facts_are_true() -> None:
    views = make_scene().views
    looks = [look_at(view, False) for view in views]
    assert find_faults(looks, overlaps(placed(looks))) == []
    assert "measure" in first_look(views)
    facts = [look.facts for look in looks]
    target = views[1]
    assert (facts[1].width, facts[1].height) == (60, 44)
    assert facts[1].coverage == pytest.approx(1 - 6 * 40 / (60 * 44))
    known = target.distance[target.depth > 0]
    assert facts[1].distances == pytest.approx(np.percentile(known, [1, 50, 99]), rel=1e-5)
    assert facts[3].position == pytest.approx((-0.3, 0.1, -2.4))
    between = overlaps(placed(looks))
    assert [o.partners for o in between] == [3, 3, 3, 3]
    assert [o.seen for o in between[:2]] == [1, 1]
    assert between[2].seen < 0.7, "the side view looks past the others"
    assert max(o.disagreement or 0 for o in between) < 0.01


@pytest.mark.parametrize(
    ("spoil", "kind"),
    [
        (
            lambda v: replace(v, cam_from_world=np.linalg.inv(v.cam_from_world)),
            "inverted poses",
        ),
        (
            lambda v: replace(v, cam_from_world=FLIP @ v.cam_from_world),
            "OpenGL poses",
        ),
        (lambda v: with_planes(v, depth=v.depth * 2.5), "unit of depth"),
        (lambda v: with_planes(v, depth=v.depth / 1000), "unit of depth"),
        (
            lambda v: with_planes(
                v, depth=v.depth * np.linalg.norm(pixel_rays(v.camera), axis=-1)
            ),
            "distance for depth",
        ),
        (
            lambda v: with_planes(v, depth=3 / np.where(v.depth > 0, v.depth, np.inf)),
            "inverse depth",
        ),
        (lambda v: with_planes(v, depth=v.depth[::-1].copy()), "turned depth maps"),
        (lambda v: with_planes(v, depth=v.depth[:, ::-1].copy()), "turned depth maps"),
        (
            lambda v: replace(v, cam_from_world=FLIP @ np.linalg.inv(v.cam_from_world) @ FLIP),
            "inverted poses",
        ),
        (
            lambda v: replace(v, cam_from_world=FLIP @ np.linalg.inv(v.cam_from_world)),
            "inverted poses",
        ),
    ],
)
def test_what_makes_depth_and_poses_disagree_is_named(
    spoil: Callable[[View], View], kind: str
) -> None:
    views = [spoil(view) for view in make_scene().views]
    (fault,) = [fault for fault in found(views) if fault.kind == kind]
    assert first_look(views) == str(fault), "before a run, too"


def test_one_view_with_a_wrong_pose_is_named_among_good_ones() -> None:
    views = list(make_scene().views)
    shifted = np.array(views[2].cam_from_world)
    shifted[2, 3] += 0.6
    views[2] = replace(views[2], cam_from_world=shifted)
    views += [
        replace(view, name=f"again-{view.name}", pixels=_moved(view))
        for view in (views[0], views[1], views[3])
    ]
    (fault,) = [f for f in found(views) if f.kind == "view disagrees"]
    assert fault.views == ("side.png",)


def _moved(view: View) -> Arrays:
    """The same depth under another picture, and not to the bit."""
    return Arrays(1 - view.rgb, view.depth * np.float32(1.0001))


@pytest.mark.parametrize(
    ("spoil", "kind"),
    [
        (np.zeros_like, "black"),
        (lambda rgb: np.full_like(rgb, 0.4), "one colour"),
        (lambda rgb: np.repeat(rgb[..., :1], 3, -1), "grey"),
        (lambda rgb: rgb * np.array([0, 1, 1], np.float32), "empty channel"),
        (lambda rgb: (rgb * 3).clip(0, 1), "saturated"),
        (lambda rgb: rgb * np.float32(0.12), "dark"),
    ],
)
def test_an_image_without_much_to_see_is_named(
    spoil: Callable[[np.ndarray], np.ndarray], kind: str
) -> None:
    views = list(make_scene().views)
    views[1] = with_planes(views[1], rgb=spoil(views[1].rgb))
    assert kinds(views) == [(kind, "a.png")]


def test_dark_views_of_a_dive_are_no_twins() -> None:
    views = make_scene().views
    dark = [with_planes(view, rgb=view.rgb * np.float32(0.02)) for view in views]
    assert not [kind for kind, *_ in kinds(dark) if "twin" in kind]


def test_missing_poses_and_depth_and_twins_are_named() -> None:
    views = list(make_scene().views)
    bare = replace(views[0], pixels=Arrays(views[0].rgb), cam_from_world=None)
    assert kinds([bare, *views[1:]]) == [("no pose", "near.png"), ("no depth", "near.png")]
    assert kinds([*views, replace(views[1], name="copy.png")]) == [
        ("twins", "a.png", "copy.png")
    ]
    twins = [replace(views[1], name=f"{n}.png", pixels=_moved(views[1])) for n in range(2)]
    painted_alike = [
        with_planes(view, rgb=views[1].rgb, depth=view.depth * (1 + n / 1000))
        for n, view in enumerate(twins)
    ]
    assert kinds([*views, *painted_alike]) == [("twin pictures", "a.png", "0.png", "1.png")]


def test_a_view_that_no_other_overlaps_and_one_with_little_depth_are_named() -> None:
    views = list(make_scene().views)
    away = np.array(views[0].cam_from_world)
    away[0, 3] += 80
    assert ("view alone", "near.png") in kinds(
        [*views[1:], replace(views[0], cam_from_world=away)]
    )
    views[1] = with_planes(views[1], depth=np.where(np.arange(60) < 9, views[1].depth, 0))
    assert ("little depth", "a.png") in kinds(views)


def test_a_chart_begun_at_the_wrong_corner_is_named() -> None:
    rgb = (0.1 + 0.6 * painted(chart_kind("dgk"), TILTED)).astype(np.float32)
    wrong = Chart("chart1", "dgk", np.roll(TILTED, 2, axis=0))
    (fault,) = (
        f for f in found([View("c.png", Arrays(rgb), charts=(wrong,))]) if f.kind == "chart"
    )
    assert fault.views == ("c.png",)
    assert re.match("chart1: .*bottom right .*top left", fault.what)


# -- the command -------------------------------------------------------------------------------------------------


def run(*words: str) -> tuple[int, str]:
    result = CliRunner().invoke(describe, list(words), catch_exceptions=False)
    return result.exit_code, result.stdout


def test_a_folder_is_described_with_its_broken_views_and_a_sheet(tmp_path: Path) -> None:
    root = write_dive(tmp_path / "dive", ["a.png", "b.png", "c.png", "d.png"])
    (root / "images" / "b.png").write_bytes(b"no picture")
    cv2.imwrite(str(root / "depths" / "depth_c.png"), np.full((20, 90), 2000, np.uint16))
    sheet = tmp_path / "sheet.png"
    code, said = run("colmap", f"dataset.root={root}", "--sheet", str(sheet))
    assert code == 0
    assert re.search("scene .*dive of colmap: 4 of 4 views; .*depth, poses", said)
    assert re.search(r"wrong .*b\.png: .*b\.png", said)
    assert re.search(r"wrong .*c\.png: .* 90x20, .* 40x30; ", said)
    picture = cv2.imread(str(sheet))
    assert picture.shape[1] > 1000
    assert picture.std() > 30


def test_a_mistake_made_in_many_files_is_one_line(tmp_path: Path) -> None:
    root = write_dive(tmp_path / "dive", ["a.png", "b.png", "c.png"])
    for number, name in enumerate("abc", 1):
        path = root / "depths" / f"depth_{name}.png"
        path.unlink()
        np.save(path.with_suffix(".npy"), np.full((30, 40), -1.25 * number, np.float32))
    said = run("colmap", f"dataset.root={root}", "--no-sheet")[1]
    wrong = [line for line in said.splitlines() if "negative" in line]
    first = root / "depths" / "depth_a.npy"
    assert len(wrong) == 1
    assert re.match(
        rf"wrong .*a\.png, b\.png, c\.png: .*-1\.25 m .*\(first in {re.escape(str(first))}\); .*\b0\b",
        wrong[0],
    )


def test_an_arbitrary_scale_that_prepare_noted_is_not_called_metres(tmp_path: Path) -> None:
    root = write_dive(tmp_path / "dive")
    sheet = tmp_path / "sheet.jpg"
    words = ("colmap", f"dataset.root={root}", "--sheet", str(sheet), "--force")
    assert "m (1, 50, 99 %)" in run(*words)[1]
    (root / "prepare.json").write_text(
        json.dumps({"scale": {"is_metric": False, "note": "arbitrary: of 3"}})
    )
    said = run(*words)[1]
    assert "arbitrary: of 3" in said
    assert "units (1, 50, 99 %)" in said
    assert " m " not in said
    assert is_jpeg(sheet)
    (scene,) = json.loads(run(*words, "--json")[1])
    assert (scene["unit"], scene["scale"]) == (
        "units",
        {"is_metric": False, "note": "arbitrary: of 3"},
    )
    (root / "prepare.json").write_text("[1]")  # another program's
    assert "m (1, 50, 99 %)" in run(*words)[1]


@pytest.mark.parametrize(("name", "named"), [("sheet.foo", "sheet.foo"), ("", "folder")])
def test_a_sheet_that_cannot_be_is_refused_before_anything_is_read(
    tmp_path: Path, name: str, named: str
) -> None:
    with refused(named):
        run("colmap", "dataset.root=nowhere", "--sheet", str(tmp_path / name))


def test_a_scene_of_which_nothing_can_be_read_is_an_error(tmp_path: Path) -> None:
    root = write_dive(tmp_path / "dive", ["a.png"])
    (root / "images" / "a.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match=r"^describe: "):
        run("colmap", f"dataset.root={root}", "--no-sheet")


def test_an_image_that_is_not_its_cameras_is_named_with_both_sizes() -> None:
    views = list(make_scene().views)
    views[1] = replace(views[1], pixels=Arrays(views[1].rgb[:20]))
    (fault,) = [fault for fault in found(views) if fault.kind == "file"]
    assert re.search("60x20, .*60x44", fault.what)


Bench = Callable[..., Done]


def spread(*heights_m: float) -> Spread:
    found = spread_of(
        make_ground(WATERS["coast"], heights_m=heights_m, width=60, height=45).views
    )
    assert found
    return found


@pytest.mark.parametrize(
    ("heights_m", "ratio"), [((3, 3, 3), 1.0), ((3, 3.6, 3), 1.2), ((2, 3, 4), 2.0)]
)
def test_the_ratio_is_that_of_the_heights(heights_m: tuple[float, ...], ratio: float) -> None:
    assert spread(*heights_m).ratio == pytest.approx(ratio, rel=0.1)


def test_one_height_over_flat_ground_cannot_measure_the_water() -> None:
    assert "cannot be measured" in spread(3, 3, 3).sentence()
    assert "dive_gray_world" in spread(3, 3, 3).sentence()
    assert "unlike enough" in spread(2, 3, 4).sentence()


def test_describe_and_run_say_it_first_and_a_prepared_scene_needs_no_prepare(
    tmp_path: Path, bench: Bench
) -> None:
    dive = write_dive(tmp_path / "dive")
    (dive / "prepare.json").write_text(
        json.dumps({"scale": {"is_metric": True, "note": "given"}})
    )
    for depth in (dive / "depths").iterdir():
        depth.write_bytes((depth.parent / "depth_a.png").read_bytes())
    done = bench("describe", "./dive", "--no-sheet")
    assert "measure" in done.stdout
    assert "sucre-bench prepare" not in done.stdout
    quiet = ("report=false", "tracking.uri=off", "workers=0")
    words = ("dataset=./dive", "metrics=[coverage]", *quiet)
    of_several_views = bench("run", *words, "method=stitching", "out=a")
    assert "the water" in of_several_views.stderr
    assert "the water" not in bench("run", *words, "method=gray_world", "out=b").stderr
