"""Each way a method breaks the contract of plugins is found, named, and told how to mend."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from support.tried_plugins import FADED, GOOD, HOLES, METHOD, broken, write

from sucre_bench.plugins.registry import find, load_file
from sucre_bench.programs.contract import Subject, breaches, check, rules

pytestmark = pytest.mark.usefixtures("own_environment")


@pytest.mark.parametrize(
    ("needs", "body"),
    [
        ("()", GOOD + "return Restoration(image)"),
        ("()", "return Restoration(view.rgb)"),  # locked: nobody can write into it
        ("{'depth'}", FADED + HOLES + "return Restoration(image)"),
        ("()", GOOD + "return Restoration(image, Water(np.full(3, .1), np.full(3, np.nan), np.full(3, .1)))"),
        ("()", GOOD + "rng = np.random.default_rng(1)\nreturn Restoration(image + .1 * rng.random(image.shape))"),
        ("{'reference'}", "return Restoration(view.reference * 1)"),
    ],
)
def test_what_keeps_the_contract_is_found_to_keep_it(tmp_path: Path, needs: str, body: str) -> None:
    assert broken(tmp_path, "method", METHOD, body, needs=needs) == ""


@pytest.mark.parametrize(
    ("needs", "body", "rule", "said"),
    [
        (
            "()",
            "return Restoration(view.rgb / view.rgb.max(axis=2, keepdims=True))",
            "finite colour",
            "black: the method gave no pixel",
        ),
        ("()", "return Restoration(view.rgb / view.rgb.max())", "finite colour", r"RuntimeWarning at tried\.py:"),
        ("()", GOOD + "image[0, 0, 0] = np.nan\nreturn Restoration(image)", "finite", "NaN in some channels only"),
        ("()", GOOD + "image[~view.valid] = np.nan\nreturn Restoration(image)", "whole image", "960 pixels get no"),
        ("()", GOOD + "return Restoration(image[::2])", "finite colour", r"it must be \(48, 64, 3\)"),
        (
            "()",
            "view.rgb[:] = 0\nreturn Restoration(view.rgb)",
            "finite colour",
            r"input at tried\.py:\d+; work on a copy",
        ),
        (
            "()",
            "view.rgb.setflags(write=True)\nview.rgb[0] = 0\n" + GOOD + "return Restoration(image)",
            "its input",
            "rgb of far.png is changed",
        ),
        (
            "()",
            GOOD + "return Restoration(image * np.random.rand(*image.shape[:2], 1))",
            "same twice",
            r"differs by up to 0\.\d+; seed",
        ),
        (
            "()",
            "np.random.seed(3)\n" + GOOD + "return Restoration(image)",
            "the process",
            "changes numpy's random state",
        ),
        ("()", "random.seed(3)\n" + GOOD + "return Restoration(image)", "the process", "changes random's state"),
        (
            "()",
            "np.seterr(all='ignore')\n" + GOOD + "return Restoration(image)",
            "the process",
            "numpy's error handling",
        ),
        (
            "()",
            "import cv2; cv2.setNumThreads(cv2.getNumThreads() + 1)\n" + GOOD + "return Restoration(image)",
            "the process",
            "OpenCV's threads",
        ),
        (
            "()",
            "os.environ['TRIED_HERE'] = 'x'\n" + GOOD + "return Restoration(image)",
            "the process",
            r"os\.environ\[TRIED_HERE\]; put it back",
        ),
        (
            "()",
            "open('junk.txt', 'w').close()\n" + GOOD + "return Restoration(image)",
            "the process",
            "changes the file junk.txt; write into",
        ),
        (
            "()",
            GOOD + "return Restoration(image * view.depth.mean())",
            "no more than it says",
            "a view with nothing but an image: far.png: the view has no depth map; add",
        ),
        (
            "()",
            GOOD + "return Restoration(image if view.reference is None else view.reference * 1)",
            "does not look",
            "changes with the reference",
        ),
        (
            "()",
            GOOD + "return Restoration(image * (scene.water.attenuation[0] if scene.water else 1))",
            "does not look",
            "changes with the truth",
        ),
        (
            "{'depth'}",
            GOOD + "return Restoration(image * (1 + view.depth[..., None]))",
            "no colour where",
            "960 of 960 pixels without depth",
        ),
        (
            "{'depth'}",
            "if not view.valid.any():\n    raise SolveError('none')\n" + HOLES + "return Restoration(image)",
            "skips a view",
            "ends in none; raise NotApplicableError",
        ),
        (
            "{'depth'}",
            HOLES + "return Restoration(image)",
            "skips a view",
            "all NaN or infinite; raise Not|no pixel of",
        ),
        ("()", GOOD + "return Restoration(image, confidence=np.ones(5))", "can be kept", r"confidence is \(5,\)"),
        (
            "()",
            GOOD + "return Restoration(image, Water(np.ones(2), np.ones(3), np.ones(3)))",
            "can be kept",
            "three numbers",
        ),
        ("()", "raise KeyError('x')", "finite colour", r"raises KeyError: 'x' at tried\.py:\d+; mend it"),
    ],
)
def test_each_way_a_method_breaks_the_contract_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, needs: str, body: str, rule: str, said: str
) -> None:
    monkeypatch.chdir(tmp_path)
    kept = np.geterr()
    try:
        import cv2

        threads = cv2.getNumThreads()
        found = broken(tmp_path, "method", METHOD, body, needs=needs)
        cv2.setNumThreads(threads)
    finally:
        np.seterr(**kept)
    lines = [line for line in found.splitlines() if rule in line]
    assert any(re.search(said, line) for line in lines), found


def test_what_is_no_fault_for_sure_is_a_doubt(tmp_path: Path) -> None:
    body = FADED + "image = view.rgb * 1\nimage[~view.valid] = np.nan\n"
    body += "if view.rgb.std() < .1:\n    raise SolveError('too flat; move nearer')\nreturn Restoration(image)"
    load_file(write(tmp_path, METHOD, body, needs="{'depth', 'poses'}"))
    plugin = find("method", "tried")
    outcomes = check(Subject(plugin), rules(plugin, lasting=False))
    said = {str(one.rule): [f.text for f in one.findings] for one in outcomes if one.status == "doubtful"}
    colours, needs = said.values()
    assert re.match("black: .*too flat; move nearer; ", colours[0])
    assert [text.partition(";")[0].split()[-1] for text in needs] == ["depth", "poses"]


def test_what_a_plugin_prints_is_a_doubt(tmp_path: Path) -> None:
    load_file(write(tmp_path, METHOD, "print('fading', 1)\n" + GOOD + "return Restoration(image)", needs="()"))
    plugin = find("method", "tried")
    said = [f.text for one in check(Subject(plugin), rules(plugin, lasting=False)) for f in one.findings]
    assert [text.partition(";")[0] for text in said] == ["prints 'fading 1'"]


def test_what_is_not_explained_or_cannot_be_set_is_named(tmp_path: Path) -> None:
    bare = (
        METHOD.replace("'''A method that is tried.'''", "").replace("'''A factor.'''", "").replace("= 1.0", "= 'much'")
    )
    found = broken(tmp_path, "method", bare, "return Restoration(view.rgb)", needs="()")
    assert re.search("Tried .*docstring", found)
    assert re.search("option 'gain' .*explained", found)
    assert re.search("default, .*type", found)


def test_an_option_that_must_be_given_leaves_rules_unlooked_at_and_says_so(tmp_path: Path) -> None:
    asking = METHOD.replace("= 1.0", "")
    assert "method.gain=..." in broken(tmp_path, "method", asking, GOOD + "return Restoration(image)", needs="()")
    assert breaches("method", "tried", gain=1.0) == []


# -- the command -----------------------------------------------------------------------------------------


def test_what_is_random_is_accused_of_nothing_else(tmp_path: Path) -> None:
    found = broken(
        tmp_path, "method", METHOD, "return Restoration(view.rgb * np.random.rand(*view.rgb.shape[:2], 1))", needs="()"
    )
    assert "same twice" in found
    assert len(found.splitlines()) == 2  # and what it leaves changed
