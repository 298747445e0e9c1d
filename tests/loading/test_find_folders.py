"""What loaders share: walks through links, hashes of files, grays of JPEGs, lengths."""

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.colmap_folder import picture, write_dive, write_image
from support.miniatures import (
    one_line,
    write_images,
    write_reef,
    write_set,
    write_survey,
    write_year,
)

from sucre_bench.datasets.colmap import Colmap
from sucre_bench.datasets.eiffel_tower import EiffelTower
from sucre_bench.datasets.metashape import Metashape
from sucre_bench.datasets.photos import Photos
from sucre_bench.datasets.seathru import Seathru
from sucre_bench.datasets.seathru_nerf import SeathruNerf
from sucre_bench.errors import InputError
from sucre_bench.imaging.image_files import decode
from sucre_bench.loading.depth_maps import find_depths
from sucre_bench.loading.find_folders import ImageFolder, folders_below, inside, walk
from sucre_bench.loading.image_folder import image_names
from sucre_bench.loading.view_files import fingerprint


def circle(root: Path) -> Path:
    """Folders a and b with links to each other and to the top, and a link to a that comes before it by name."""
    for name in "ab":
        write_image(root / name / "linearPNG" / f"{name}.png", picture(0))
        for other in "abc":
            (root / name / f"to_{other}").symlink_to(root / other if other != "c" else root)
    (root / "Latest").symlink_to(root / "a")
    return root


def test_links_in_a_circle_end_and_each_folder_is_there_once(tmp_path: Path) -> None:
    """Two links a folder, followed up to the 40 that the system allows, are more paths than can be walked."""
    circle(tmp_path)
    walked = [place.resolve() for place, _, _ in walk(tmp_path)]
    assert len(walked) == len(set(walked)) == 5
    assert list(folders_below(tmp_path, lambda place, _: place.name == "linearPNG")) == [
        tmp_path / "a/linearPNG",
        tmp_path / "a/to_b/linearPNG",
    ]
    assert image_names(tmp_path, subfolders=True) == [
        "a/linearPNG/a.png",
        "a/to_b/linearPNG/b.png",
    ]
    assert ImageFolder(tmp_path).find("a") == ["a/linearPNG/a.png"]
    assert find_depths(tmp_path, ["a/linearPNG/a.jpg"]) == {
        "a/linearPNG/a.jpg": tmp_path / "a/linearPNG/a.png"
    }
    assert len(list(Seathru(tmp_path).scenes())) == 2
    (scene,) = Photos(tmp_path, subfolders=True).scenes()
    assert len(scene) == 2


@pytest.mark.parametrize(
    ("plugin", "write", "files", "folders"),
    [
        (Colmap, write_dive, ["images", "sparse", "depths", "reference"], ["charts"]),
        (EiffelTower, write_year, ["depths"], []),
        (Metashape, write_survey, ["images", "depths"], []),
        (Photos, lambda root: write_images(root, "a.png"), ["reference"], ["charts"]),
        (Seathru, write_set, ["sparse"], ["charts"]),
        (SeathruNerf, write_reef, ["depths"], []),
    ],
)
def test_what_an_option_names_must_be_there_and_of_its_kind(
    tmp_path: Path,
    plugin: Callable[..., Colmap],
    write: Callable[[Path], Path],
    files: list[str],
    folders: list[str],
) -> None:
    """Otherwise the dataset would load without it, silently."""
    root = tmp_path / "dive"
    root.mkdir()
    write(root)
    place = root / "2015" if plugin is EiffelTower else root
    for option in (*files, *folders):
        chosen = place / f"my_{option}"
        scenes = plugin(root, **{option: chosen.name}).scenes
        said = f"{chosen}: ", f"dataset.{option}={chosen.name}"
        with one_line(*said):
            list(scenes())
        chosen.touch() if option in files else chosen.mkdir()
        with one_line(*said):
            list(scenes())


def test_a_folder_in_ones_home_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    root = write_dive(tmp_path / "dive")
    for name in ("images", "sparse", "depths"):
        (root / name).rename(tmp_path / f"my_{name}")
    (scene,) = Colmap(
        root, images="~/my_images", sparse="~/my_sparse", depths="~/my_depths"
    ).scenes()
    assert scene.has == {"poses", "depth"}
    assert scene["a.png"].rgb.shape == picture(0).shape
    with pytest.raises(InputError, match="~no_such_user"):
        list(Colmap(root, depths="~no_such_user").scenes())


@pytest.mark.parametrize(
    ("named", "found"),
    [
        ("b.png", "sub/b.png"),
        ("../b.png", "b.png"),
        ("a\\..\\b.png", "sub/b.png"),
        ("../../b.png", None),
        ("..", None),
        ("/etc/b.png", None),
        ("C:/b.png", None),
        ("b\0.png", None),
    ],
)
def test_a_named_path_is_inside_or_it_is_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: str, found: str | None
) -> None:
    monkeypatch.chdir(tmp_path)
    for root in (tmp_path, Path(), Path("x/..")):
        assert inside(root, root / "sub", named) == (None if found is None else Path(found))


def changed(path: Path, at: int) -> bytes:
    """The fingerprint after the byte there changed; the file is as before then."""
    content = path.read_bytes()
    path.write_bytes(content[:at] + bytes([content[at] ^ 1]) + content[at:][1:])
    after = fingerprint(path)
    path.write_bytes(content)
    return after


def test_a_fingerprint_is_of_all_of_a_small_file_and_of_blocks_of_a_large_one(
    tmp_path: Path,
) -> None:
    small, large = tmp_path / "small.tif", tmp_path / "large.tif"
    small.write_bytes(np.random.default_rng(0).bytes(1 << 20))
    large.write_bytes(np.random.default_rng(1).bytes(3 << 20))
    for path in (small, large):
        own = fingerprint(path)
        os.utime(path, (0, 0))
        assert fingerprint(path) == own, "whatever its date"
    assert all(
        changed(small, at) != fingerprint(small) for at in (0, 5000, 500_000, (1 << 20) - 1)
    )
    own, size = fingerprint(large), 3 << 20
    assert all(changed(large, (size - 4096) * i // 15 + 100) != own for i in range(16)), (
        "sixteen even distances"
    )
    assert changed(large, 0) != own != changed(large, size - 1)
    assert changed(large, 10_000) == own, "the limit that is documented"
    large.write_bytes(large.read_bytes() + b"x")
    assert fingerprint(large) != own
    assert fingerprint(tmp_path / "none.tif") == b"unreadable"


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_a_gray_read_is_gray_whatever_the_format(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a{suffix}"
    colour = np.full((16, 24, 3), (30, 60, 200), np.uint8)
    assert cv2.imwrite(str(path), colour)
    gray = decode(path, cv2.IMREAD_GRAYSCALE)
    assert gray.shape == (16, 24)
    np.testing.assert_allclose(gray, 0.114 * 30 + 0.587 * 60 + 0.299 * 200, atol=3)
    np.testing.assert_allclose(decode(path, cv2.IMREAD_COLOR), colour, atol=4)
