"""Cameras and errors."""

from __future__ import annotations

import errno
import importlib
import os
import pickle
import pkgutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import sucre_bench
from sucre_bench import Camera, results
from sucre_bench.camera import distance_map, pixel_rays, project, relative_pose, unproject
from sucre_bench.errors import (
    DamagedFileError,
    DiedError,
    FileError,
    ForbiddenFileError,
    MissingFileError,
    NotAFileError,
    SucreBenchError,
    file_error,
)
from sucre_bench.imaging.image_files import read_array, read_rgb
from sucre_bench.loading.depth_maps import read_depth
from sucre_bench.results.restorations import read_mask

pytestmark = pytest.mark.short
# Of the classes with parameters of their own.
EXAMPLES: dict[type[SucreBenchError], SucreBenchError] = {
    DiedError: DiedError("exit code 7", "method 'a' on view 'b.png'"),
}


def every_class(of: type[SucreBenchError] = SucreBenchError) -> Iterator[type[SucreBenchError]]:
    yield of
    for below in of.__subclasses__():
        yield from every_class(below)


def test_every_error_comes_whole_out_of_another_process():
    for room in ("compare", "engine", "machine", "programs"):
        package = importlib.import_module(f"sucre_bench.{room}")
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            if not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    classes = [
        cls for cls in every_class() if cls.__module__.startswith(f"{sucre_bench.__name__}.")
    ]
    assert len(classes) > len(EXAMPLES)
    for cls in classes:
        fault = EXAMPLES.get(cls) or cls("is damaged", "a.png", "copy it again")
        again = pickle.loads(pickle.dumps(fault))
        assert (type(again), str(again), vars(again)) == (cls, str(fault), vars(fault))


READERS: dict[str, Callable[[Path], object]] = {
    "a.png": read_rgb,
    "a.jpg": read_rgb,
    "a.npy": read_array,
    "depth.tif": read_depth,
    "depth.npy": read_depth,
    "mask.png": read_mask,
    "scores.parquet": lambda path: results.read(path.parent),
}


@pytest.mark.parametrize("name", READERS)
def test_the_class_tells_a_file_that_is_gone_from_a_damaged_one(tmp_path: Path, name: str):
    path, read = tmp_path / name, READERS[name]
    with pytest.raises(MissingFileError, match=name):
        read(path)
    path.write_bytes(b"\x00damaged" * 20)
    with pytest.raises(DamagedFileError, match=name) as fault:
        read(path)
    assert Path(fault.value.place) == path
    assert fault.value.remedy


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.ENOENT, MissingFileError),
        (errno.EACCES, ForbiddenFileError),
        (errno.EPERM, ForbiddenFileError),
        (errno.EISDIR, NotAFileError),
        (errno.EMFILE, FileError),
        (errno.EIO, FileError),
        (errno.ESTALE, FileError),
        (None, DamagedFileError),
    ],
)
def test_only_an_error_about_the_content_calls_a_file_damaged(
    number: int | None, kind: type[FileError]
):
    fault = OSError("broken header") if number is None else OSError(number, os.strerror(number))
    found = file_error("a.png", fault, "copy it again")
    assert type(found) is kind
    assert (found.place, found.remedy) == ("a.png", "copy it again")


def test_an_error_of_a_file_inside_another_names_both_and_keeps_its_remedy():
    fault = FileError("is cut short", "a.png", "copy it again").within("dive.zip")
    assert (fault.place, fault.without_remedy, fault.remedy) == (
        "dive.zip",
        "dive.zip: a.png: is cut short",
        "copy it again",
    )


def test_an_error_of_a_file_has_its_parts_as_data():
    fault = FileError("is cut short", Path("dive/a.png"), "copy it again")
    assert str(fault) == "dive/a.png: is cut short; copy it again"
    assert fault.without_remedy == "dive/a.png: is cut short"
    assert fault.beside("dive/a.png") == "is cut short; copy it again"
    assert fault.args == (str(fault),)


# The point X = (0.1, 0.2, 2) of the world. The first camera sits at the origin: x = 100 * 0.1 / 2 + 50 = 55,
# y = 100 * 0.2 / 2 + 40 = 50. The second is at (2, 0, 2) and looks along -x (its right is +z): in its frame X is
# (0, 0.2, 1.9), so that x = 32, y = 95 * 0.2 / 1.9 + 24 = 34.
X = np.array([0.1, 0.2, 2.0])
FIRST = Camera(np.array([[100.0, 0, 50], [0, 100, 40], [0, 0, 1]]), 100, 80)
SECOND = Camera(np.array([[95.0, 0, 32], [0, 95, 24], [0, 0, 1]]), 64, 48)
FIRST_POSE = np.eye(4)
SECOND_POSE = np.array([[0.0, 0, 1, -2], [0, 1, 0, 0], [-1, 0, 0, 2], [0, 0, 0, 1]])


def test_a_known_point_lands_where_it_must_in_two_views() -> None:
    for camera, pose, expected, depth in (
        (FIRST, FIRST_POSE, (55, 50), 2),
        (SECOND, SECOND_POSE, (32, 34), 1.9),
    ):
        xy, z = project(camera, (pose @ np.append(X, 1))[:3])
        np.testing.assert_allclose(xy, expected, atol=1e-9)
        assert z == pytest.approx(depth)


def test_the_relative_pose_takes_the_first_cameras_points_to_the_second() -> None:
    # a quarter roll, moved
    first_pose = np.array([[0.0, -1, 0, 0.3], [1, 0, 0, -0.2], [0, 0, 1, 0.5], [0, 0, 0, 1]])
    in_first = np.array([-0.2 + 0.3, 0.1 - 0.2, 2.5, 1])  # X there, by hand
    moved = relative_pose(SECOND_POSE, first_pose) @ in_first
    np.testing.assert_allclose(moved, [0, 0.2, 1.9, 1], atol=1e-12)


def test_unprojecting_a_pixel_with_its_depth_gives_the_point() -> None:
    point = unproject(FIRST, np.array([55.0]), np.array([50.0]), np.array([2.0]))
    np.testing.assert_allclose(point, X[:, None], atol=1e-12)


def test_distance_is_the_hypotenuse_over_planar_depth() -> None:
    # The middle of the only pixel is 0.75 focal lengths off the axis: a 3-4-5 triangle.
    camera = Camera(np.array([[1.0, 0, -0.25], [0, 1, 0.5], [0, 0, 1]]), 1, 1)
    np.testing.assert_allclose(pixel_rays(camera)[0, 0], [0.75, 0, 1])
    np.testing.assert_allclose(distance_map(camera, np.full((1, 1), 4, np.float32)), [[5]])


def test_unknown_depth_is_unknown_distance() -> None:
    depth = np.zeros((FIRST.height, FIRST.width), np.float32)
    assert not distance_map(FIRST, depth).any()


@pytest.mark.parametrize("z", [0.0, -2.0])
def test_points_at_or_behind_the_camera_land_nowhere(z: float) -> None:
    behind = np.array([0.1, 0.2, z])
    assert np.isnan(project(FIRST, behind)[0]).all()
