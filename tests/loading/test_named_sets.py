"""Named test sets: pictures are known again when renamed, as JPEG and resized, and a set that is not whole is named."""

import io
import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from support.command_line import Done
from support.messages import names

from sucre_bench.loading import named_sets as room
from sucre_bench.loading.named_sets import (
    Member,
    NamedSet,
    found_of,
    named_sets,
    picture_of,
    print_of,
)

Bench = Callable[..., Done]
N = 4


def scenery(seed: int) -> np.ndarray:
    """A made photograph, 96x72."""
    rng = np.random.default_rng(seed)
    smooth = sum(cv2.GaussianBlur(rng.random((72, 96, 3)), (0, 0), s) * s for s in (1, 3, 8))
    return ((smooth - smooth.min()) / np.ptp(smooth) * 200 + 20).astype(np.uint8)


def write(folder: Path, pictures: dict[str, np.ndarray]) -> str:
    folder.mkdir(exist_ok=True)
    for name, picture in pictures.items():
        assert cv2.imwrite(str(folder / name), picture, [cv2.IMWRITE_JPEG_QUALITY, 60])
    return str(folder)


def described(bench: Bench, root: str, *words: str) -> Done:
    return bench("describe", "photos", f"dataset.root={root}", "--no-sheet", *words)


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The name of a set of four pictures, which lie in made/."""
    pictures = {f"{k}.png": scenery(k) for k in range(N)}
    write(tmp_path / "made", pictures)
    members = [
        Member(name, (), (96, 72), print_of(bgr[..., ::-1]), None)
        for name, bgr in pictures.items()
    ]
    one = NamedSet("made4", "", "", "", "", "", tuple(members))
    monkeypatch.setattr(room, "named_sets", lambda: {"made4": one})
    return "made4"


def scene_of(bench: Bench, root: str, split: str) -> Done:
    return described(bench, root, f"dataset.split={split}", "--json")


def test_a_split_takes_the_sets_pictures_renamed_resized_as_jpeg_and_names_the_scene(
    bench: Bench, made: str, tmp_path: Path
) -> None:
    theirs = {f"x{k}.jpg": cv2.resize(scenery(k), (128, 128)) for k in range(N)}
    root = write(
        tmp_path / "theirs", {**theirs, **{f"other{k}.png": scenery(50 + k) for k in range(3)}}
    )
    done = scene_of(bench, root, made)
    (scene,) = json.loads(done.stdout)
    assert (scene["scene"], [view["name"] for view in scene["views"]]) == (
        "made4",
        sorted(theirs),
    )
    assert {"128x128"} <= names(done.stderr)


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"2.png": scenery(9)}, {"1", "missing", "2.png"}),
        ({"2.png": scenery(1)}, {"1", "missing", "2.png"}),
        ({"5.png": scenery(1)}, {"1", "twice"}),
        (
            {"2.png": np.clip(scenery(2) * 1.3, 0, 255).astype(np.uint8)},
            {"1", "changed", "2.png"},
        ),
        ({"2.png": scenery(2)[12:-12, 16:-16]}, {"1", "missing", "2.png"}),
    ],
    ids=["another picture", "one for another", "twice", "brighter", "cropped"],
)
def test_a_set_that_is_not_as_published_is_one_line(
    bench: Bench, made: str, tmp_path: Path, change: dict[str, np.ndarray], named: set[str]
) -> None:
    root = write(tmp_path / "theirs", {f"{k}.png": scenery(k) for k in range(N)} | change)
    # A fifth picture that all names of the set hide is not read: the copies have other names.
    if "5.png" in change:
        for k in range(N):
            (Path(root) / f"{k}.png").rename(Path(root) / f"x{k}.png")
    done = scene_of(bench, root, made)
    assert done.returncode == 2
    (line,) = done.errors
    assert line.startswith(f"error: {root}: ")
    assert named <= names(line)


def test_an_unknown_set_is_one_line_with_the_nearest_name(bench: Bench, tmp_path: Path) -> None:
    done = scene_of(bench, write(tmp_path / "made", {"a.png": scenery(0)}), "u9")
    assert (done.returncode, len(done.errors)) == (2, 1)
    assert "'u90'" in done.stderr


def test_the_shipped_sets_are_listed_and_share_the_pictures_that_their_authors_share(
    bench: Bench,
) -> None:
    listed = {one["name"]: one for one in json.loads(bench("list", "sets", "--json").stdout)}
    assert {listed[name]["pictures"] for name in ("u90", "t90", "dnnet90", "sfhformer90")} == {
        90
    }
    assert "Test_400" in listed["lsui400"]["source"]
    members = {
        name: {one.name for one in named_sets()[name].members}
        for name in ("u90", "t90", "dnnet90")
    }
    # As the lists of names share them, which prints have no part in.
    shared = [
        len(members[a] & members[b])
        for a, b in (("u90", "t90"), ("u90", "dnnet90"), ("t90", "dnnet90"))
    ]
    assert shared == [19, 9, 9]
    for a, b in (("u90", "t90"), ("u90", "dnnet90")):
        prints = {
            one.image.bits
            for one in named_sets()[a].members
            if one.name in members[b] and one.image
        }
        others = {
            one.image.bits
            for one in named_sets()[b].members
            if one.name in members[a] and one.image
        }
        far = [
            min(bin(int.from_bytes(x) ^ int.from_bytes(y)).count("1") for y in others)
            for x in prints
        ]
        assert max(far) <= 8  # of 256: the same picture, in the files of two groups


def test_other_pictures_are_of_no_set_and_what_a_method_made_of_its_own_are() -> None:
    strangers = {f"{k}.png": picture_of(scenery(k)) for k in range(30)}
    assert not any(
        found_of(named, strangers).members
        for named in named_sets().values()
        if named.members[0].image
    )


def test_scores_say_the_set_of_the_references_and_the_rows_keep_it(
    bench: Bench, made: str, tmp_path: Path
) -> None:
    restored = {
        f"{k}.png": np.clip(scenery(k) * 1.2 + 9, 0, 255).astype(np.uint8) for k in range(N)
    }
    root, truth = write(tmp_path / "out", restored), str(tmp_path / "made")
    done = bench("score", root, "--reference", truth, "--metrics", "psnr", "--json")
    assert set(pd.read_json(io.StringIO(done.stdout))["scene"]) == {"made4"}
    assert "made4: these are its 4 pictures" in done.stderr
    (Path(root) / "3.png").unlink()
    done = bench("score", root, "--metrics", "uciqe", "--json")
    assert pd.read_json(io.StringIO(done.stdout))["scene"].eq("").all()
    assert {"3.png", "missing", "changed", "1"} <= names(done.stderr)
