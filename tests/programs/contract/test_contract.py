"""The contract of plugins: each way to break it is found, named, and told how to mend; and the command that says so."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pytest
from click.testing import CliRunner, Result
from support.colmap_folder import write_dive
from support.places import TOYS

from sucre_bench import InputError, plugins
from sucre_bench.commands.check import check as command
from sucre_bench.plugins.registry import find, load_file
from sucre_bench.programs.contract import Subject, breaches, check, rules


@pytest.fixture(autouse=True)
def own_environment() -> Iterator[None]:
    """Variables that a plugin sets are gone after the test."""
    with mock.patch.dict(os.environ):
        yield


HEAD = """
import os, random, warnings
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from sucre_bench import (Arrays, Camera, InputError, NotApplicableError, Restoration, Scene, Score, SolveError, View,
                         Water, dataset, method, metric)
"""

METHOD = """
@method(needs={needs}, cites="Nobody 2026")
@dataclass(frozen=True)
class Tried:
    '''A method that is tried.'''

    gain: float = 1.0
    '''A factor.'''

    def restore(self, scene: Scene, view: View) -> Restoration:
        {body}
"""

DATASET = """
@dataset(has={has}, source="nowhere")
@dataclass(frozen=True)
class Tried:
    '''A dataset that is tried.'''

    root: Path
    '''A folder.'''

    def scenes(self):
        if not (self.root / "sparse").is_dir():
            raise InputError(f"{{self.root}}: holds no scene; give another")
        rng = np.random.default_rng(0)
        rgb, depth = rng.random((6, 8, 3), dtype=np.float32), np.full((6, 8), 2, np.float32)
        K, pose, name, data_id = np.array([[8, 0, 4], [0, 8, 3], [0, 0, 1.0]]), np.eye(4), "a.png", "1"
        {body}
        views = [View(name, Arrays(rgb, depth), Camera(K, 8, 6), pose)]
        yield Scene("one", views, frozenset({{"depth", "poses"}}), data_id=data_id)
"""

METRIC = """
@metric(needs={needs}, variants={{"all": "of everything"}}, unit="", better="{better}", range=(0, 1))
@dataclass(frozen=True)
class Tried:
    '''A metric that is tried.'''

    def score(self, restored: Restoration, shown: np.ndarray, view: View, variant: str):
        seen = np.isfinite(shown).all(axis=-1)
        value = float(np.abs(shown - view.reference)[seen].mean()) if seen.any() else np.nan
        n, coverage = int(seen.sum()), float(seen.mean())
        {body}
        yield Score(value, n_pixels=n, coverage=coverage)
"""


def indented(body: str) -> str:
    return "\n        ".join(body.splitlines())


def write(folder: Path, template: str, body: str, **filled: Any) -> Path:
    path = folder / "tried.py"
    path.write_text(HEAD + template.format(body=indented(body), **filled))
    return path


def broken(folder: Path, kind: plugins.Kind, template: str, body: str, **filled: Any) -> str:
    """What is broken, a line each."""
    load_file(write(folder, template, body, **filled))
    return "\n".join(breaches(kind, "tried", **({"root": write_dive(folder)} if kind == "dataset" else {})))


GOOD = "image = view.rgb * np.float32(self.gain)\n"
FADED = "if not view.valid.any():\n    raise NotApplicableError(f'{view.name}: no pixel has depth')\n"
HOLES = "image = np.where(view.valid[..., None], view.rgb * np.exp(view.depth)[..., None], np.nan)\n"


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
        ("()", GOOD + "return Restoration(image * np.random.rand())", "same twice", r"differs by up to 0\.\d+; seed"),
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
    assert colours[0] == "black: nothing is restored, too flat; move nearer; fine where no answer has a meaning"
    assert [text.partition(";")[0] for text in needs] == [
        f"its result is the same with other {n}" for n in ("depth", "poses")
    ]


def test_what_a_plugin_prints_is_a_doubt(tmp_path: Path) -> None:
    load_file(write(tmp_path, METHOD, "print('fading', 1)\n" + GOOD + "return Restoration(image)", needs="()"))
    plugin = find("method", "tried")
    said = [f.text for one in check(Subject(plugin), rules(plugin, lasting=False)) for f in one.findings]
    assert [text.partition(";")[0] for text in said] == ["prints 'fading 1'"]


DECLARED = "{'depth', 'poses'}"


def test_a_dataset_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "dataset", DATASET, "", has=DECLARED) == ""


@pytest.mark.parametrize(
    ("has", "body", "said"),
    [
        (DECLARED, "rgb = rgb * 255", r"rgb goes from .* to 25\d; divide by full scale"),
        (DECLARED, "rgb[0] = np.nan", "rgb has values that are not finite"),
        (DECLARED, "depth[0] = -1", "depth is NaN or negative"),
        (DECLARED, "depth[0] = np.nan", "depth is NaN or negative"),
        (DECLARED, "depth = depth[1:]", r"depth is \(5, 8\) float32; give \(6, 8\)"),
        (DECLARED, "pose[0, 0] = 2", "no rigid transform"),
        (DECLARED, "pose = pose[:3]", "no rigid transform"),
        (DECLARED, "K[0, 0] = -8", "the focal lengths are -8 and 8"),
        (DECLARED, "K[0, 2] = .5 - 4", r"the principal point \(-3.5, 3\) is not in the image"),
        (DECLARED, "K = K.T", "K is .*; give"),
        (DECLARED, "name = '/a.png'", "a view is called '/a.png'"),
        (DECLARED, "data_id = ''", "no data_id"),
        (DECLARED, "data_id = str(id(rgb)) + str(os.urandom(3))", "data_id is another when opened again"),
        (
            DECLARED,
            "rgb = np.random.rand(6, 8, 3).astype('f4')",
            "another image when opened again|changes numpy's random",
        ),
        (DECLARED, "depth = None", "`has` says depth, no view has any"),
        ("{'poses'}", "", "one has depth; add to has= of @dataset"),
        (
            DECLARED,
            "os.chdir('.') or os.environ.update(TRIED_OPENED=os.urandom(3).hex())",
            r"changes os\.environ\[TRIED_OPENED\]",
        ),
    ],
)
def test_each_way_a_dataset_breaks_the_contract_is_named(tmp_path: Path, has: str, body: str, said: str) -> None:
    assert re.search(said, broken(tmp_path, "dataset", DATASET, body, has=has))


def test_a_dataset_must_name_the_folder_that_is_missing(tmp_path: Path) -> None:
    rough = DATASET.replace(
        'raise InputError(f"{{self.root}}: holds no scene; give another")', "raise OSError('no data')"
    )
    found = broken(tmp_path, "dataset", rough, "", has=DECLARED)
    assert "root, a folder that is not there: says only 'dataset 'tried': OSError: no data;" in found
    assert "root, an empty one: says only" in found


JUDGED = "{'reference'}"


def test_a_metric_that_keeps_the_contract_is_found_to_keep_it(tmp_path: Path) -> None:
    assert broken(tmp_path, "metric", METRIC, "", needs=JUDGED, better="lower") == ""


@pytest.mark.parametrize(
    ("needs", "better", "body", "said"),
    [
        (JUDGED, "lower", "value = 2 * value + 1", r"reference, all: image scores .*, not in 0 to 1"),
        (JUDGED, "lower", "coverage = 100 * coverage", "has coverage"),
        (JUDGED, "higher", "", "image scores 0 when perfect, .* when spoilt; see better="),
        ("()", "lower", "", "a view with an image, all: TypeError"),
        (JUDGED, "lower", "value = 0.5 if np.isnan(value) else value", "scores 0.5 of no pixel"),
        (JUDGED, "lower", "shown[:] = 0", "read-only; work on a copy|writes into its input"),
        (JUDGED, "lower", "value = value * np.random.rand()", "another score the second time"),
        (JUDGED, "lower", "np.random.seed(1)", "changes numpy's random state"),
        (JUDGED, "lower", "if not seen.any(): raise ValueError('empty')", "all NaN, all: ValueError: empty"),
    ],
)
def test_each_way_a_metric_breaks_the_contract_is_named(
    tmp_path: Path, needs: str, better: str, body: str, said: str
) -> None:
    assert re.search(said, broken(tmp_path, "metric", METRIC, body, needs=needs, better=better))


def test_what_a_metric_raises_of_every_image_is_said_once(tmp_path: Path) -> None:
    found = broken(tmp_path, "metric", METRIC, "raise KeyError('k')", needs=JUDGED, better="lower").splitlines()
    (said,) = [line for line in found if line.startswith("stays in its range")]
    assert said.endswith("KeyError: 'k'; mend it; where there is nothing to score, yield nothing")


def test_what_is_not_explained_or_cannot_be_set_is_named(tmp_path: Path) -> None:
    bare = (
        METHOD.replace("'''A method that is tried.'''", "").replace("'''A factor.'''", "").replace("= 1.0", "= 'much'")
    )
    found = broken(tmp_path, "method", bare, "return Restoration(view.rgb)", needs="()")
    assert "Tried has no docstring" in found
    assert "option 'gain' is not explained" in found
    assert "correct the default, or the type" in found


def test_an_option_that_must_be_given_leaves_rules_unlooked_at_and_says_so(tmp_path: Path) -> None:
    asking = METHOD.replace("= 1.0", "")
    assert "not looked at, options must be given; add method.gain=..." in broken(
        tmp_path, "method", asking, GOOD + "return Restoration(image)", needs="()"
    )
    assert breaches("method", "tried", gain=1.0) == []


# -- the command ------------------------------------------------------------------------------------------


def run(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_the_command_says_a_line_a_rule_and_what_to_do(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb / view.rgb.max())", needs="()")
    done = run(str(path), "--quick")
    assert done.exit_code == 1
    assert "✗ gives every valid pixel a finite colour" in done.stdout
    assert "guard" in done.stdout
    assert re.search(r"\d+ kept, \d+ to mend in [\d.]+ s", done.stdout)
    assert "\x1b" not in done.stdout


def test_what_is_random_is_accused_of_nothing_else(tmp_path: Path) -> None:
    found = broken(tmp_path, "method", METHOD, "return Restoration(view.rgb * np.random.rand())", needs="()")
    assert "does not look" not in found
    assert "same twice" in found


def test_signs_are_plain_where_the_terminal_knows_no_others(tmp_path: Path) -> None:
    from sucre_bench.programs.contract.text import lines

    subject = Subject(find("method", "underwater"))
    for outcome in check(subject, rules(subject.plugin, lasting=False)):
        assert "".join(line.plain for line in lines(outcome, "ISO-8859-1")).isascii()


def test_the_command_takes_options_and_gives_json(tmp_path: Path) -> None:
    body = "assert self.gain == 0.5\nreturn Restoration(view.rgb * np.float32(self.gain))"
    path = write(tmp_path, METHOD, body, needs="()")
    done = run(str(path), "method.gain=0.5", "--quick", "--json")
    (told,) = json.loads(done.stdout)
    assert (told["kind"], told["name"], told["ok"], done.exit_code) == ("method", "tried", True, 0)
    assert {rule["status"] for rule in told["rules"]} == {"kept"}
    assert run(str(path), "--quick").exit_code == 1


def test_the_command_imports_in_another_process_and_tries_a_dataset(tmp_path: Path) -> None:
    (tmp_path / "heavy.py").write_text(
        "import scipy.linalg, os\nos.environ['HEAVY_HERE'] = '1'\n"
        + HEAD
        + METHOD.format(needs="()", body="return Restoration(view.rgb)")
    )
    toys = TOYS
    load_file(toys)
    done = run(str(tmp_path / "heavy.py"), "--on", "toy")
    assert "imports scipy at once; import it in the function that uses it" in done.stdout
    assert "its import changes os.environ[HEAVY_HERE]" in done.stdout
    assert "✓ gives the same in another process" in done.stdout
    assert re.search(r"✓ restores a view of a whole scene  .* s, .* of 0.0 megapixels of toy", done.stdout)


def test_another_process_that_restores_otherwise_is_noticed(tmp_path: Path) -> None:
    body = "first = min({'a', 'b', 'c', 'd', 'e', 'f', 'g', 'h'}, key=hash)\n"
    body += "return Restoration(view.rgb * np.float32(hash(first) % 97 / 97))"
    load_file(write(tmp_path, METHOD, body, needs="()"))
    plugin = find("method", "tried")
    (rule,) = [rule for rule in rules(plugin) if str(rule) == "gives the same in another process"]
    (outcome,) = check(Subject(plugin), [rule])
    assert outcome.status == "broken"
    assert "another process differs by up to" in outcome.findings[0].text


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("gray_wrld",), "no plugin is called 'gray_wrld'; did you mean 'gray_world'"),
        (("gray_world", "--kind", "metric"), "no metric is called 'gray_world'"),
        (("gray_world", "--on", "dmo"), "no dataset is called 'dmo'; did you mean 'demo'"),
        (("gray_world", "method.gain=2"), "no option 'gain'"),
        (("nowhere.py",), "no such plugin file"),
    ],
)
def test_the_command_refuses_what_is_not_there(arguments: tuple[str, ...], said: str) -> None:
    fault = run(*arguments).exception
    assert said in str(fault)
    assert isinstance(fault, (InputError, Exception))


def test_a_name_that_two_kinds_have_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb)", needs="()")
    path.write_text(
        path.read_text()
        + METRIC.format(needs=JUDGED, better="lower", body="")
        .replace("Tried", "Tried2 ")
        .replace("@metric(", '@metric(name="tried", ')
    )
    load_file(path)
    assert "is a method and a metric; say which with --kind method" in str(run("tried").exception)
    done = run(str(path), "--quick")
    assert done.stdout.index("method tried") < done.stdout.index("metric tried")
