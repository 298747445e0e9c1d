"""Each way a method breaks the contract of plugins is found, named, and told how to mend."""

import re
from pathlib import Path

import numpy as np
import pytest
from support.messages import names
from support.tried_plugins import FADED, GOOD, HOLES, METHOD, broken, write

from sucre_bench.plugins.registry import find, load_file
from sucre_bench.programs.contract.contract import Subject, breaches, check

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
    assert broken(tmp_path, "method", METHOD, body, needs=needs) == {}


SMALL_IMAGES_FAIL = """
import numpy as np
from dataclasses import dataclass
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Deep:
    '''Needs 100 pixels, as networks with many strides do.'''
    def restore(self, scene, view):
        if min(view.rgb.shape[:2]) < LEAST:
            raise ValueError("Kernel size can't be greater than actual input size")
        return Restoration(view.rgb * 0.9)
"""


def test_a_network_that_fails_on_small_images_is_checked_on_larger_ones(tmp_path: Path) -> None:
    """The made scenes are 64 x 48 pixels; twice that is too small, four times is not."""
    (tmp_path / "deep.py").write_text(SMALL_IMAGES_FAIL.replace("LEAST", "100"))
    load_file(tmp_path / "deep.py")
    outcomes = {one.name: one for one in check(Subject(find("method", "deep")))}
    assert [one.name for one in outcomes.values() if one.status == "broken"] == []
    assert [text for _, text in outcomes["leaves_the_process"].findings] == [
        "fails on images of 128 x 96 pixels; checked on 256 x 192"
    ]
    assert not outcomes["is_the_same_elsewhere"].skipped


def test_one_cause_is_said_once(tmp_path: Path) -> None:
    (tmp_path / "deep.py").write_text(SMALL_IMAGES_FAIL.replace("LEAST", "10_000"))
    load_file(tmp_path / "deep.py")
    outcomes = list(check(Subject(find("method", "deep")), lasting=False))
    said = [text for one in outcomes for _, text in one.findings if text.startswith("raises ValueError")]
    assert len(said) == 1
    assert sum(one.skipped == "for the reason above" for one in outcomes) >= 3


# By rule: what a method's restore() does between GOOD and the return of `image`, and the words of the breach.
BREACHES: list[tuple[str, str, set[str]]] = [
    ("colours_what_is_valid", "image = image / view.rgb.max(axis=2, keepdims=True)", {"black", "colour"}),
    ("colours_what_is_valid", "image = image / view.rgb.max()", {"RuntimeWarning", "SolveError"}),
    ("colours_what_is_valid", "image[0, 0, 0] = np.nan", {"NaN", "channels"}),
    ("colours_what_is_valid", "image = image[::2]", {"(24, 64, 3)", "(48, 64, 3)"}),
    ("colours_what_is_valid", "view.rgb[:] = 0", {"input", "tried.py", "copy"}),
    ("leaves_the_process", "raise KeyError('x')", {"KeyError", "'x'", "SolveError"}),
    ("leaves_no_holes", "image[~view.valid] = np.nan", {"960", "depth"}),
    ("leaves_its_input", "view.rgb.setflags(write=True)\nview.rgb[0] = 0", {"rgb", "far.png", "view.rgb.copy"}),
    ("is_deterministic", "image *= np.random.rand(*image.shape[:2], 1)", {"np.random.default_rng(self.seed"}),
    ("leaves_the_process", "np.random.seed(3)", {"numpy's", "random", "numpy.random.default_rng(self.seed"}),
    ("leaves_the_process", "random.seed(3)", {"random's", "state"}),
    ("leaves_the_process", "np.seterr(all='ignore')", {"numpy's", "error"}),
    ("leaves_the_process", "import cv2; cv2.setNumThreads(cv2.getNumThreads() + 1)", {"OpenCV's", "threads"}),
    ("leaves_the_process", "os.environ['TRIED_HERE'] = 'x'", {"os.environ[TRIED_HERE]", "requires="}),
    ("leaves_the_process", "open('junk.txt', 'w').close()", {"junk.txt", "tempfile's"}),
    ("runs_with_least", "image *= view.depth.mean()", {"far.png", "depth", "needs="}),
    ("keeps_its_eyes_off", "image = image if view.reference is None else view.reference * 1", {"reference", "needs="}),
    ("keeps_its_eyes_off", "image *= scene.water.attenuation[0] if scene.water else 1", {"truth", "needs="}),
    ("leaves_the_process", "return Restoration(image, confidence=np.ones(5))", {"Restoration.confidence", "(5,)"}),
    (
        "leaves_the_process",
        "return Restoration(image, Water(np.ones(2), np.ones(3), np.ones(3)))",
        {"Water.veiling_light", "(3,)"},
    ),
]
WITH_DEPTH: list[tuple[str, str, set[str]]] = [
    ("leaves_holes", "image = image * (1 + view.depth[..., None])", {"960", "depth", "image[~view.valid]"}),
    (
        "skips_what_has_no_depth",
        f"if not view.valid.any():\n    raise SolveError('none')\n{HOLES}",
        {"none", "NotApplicableError"},
    ),
    ("skips_what_has_no_depth", HOLES, {"far.png", "NotApplicableError"}),
]


@pytest.mark.parametrize(
    ("needs", "rule", "body", "named"),
    [*(("()", *case) for case in BREACHES), *(("{'depth'}", *case) for case in WITH_DEPTH)],
)
def test_each_way_a_method_breaks_the_contract_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, needs: str, rule: str, body: str, named: set[str]
) -> None:
    import cv2

    monkeypatch.chdir(tmp_path)
    kept, threads = np.geterr(), cv2.getNumThreads()
    try:
        found = broken(tmp_path, "method", METHOD, f"{GOOD}{body}\nreturn Restoration(image)", needs=needs)
    finally:
        cv2.setNumThreads(threads)
        np.seterr(**kept)
    assert any(named <= names(line) for line in found[rule].splitlines()), found


def test_what_is_no_fault_for_sure_is_a_doubt(tmp_path: Path) -> None:
    body = FADED + "image = view.rgb * 1\nimage[~view.valid] = np.nan\n"
    body += "if view.rgb.std() < .1:\n    raise SolveError('too flat; move nearer')\nreturn Restoration(image)"
    load_file(write(tmp_path, METHOD, body, needs="{'depth', 'poses'}"))
    plugin = find("method", "tried")
    outcomes = check(Subject(plugin), lasting=False)
    said = {one.rule: [f.text for f in one.findings] for one in outcomes if one.status == "doubtful"}
    colours, needs = said.values()
    assert re.match("black: .*too flat; move nearer; ", colours[0])
    assert [text.partition(";")[0].split()[-1] for text in needs] == ["depth", "poses"]


def test_what_a_plugin_prints_is_a_doubt(tmp_path: Path) -> None:
    load_file(write(tmp_path, METHOD, "print('fading', 1)\n" + GOOD + "return Restoration(image)", needs="()"))
    plugin = find("method", "tried")
    said = [f.text for one in check(Subject(plugin), lasting=False) for f in one.findings]
    assert [text.partition(";")[0] for text in said] == ["prints 'fading 1'"]


def test_what_is_not_explained_or_cannot_be_set_is_named(tmp_path: Path) -> None:
    bare = (
        METHOD.replace("'''A method that is tried.'''", "").replace("'''A factor.'''", "").replace("= 1.0", "= 'much'")
    )
    found = broken(tmp_path, "method", bare, "return Restoration(view.rgb)", needs="()")
    assert {"Tried", "docstring", "'gain'"} <= names(found["is_described"])
    assert {"default", "type"} <= names(found["is_configurable"])


def test_an_option_that_must_be_given_leaves_rules_unlooked_at_and_says_so(tmp_path: Path) -> None:
    asking = METHOD.replace("= 1.0", "")
    found = broken(tmp_path, "method", asking, GOOD + "return Restoration(image)", needs="()")
    assert [text for text in found.values() if "method.gain=..." in text] == [found["leaves_the_process"]]  # once
    assert found["is_deterministic"] == "for the reason above"
    assert breaches("method", "tried", gain=1.0) == []


# -- the command -----------------------------------------------------------------------------------------


def test_what_is_random_is_accused_of_nothing_else(tmp_path: Path) -> None:
    found = broken(
        tmp_path, "method", METHOD, "return Restoration(view.rgb * np.random.rand(*view.rgb.shape[:2], 1))", needs="()"
    )
    assert set(found) == {"is_deterministic", "leaves_the_process"}
