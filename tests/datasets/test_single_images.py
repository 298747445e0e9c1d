"""The datasets of single images - photos, uieb, lsui, u45 - against miniatures of their layouts."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import HEIGHT, WIDTH, picture, write_image
from support.made_scene import TILTED, painted
from support.messages import names, refused
from support.miniatures import check_message, one_line, write_images

import sucre_bench as sb
from sucre_bench.datasets.photos import U45, Lsui, Photos, Uieb
from sucre_bench.errors import InputError
from sucre_bench.imaging.chart_kinds import chart_kind
from sucre_bench.loading import named_sets
from sucre_bench.loading.named_sets import Member, NamedSet, print_of
from sucre_bench.scene import Scene


def only(plugin: Photos | Uieb | Lsui | U45) -> Scene:
    (scene,) = plugin.scenes()
    return scene


def same(plane: np.ndarray | None, seed: int) -> None:
    np.testing.assert_array_equal(np.rint(plane * 255), picture(seed))


def test_photos_are_views_without_depth_or_camera(tmp_path: Path) -> None:
    root = write_images(tmp_path / "dive", "b.png", "a.tif", ".hidden.png", "sub/c.png")
    (root / "notes.txt").write_text("no image")
    scene = only(Photos(root, encoding="linear"))
    assert (scene.name, scene.has, [view.name for view in scene]) == (
        "dive",
        frozenset(),
        ["a.tif", "b.png"],
    )
    view = scene["b.png"]
    same(view.rgb, 0)
    assert view.camera is None
    assert view.encoding == "linear"
    assert view.valid.all()
    half = only(Photos(root, image_scale=0.5))
    assert half.views[0].rgb.shape == (HEIGHT // 2, WIDTH // 2, 3)
    assert half.data_id != scene.data_id
    with pytest.raises(InputError, match=r"image_scale=0\.02: makes 1x1"):
        only(Photos(root, image_scale=0.02))
    assert [view.name for view in only(Photos(root, subfolders=True))] == [
        "a.tif",
        "b.png",
        "sub/c.png",
    ]


def test_photos_have_references_of_the_same_path(tmp_path: Path) -> None:
    write_images(tmp_path, "1.png", "2.jpg", "sub/1.png")
    write_images(tmp_path / "reference", "1.png", "2.png", "sub/1.png", seed=10)
    scene = only(Photos(tmp_path, subfolders=True))
    assert ([view.name for view in scene], scene.has) == (
        ["1.png", "2.jpg", "sub/1.png"],
        {"reference"},
    )
    for view, seed in zip(scene, (10, 11, 12), strict=True):
        same(view.reference, seed)
    (tmp_path / "reference").rename(tmp_path.with_name("truth"))
    same(only(Photos(tmp_path, reference="../truth"))["2.jpg"].reference, 11)
    assert only(Photos(tmp_path)).has == frozenset()


def write_chart(folder: Path, *names: str) -> None:
    """Photographs that show a chart in its own colours, one among stones, and where it lies."""
    image = np.rint(255 * painted(chart_kind("dgk"), TILTED)).astype(np.uint8)
    for name in names:
        write_image(folder / name, image)
    marked = {name: {"chart1": TILTED.tolist()} for name in names}
    (folder / "charts.json").write_text(json.dumps({"kind": "dgk", "images": marked}))


def test_photos_have_colour_charts_that_are_measured(tmp_path: Path) -> None:
    write_chart(tmp_path, "a.png", "sub/b.png")
    scene = only(Photos(tmp_path, subfolders=True))
    assert scene.has == {"charts"}
    for view in scene:
        (chart,) = view.charts
        np.testing.assert_allclose(chart.corners, TILTED)
        rows = sb.score(sb.Restoration(view.rgb), view, metrics=["psi"])
        # the chart in its own colours
        assert rows.loc[rows["region"] == "chart1", "value"].item() < 0.2
    half = only(Photos(tmp_path, subfolders=True, image_scale=0.5))
    np.testing.assert_allclose(half.views[0].charts[0].corners, TILTED / 2)
    (tmp_path / "charts.json").rename(tmp_path / "marked.json")
    assert only(Photos(tmp_path, subfolders=True)).has == frozenset()
    assert only(Photos(tmp_path, subfolders=True, charts="marked.json")).has == {"charts"}


def test_a_wrong_reference_harms_its_view_only(tmp_path: Path) -> None:
    write_images(tmp_path, "1.png", "2.png", "3.png", "4.png")
    truth = write_images(tmp_path / "reference", "1.png", "2.tif", "2.jpg")
    write_image(truth / "4.png", picture(0, WIDTH, HEIGHT // 2))
    scene = only(Photos(tmp_path))
    same(scene["1.png"].reference, 0)
    for name, parts in [
        ("2.png", ["2.jpg", "2.tif", "keep"]),
        ("3.png", ["3.png", "copy"]),
        ("4.png", ["40x15", "40x30"]),
    ]:
        with one_line(str(truth), *parts):
            _ = scene[name].reference
        assert scene[name].rgb.shape == (HEIGHT, WIDTH, 3)


def test_uieb_pairs_by_name_also_where_archives_unpacked_twice(tmp_path: Path) -> None:
    write_images(tmp_path / "UIEB" / "raw-890" / "raw-890", "1_img_.png", "2_img_.png")
    write_images(tmp_path / "UIEB" / "reference-890", "1_img_.png", "2_img_.png", seed=5)
    write_images(tmp_path / "UIEB" / "challenging-60", "9.png")
    scene = only(Uieb(tmp_path))
    assert (scene.name, scene.has) == ("paired", {"reference"})
    assert [view.name for view in scene] == ["1_img_.png", "2_img_.png"]
    same(scene["2_img_.png"].rgb, 1)
    same(scene["2_img_.png"].reference, 6)
    hard = only(Uieb(tmp_path / "UIEB", subset="challenging"))
    assert (hard.name, hard.has, [view.name for view in hard]) == (
        "challenging",
        frozenset(),
        ["9.png"],
    )


def test_lsui_has_a_scene_for_each_part(tmp_path: Path) -> None:
    for part, seed in (("test", 0), ("train", 20)):
        write_images(tmp_path / part / "input", "1.png", seed=seed)
        write_images(tmp_path / part / "GT", "1.png", seed=seed + 7)
    scenes = list(Lsui(tmp_path).scenes())
    assert [scene.name for scene in scenes] == ["test", "train"]
    same(scenes[1]["1.png"].rgb, 20)
    same(scenes[1]["1.png"].reference, 27)
    assert only(Lsui(tmp_path / "test")).data_id == scenes[0].data_id


def test_of_lsui_only_the_part_that_has_the_named_set_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for part, seed in (("test", 0), ("train", 20)):
        for folder in ("input", "GT"):
            write_images(tmp_path / part / folder, "1.png", "2.png", seed=seed)
    views = only(Lsui(tmp_path / "train")).views
    members = [
        Member(f"m{k}", (), None, print_of(view.rgb), None) for k, view in enumerate(views)
    ]
    mine = NamedSet("mine", "", "", "", "", "", tuple(members))
    monkeypatch.setattr(named_sets, "named_sets", lambda: {"mine": mine})
    scene = only(Lsui(tmp_path, split="mine"))
    assert (scene.name, scene.data_id) == (
        "mine",
        only(Lsui(tmp_path / "train", split="mine")).data_id,
    )
    write_images(tmp_path / "u45" / "input", "1.png")  # of another set, without references
    assert only(Lsui(tmp_path, split="mine")).name == "mine"
    (tmp_path / "train" / "input" / "2.png").unlink()
    with refused("1", "2", "m1", str(tmp_path / "train" / "input")):
        list(Lsui(tmp_path, split="mine").scenes())


def test_u45_is_found_beside_results_of_others(tmp_path: Path) -> None:
    write_images(tmp_path / "upload" / "U45" / "U45", "1.png", "2.png")
    write_images(tmp_path / "upload" / "FGAN", "1.png")
    scene = only(U45(tmp_path))
    assert (scene.name, scene.has, [view.name for view in scene]) == (
        "U45",
        frozenset(),
        ["1.png", "2.png"],
    )
    assert only(U45(tmp_path / "upload" / "U45" / "U45")).data_id == scene.data_id


@pytest.mark.parametrize(
    ("make", "there", "named"),
    [
        (Photos, ["a.png", "reference/b.png"], "a.png"),
        (Uieb, ["raw-890/1.png"], "reference-890"),
        (Uieb, ["raw-890/1.png", "reference-890/2.png"], "reference-890"),
        (
            lambda root: Uieb(root, subset="challenging"),
            ["raw-890/1.png"],
            "challenging-60",
        ),
        (Lsui, ["GT/1.png"], "folder"),
        (Lsui, ["input/1.png"], "GT"),
        (U45, ["other/1.png"], "U45"),
    ],
)
def test_what_is_missing_is_named(
    tmp_path: Path,
    make: Callable[[Path], Photos | Uieb | Lsui | U45],
    there: list[str],
    named: str,
) -> None:
    write_images(tmp_path, *there)
    with pytest.raises(InputError) as fault:
        only(make(tmp_path))
    check_message(str(fault.value), str(tmp_path))
    assert named in names(fault.value)
