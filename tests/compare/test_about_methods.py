"""What methods were trained on: the note of tables, and the warning of test pictures that were among it."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from sucre_bench.loading import named_sets
from sucre_bench.loading.named_sets import Member, NamedSet, print_of

QUIET = ("workers=0", "tracking.uri=off", "report=false")
RNG = np.random.default_rng(4)


def picture() -> np.ndarray:
    return cv2.resize(
        RNG.integers(0, 255, (9, 12, 3), dtype=np.uint8),
        (120, 90),
        interpolation=cv2.INTER_CUBIC,
    )


def test_compare_warns_of_test_pictures_that_were_in_the_training_set(
    bench: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = {"Reef less own": 2, "other": 2, "Reef less nothing": 0, "Names": 0, "a thousand": 0}
    pictures = {name: picture() for name in ("a", "b", "c")}
    for folder in ("photographs", "restored"):
        (tmp_path / folder).mkdir()
        for name, bgr in pictures.items():
            cv2.imwrite(str(tmp_path / folder / f"{name}.png"), bgr)

    def named(name: str, *of: str) -> NamedSet:
        members = (
            Member(f"{one}.png", (), None, print_of(pictures[one][..., ::-1]), None)
            for one in of
        )
        return NamedSet(name, "", "Reef", "", "", "", tuple(members))

    sets = {
        "own": named("own", "c"),
        "other": named("other", "a", "b"),
        "more": named("more", "c"),
    }
    sets["names"] = NamedSet(
        "names", "", "Names", "", "", "", (Member("a.png", (), None, None, None),)
    )
    monkeypatch.setattr(named_sets, "named_sets", lambda: sets)
    monkeypatch.setattr("sucre_bench.engine.training_pictures.named_sets", lambda: sets)
    words = (
        "dataset=./photographs",
        "method=precomputed",
        "method.folder=restored",
        "metrics=[uciqe]",
        "out=out",
    )
    given = ",".join(f"'{said}'" for said in seen)
    words = (*words, f"method.trained_on={given}", *QUIET)
    done = bench("run", "-m", *words)
    assert done.returncode == 0, done.stderr
    done = bench("compare", "out")
    told = " ".join(done.stdout.split())
    assert all(f"trained on: {said}" in told for said in seen)
    warned = [line for line in done.stderr.splitlines() if "were in the training set" in line]
    assert len(warned) == 2
    assert all("2 of 3 pictures" in line for line in warned)


def test_a_table_says_which_method_is_this_projects(
    bench: Callable[..., Any], tmp_path: Path
) -> None:
    (tmp_path / "photographs").mkdir()
    cv2.imwrite(str(tmp_path / "photographs" / "a.png"), picture())
    words = (
        "dataset=./photographs",
        "metrics=[uciqe]",
        *QUIET,
        "out=out",
    )
    assert bench("run", "-m", *words, "method=gray_world,sucre_plus").returncode == 0
    said = " ".join(bench("compare", "out").stdout.split())
    assert (
        "sucre_plus: by this project, after Boittiaux et al. 2024; its authors have not seen it"
        in said
    )
