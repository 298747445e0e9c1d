"""The seathru_nerf dataset against miniatures of its layout."""

from pathlib import Path

import numpy as np
from support.colmap_folder import picture, write_image, write_model
from support.miniatures import (
    CAMERA,
    HEIGHT,
    REEF as NAMES,
    WIDTH,
    check_dive,
    loader,
    model_pose,
    write_reef,
)

from sucre_bench.datasets.seathru_nerf import SeathruNerf

load = loader(SeathruNerf)


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
    assert [view.name for view in scenes[1]] == [name.replace(".png", ".PNG") for name in NAMES]
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
    assert [view.name for view in load(tmp_path, split="test")] == [
        "00.png",
        "08.png",
        "16.png",
    ]
    train = [view.name for view in load(tmp_path, split="train")]
    assert len(train) == 15
    assert not {"00.png", "08.png", "16.png"} & set(train)
