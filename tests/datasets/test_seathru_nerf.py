"""The seathru_nerf dataset against miniatures of its layout."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import picture, write_image, write_model
from support.miniatures import (
    CAMERA,
    HEIGHT,
    REEF as NAMES,
    WIDTH,
    check_dive,
    model_pose,
    write_reef,
)

from sucre_bench.datasets.seathru_nerf import SeathruNerf
from sucre_bench.errors import InputError
from sucre_bench.scene import Scene


def load(root: Path, **options: object) -> Scene:
    (scene,) = SeathruNerf(root, **options).scenes()
    return scene


def test_a_known_point_is_seen_where_it_is_in_undistorted_views(tmp_path: Path) -> None:
    write_reef(tmp_path / "Panama", units=4.0)
    check_dive(
        lambda **options: load(tmp_path, metres_per_unit=4.0, **options),
        tmp_path / "Panama" / "depths",
    )
    scene = load(tmp_path)
    assert (scene.name, {view.encoding for view in scene}) == ("Panama", {"linear"})
    assert scene.data_id != load(tmp_path, encoding="gamma").data_id


def test_layouts_of_each_reef_and_of_copies_are_found(tmp_path: Path) -> None:
    write_reef(tmp_path / "IUI3-RedSea", "Images_wb")
    write_reef(tmp_path / "Panama", sparse="colmap/sparse/0")
    write_reef(tmp_path / "Undistorted", "images", "sparse")
    for path in (tmp_path / "Panama" / "images_wb").iterdir():
        path.rename(path.with_suffix(".PNG"))  # the model says .png
    scenes = list(SeathruNerf(tmp_path).scenes())
    assert [scene.name for scene in scenes] == ["IUI3-RedSea", "Panama", "Undistorted"]
    assert [view.name for view in scenes[1]] == list(NAMES)
    np.testing.assert_array_equal(scenes[1].views[0].rgb, scenes[0].views[0].rgb)


def test_every_eighth_image_from_the_first_is_the_test(tmp_path: Path) -> None:
    names = [f"{i:02d}.png" for i in range(18)]
    for name in names:
        write_image(tmp_path / "images_wb" / name, picture(0, WIDTH, HEIGHT))
    write_model(
        tmp_path / "sparse",
        [(name, model_pose(np.eye(4)), 1) for name in reversed(names)],
        [CAMERA],
    )
    assert [view.name for view in load(tmp_path, split="test")] == ["00.png", "08.png", "16.png"]
    train = [view.name for view in load(tmp_path, split="train")]
    assert len(train) == 15
    assert not {"00.png", "08.png", "16.png"} & set(train)


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    place = write_reef(tmp_path / "Panama")
    with pytest.raises(InputError, match="Panama/maps: "):
        load(tmp_path, depths="maps")
    shutil.rmtree(place / "sparse")
    with pytest.raises(InputError, match="Panama/sparse: "):
        load(tmp_path)


def test_a_unit_of_no_length_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"seathru_nerf\.metres_per_unit"):
        SeathruNerf(tmp_path, metres_per_unit=0)
