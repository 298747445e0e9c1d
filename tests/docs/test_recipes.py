"""The recipes of docs/datasets.md: each command, on a miniature of the layout that it is for."""

import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.colmap_folder import write_dive
from support.miniatures import write_images
from support.places import ROOT

import sucre_bench as sb

PAGE = ROOT / "docs" / "datasets.md"

# Root of a command's dataset: the images below it and its reference, if any, and what its scene then has.
LAYOUTS: dict[str, tuple[tuple[str, ...], str, frozenset[str]]] = {
    "EUVP/test_samples/Inp": (("test_p1_.jpg", "test_p2_.jpg"), "GTr", frozenset({"reference"})),
    "EUVP/Paired/underwater_dark/trainA": (("264286_00007889.jpg",), "trainB", frozenset({"reference"})),
    "UFO-120/TEST/lrd": (("set_f46.jpg",), "hr", frozenset({"reference"})),
    "RUIE/UCCS": (("blue/3325.jpg", "blue-green/1303.jpg", "green/1016.jpg"), "", frozenset()),
    "SUIM/TEST/images": (("d_r_47_.jpg",), "", frozenset()),
    "Color-Check7": (("1.jpg", "2.jpg"), "", frozenset()),
}


def commands() -> list[list[str]]:
    text = PAGE.read_text(encoding="utf-8").split("\n## Recipes")[1].replace("\\\n", "")  # long commands go on below
    lines = re.findall(r"^ {4}(sucre-bench run .*)$", text, flags=re.MULTILINE)
    return [shlex.split(line)[2:] for line in lines]


def scene_of(words: list[str], folder: Path) -> sb.Scene:
    """The scene that a command opens, its root in a folder."""
    given = dict(word.split("=", 1) for word in words if "=" in word)
    options: dict[str, Any] = {
        key.removeprefix("dataset."): yaml.safe_load(value)
        for key, value in given.items()
        if key.startswith("dataset.")
    }
    options["root"] = folder / options["root"]
    return next(iter(sb.load_scenes(given["dataset"], **options)))


@pytest.mark.skipif(not PAGE.is_file(), reason="the documentation is not beside the tests")
def test_every_recipe_opens_its_layout(tmp_path: Path) -> None:
    seen = set()
    for words in commands():
        root = next(word for word in words if word.startswith("dataset.root=")).split("=")[1]
        if root in LAYOUTS:
            images, references, has = LAYOUTS[root]
            write_images(tmp_path / root, *images)
            if references:
                write_images(tmp_path / root / ".." / references, *images, seed=7)
        else:
            images, has = ("a.png",), frozenset({"poses"})
            write_dive(tmp_path / root)
        scene = scene_of(words, tmp_path)
        assert has <= scene.has, root
        assert len(scene.views) >= len(images), root
        if "reference" in has:
            assert all(view.reference is not None for view in scene), root
        seen.add(root)
    assert set(LAYOUTS) < seen
