"""The eiffel_tower dataset against miniatures of its layout."""

import shutil
from pathlib import Path

import pytest
from support.miniatures import (
    YEAR as NAMES,
    check_dive,
    loader,
    one_line,
    write_photographs,
    write_year,
)

from sucre_bench.datasets.eiffel_tower import EiffelTower
from sucre_bench.errors import InputError

load = loader(EiffelTower)


def test_a_known_point_is_seen_where_it_is_in_undistorted_views(tmp_path: Path) -> None:
    write_year(tmp_path)
    check_dive(lambda **options: load(tmp_path, **options), tmp_path / "2015" / "depths")


def test_each_visit_is_a_scene_and_one_can_be_chosen(tmp_path: Path) -> None:
    write_year(tmp_path, "2018", ("a.jpg", "b.jpg"))
    write_year(tmp_path)
    scenes = list(EiffelTower(tmp_path).scenes())
    assert [(scene.name, [view.name for view in scene]) for scene in scenes] == [
        ("2015", list(NAMES)),
        ("2018", ["a.jpg", "b.jpg"]),
    ]
    assert (
        load(tmp_path, year="2018").data_id
        == scenes[1].data_id
        == load(tmp_path / "2018").data_id
    )
    with pytest.raises(InputError, match=r"2015"):
        load(tmp_path / "2018", year="2015")


@pytest.mark.parametrize(
    ("names", "places"),
    [
        (("2015_a.png", "2016_a.png"), ("2015/images/2015_a.png", "2016/images/2016_a.png")),
        (("2015/a.png", "2016/a.png"), ("2015/images/a.png", "2016/images/a.png")),
        (
            ("2015/images/a.png", "2016/images/a.png"),
            ("2015/images/a.png", "2016/images/a.png"),
        ),
        (
            ("2015_a.png", "2016_a.png"),
            ("global/images/2015_a.png", "global/images/2016_a.png"),
        ),
    ],
)
def test_images_of_the_global_model_are_found_in_their_years(
    tmp_path: Path, names: tuple[str, str], places: tuple[str, str]
) -> None:
    write_photographs(
        [tmp_path / place for place in places], tmp_path / "global" / "sfm", names
    )
    check_dive(
        lambda **options: load(tmp_path, year="global", **options),
        tmp_path / "global" / "depths",
    )
    scene = load(tmp_path, year="global")
    assert (scene.name, tuple(view.name for view in scene)) == ("global", names)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    for change, options, parts in [
        (lambda: write_year(tmp_path), {"year": "2016"}, ["2016/sfm: ", "folder"]),
        (
            lambda: shutil.rmtree(tmp_path / "2015" / "images"),
            {},
            [f"2015/images/{NAMES[0]}: ", "2 images"],
        ),
    ]:
        change()
        with one_line(*parts):
            load(tmp_path, **options)
