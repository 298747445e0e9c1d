"""Each fault of a file, in each dataset: one line names the file, or the folder where it should be; other views stay.

What only one format can have wrong is in `tests/datasets/`.
"""

import os
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from support.datasets_in_miniature import MINIATURES
from support.miniatures import check_message

from sucre_bench.errors import InputError
from sucre_bench.plugins.registry import find
from sucre_bench.scene import Plane, View


def cut(path: Path) -> None:
    content = path.read_bytes()
    # most of a .dmap is not read, and half of a text may be a whole one
    parts = 10 if path.suffix in (".dmap", ".txt") else 2
    path.write_bytes(content[: len(content) // parts])


def replaced(write: Callable[[Path], object]) -> Callable[[Path], None]:
    def change(path: Path) -> None:
        path.unlink()
        write(path)

    return change


def of_another_shape(path: Path) -> None:
    suffix = ".png" if path.suffix == ".dmap" else path.suffix
    content = cv2.imencode(suffix, np.full((50, 7), 2000, np.uint16))[1]
    path.write_bytes(bytes(content))


FAULTS: dict[str, Callable[[Path], object]] = {
    "missing": Path.unlink,
    "empty": lambda path: path.write_bytes(b""),
    "cut": cut,
    "no UTF-8": lambda path: path.write_bytes(b"\xff\xfe\x80 no such file \xff\n" * 9),
    "of another shape": of_another_shape,
    "a folder": replaced(Path.mkdir),
    "a pipe": replaced(os.mkfifo),
    "a link to itself": replaced(lambda path: path.symlink_to(path)),
}
# A photograph that a folder does not hold is no view of it; a depth map that is not there is not known.
NO_FAULT = {"missing", "a folder"}


def opened(name: str, root: Path) -> tuple[list[View], list[InputError]]:
    """The views of a dataset, or why it does not open."""
    try:
        scenes = list(find("dataset", name).cls(root=root).scenes())
    except InputError as fault:
        return [], [fault]
    return [view for scene in scenes for view in scene], []


def faults_of(views: list[View], plane: Plane) -> dict[str, InputError]:
    """Why planes of views cannot be read, by the view's name."""
    found = {}
    for view in views:
        try:
            if plane == "rgb" or view.has_depth:
                getattr(view, plane)
        except InputError as fault:
            found[view.name] = fault
    return found


def check_named(fault: InputError, path: Path) -> None:
    check_message(str(fault))
    assert path.stem in str(fault) or str(path.parent) in str(fault), str(fault)


def change(name: str, root: Path, pattern: str, fault: str) -> Path:
    path = MINIATURES[name].file(root, pattern)
    FAULTS[fault](path)
    return path


CASES: list[tuple[str, Plane, str, str]] = [
    (name, plane, pattern, fault)
    for name, one in MINIATURES.items()
    for plane, pattern in (("rgb", one.image), ("depth", one.depth))
    for fault in FAULTS
    # a photograph without camera and depth may have any shape
    if pattern and (fault != "of another shape" or one.about or plane == "depth")
]


@pytest.mark.parametrize(("name", "plane", "pattern", "fault"), CASES)
def test_a_file_of_one_view_is_named_and_the_other_view_stays(
    tmp_path: Path, name: str, plane: Plane, pattern: str, fault: str
) -> None:
    MINIATURES[name].write_into(tmp_path)
    first = opened(name, tmp_path)[0][0].name
    path = change(name, tmp_path, pattern, fault)
    views, why = opened(name, tmp_path)
    faults = dict.fromkeys([first], *why) if why else faults_of(views, plane)
    # openmvs has as many views as depth maps
    if not faults and (fault in NO_FAULT or name == "openmvs"):
        left = [view.name for view in views if plane == "rgb" or view.has_depth]
        assert left
        assert first not in left
        return
    assert [Path(of).stem for of in faults] == [Path(first).stem], faults
    check_named(*faults.values(), path)


# Photographs of FLSea are used as they are without a calibration, and SQUID's pairs have no depth without maps.
OPTIONAL = {("canyons/calibration/*.txt", fault) for fault in NO_FAULT}
OPTIONAL |= {
    ("image_set_01/*.mat", fault) for fault in {*NO_FAULT, "a pipe", "a link to itself"}
}


@pytest.mark.parametrize(
    ("name", "pattern", "fault"),
    [
        (name, pattern, fault)
        for name, one in MINIATURES.items()
        for pattern in one.about
        for fault in FAULTS
        if fault != "of another shape" and (pattern, fault) not in OPTIONAL
    ],
)
def test_a_file_of_the_whole_dataset_is_named(
    tmp_path: Path, name: str, pattern: str, fault: str
) -> None:
    MINIATURES[name].write_into(tmp_path)
    path = change(name, tmp_path, pattern, fault)
    views, why = opened(name, tmp_path)
    faults = why or [*faults_of(views, "depth").values()]
    assert faults
    for said in faults:
        check_named(said, path)
