"""Each way a plugin breaks the contract is found, named, and told how to mend; the command that says it."""

from __future__ import annotations

import itertools
import json
import re
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from support.colmap_folder import write_dive
from support.forward_model import seen_through
from support.messages import names

from sucre_bench import InputError, PluginError, plugins
from sucre_bench.commands.extend import check as command
from sucre_bench.plugins.registry import find, load_file
from sucre_bench.programs.contract.contract import Subject, breaches, check
from sucre_bench.programs.contract.made_scenes import WATER, charted

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


def broken(
    folder: Path, kind: plugins.Kind, template: str, body: str, **filled: Any
) -> dict[str, str]:
    """The breaches by the name of their rule, a line each; why a rule could not be checked."""
    load_file(write(folder, template, body, **filled))
    subject = Subject(
        plugins.find(kind, "tried"), {"root": write_dive(folder)} if kind == "dataset" else {}
    )
    said: dict[str, str] = {}
    for one in check(subject, lasting=False):
        lines = [text for level, text in one.findings if level == "breach"] + [
            one.skipped
        ] * bool(one.skipped)
        said |= {one.name: "\n".join(lines)} if lines else {}
    return said


GOOD = "image = view.rgb * np.float32(self.gain)\n"
FADED = "if not view.valid.any():\n    raise NotApplicableError(f'{view.name}: no pixel has depth')\n"
HOLES = "image = np.where(view.valid[..., None], view.rgb * np.exp(0.5 * view.depth)[..., None], np.nan)\n"
JUDGED = "{'reference'}"

DECLARED = "{'depth', 'poses'}"


@pytest.mark.parametrize(
    ("has", "body", "rule", "named"),
    [
        (DECLARED, "rgb = rgb * 255", "planes_are_sound", "255"),
        (DECLARED, "rgb = rgb * 2", "planes_are_sound", "[0, 1]"),
        (DECLARED, "rgb[0] = np.nan", "planes_are_sound", "finite"),
        (DECLARED, "depth[0] = -1", "planes_are_sound", "negative"),
        (DECLARED, "depth[0] = np.nan", "planes_are_sound", "NaN"),
        (DECLARED, "depth = depth[1:]", "planes_are_sound", "(5, 8)"),
        (DECLARED, "pose[0, 0] = 2", "geometry_is_sound", "View.cam_from_world"),
        (DECLARED, "pose = pose[:3]", "geometry_is_sound", "(4, 4)"),
        (DECLARED, "K[0, 0] = -8", "geometry_is_sound", "-8"),
        (DECLARED, "K[0, 2] = .5 - 4", "geometry_is_sound", "(-3.5, 3)"),
        (DECLARED, "K = K.T", "geometry_is_sound", "Camera.K"),
        (DECLARED, "name = '/a.png'", "names_once", "'/a.png'"),
        (DECLARED, "data_id = ''", "is_repeatable", "data_id"),
        (
            DECLARED,
            "data_id = str(id(rgb)) + str(os.urandom(3))",
            "is_repeatable",
            "data_id",
        ),
        (
            DECLARED,
            "rgb = np.random.rand(6, 8, 3).astype('f4')",
            "is_repeatable",
            "a.png",
        ),
        (DECLARED, "depth = None", "has_what_it_says", "depth"),
        ("{'poses'}", "", "has_what_it_says", "has="),
    ],
)
def test_each_way_a_dataset_breaks_the_contract_is_named(
    tmp_path: Path, has: str, body: str, rule: str, named: str
) -> None:
    assert named in names(broken(tmp_path, "dataset", DATASET, body, has=has)[rule])


def test_a_fault_that_no_need_would_mend_does_not_ask_for_one(tmp_path: Path) -> None:
    body = "return Restoration(view.rgb * np.float32(255))"
    said = broken(tmp_path, "method", METHOD, body, needs="()")
    assert "divide by 255" in said["restores_a_view"]
    assert "needs=" not in said["runs_with_least"]


def test_a_dataset_must_name_the_folder_that_is_missing(tmp_path: Path) -> None:
    rough = DATASET.replace(
        'raise InputError(f"{{self.root}}: holds no scene; give another")',
        "raise OSError('no data')",
    )
    found = broken(tmp_path, "dataset", rough, "", has=DECLARED)
    assert list(found) == ["names_what_is_missing"]
    missing, empty = found["names_what_is_missing"].splitlines()
    for line in (missing, empty):
        assert {"root", "cannot", "read", "data", "InputError"} <= names(line)


def test_a_network_that_fails_on_thumbnails_is_in_doubt(tmp_path: Path) -> None:
    body = "if min(view.rgb.shape[:2]) < 32:\n    raise ValueError('larger kernel')\nreturn Restoration(view.rgb * 1)"
    load_file(write(tmp_path, METHOD, body, needs="()"))
    outcomes = {one.name: one for one in check(Subject(find("method", "tried")), lasting=False)}
    assert "broken" not in {one.status for one in outcomes.values()}
    (finding,) = outcomes["colours_what_is_valid"].findings
    assert (finding.level, finding.text.startswith("tiny: ")) == ("doubt", True)


# By rule: what a method's restore() does between GOOD and the return of `image`, and the words of the breach.
BREACHES: list[tuple[str, str, str]] = [
    (
        "colours_what_is_valid",
        "image = image / view.rgb.max(axis=2, keepdims=True)",
        "black",
    ),
    ("colours_what_is_valid", "image = image / view.rgb.max()", "RuntimeWarning"),
    ("colours_what_is_valid", "image[0, 0, 0] = np.nan", "NaN"),
    ("restores_a_view", "image = image[::2]", "(32, 96, 3)"),
    ("restores_a_view", "view.rgb[:] = 0", "tried.py"),
    ("restores_a_view", "raise KeyError('x')", "'x'"),
    ("leaves_holes", "image[~view.valid] = np.nan", "1280"),
    (
        "is_deterministic",
        "image *= np.random.rand(*image.shape[:2], 1)",
        "np.random.default_rng(self.seed",
    ),
    ("runs_with_least", "image *= view.depth.mean()", "far.png"),
    (
        "keeps_its_eyes_off",
        "image = image if view.reference is None else view.reference * 1",
        "needs=",
    ),
    (
        "keeps_its_eyes_off",
        "image *= scene.water.attenuation[0] if scene.water else 1",
        "needs=",
    ),
    (
        "restores_a_view",
        "return Restoration(image, confidence=np.ones(5))",
        "(5,)",
    ),
    (
        "restores_a_view",
        "return Restoration(image, Water(np.ones(2), np.ones(3), np.ones(3)))",
        "(3,)",
    ),
]
WITH_DEPTH: list[tuple[str, str, str]] = [
    (
        "leaves_holes",
        "image = image * (1 + view.depth[..., None])",
        "image[~view.valid]",
    ),
    (
        "skips_what_has_no_depth",
        f"if not view.valid.any():\n    raise SolveError('none')\n{HOLES}",
        "none",
    ),
    ("skips_what_has_no_depth", HOLES, "far.png"),
]


@pytest.mark.parametrize(
    ("needs", "rule", "body", "named"),
    [*(("()", *case) for case in BREACHES), *(("{'depth'}", *case) for case in WITH_DEPTH)],
)
def test_each_way_a_method_breaks_the_contract_is_named(
    tmp_path: Path, needs: str, rule: str, body: str, named: str
) -> None:
    found = broken(
        tmp_path, "method", METHOD, f"{GOOD}{body}\nreturn Restoration(image)", needs=needs
    )
    assert named in names(found[rule]), found


def test_what_is_no_fault_for_sure_is_a_doubt(tmp_path: Path) -> None:
    body = FADED + "image = view.rgb * 1\nimage[~view.valid] = np.nan\n"
    body += "if view.rgb.std() < .1:\n    raise SolveError('too flat; move nearer')\nreturn Restoration(image)"
    load_file(write(tmp_path, METHOD, body, needs="{'depth', 'poses'}"))
    plugin = find("method", "tried")
    outcomes = check(Subject(plugin), lasting=False)
    said = {
        one.rule: [f.text for f in one.findings] for one in outcomes if one.status == "doubtful"
    }
    (colours,) = said.values()
    assert re.match("black: .*too flat; move nearer; ", colours[0])


def test_what_is_not_explained_or_cannot_be_set_is_named(tmp_path: Path) -> None:
    bare = (
        METHOD.replace("'''A method that is tried.'''", "")
        .replace("'''A factor.'''", "")
        .replace("= 1.0", "= 'much'")
    )
    found = broken(tmp_path, "method", bare, "return Restoration(view.rgb)", needs="()")
    assert {"Tried", "docstring", "'gain'"} <= names(found["is_described"])
    assert {"default", "type"} <= names(found["is_described"])


def test_an_option_that_must_be_given_leaves_rules_unlooked_at_and_says_so(
    tmp_path: Path,
) -> None:
    asking = METHOD.replace("= 1.0", "")
    found = broken(tmp_path, "method", asking, GOOD + "return Restoration(image)", needs="()")
    # once
    assert [text for text in found.values() if "method.gain=..." in text] == [
        found["restores_a_view"]
    ]
    assert found["is_deterministic"] == "for the reason above"
    assert breaches("method", "tried", gain=1.0) == []


# -- the command -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("needs", "better", "body", "rule", "named"),
    [
        (
            JUDGED,
            "lower",
            "value = 2 * value + 1",
            "runs_with_least",
            "range=",
        ),
        (JUDGED, "lower", "coverage = 100 * coverage", "stays_in_range", "coverage"),
        (JUDGED, "higher", "", "prefers_the_truth", "0"),
        ("()", "lower", "", "runs_with_least", "TypeError"),
        (
            JUDGED,
            "lower",
            "value = 0.5 if np.isnan(value) else value",
            "scores_no_holes",
            "0.5",
        ),
        (JUDGED, "lower", "shown[:] = 0", "stays_in_range", "ValueError"),
        (
            JUDGED,
            "lower",
            "value = value * np.random.rand()",
            "gives_the_same_twice",
            "all",
        ),
        (
            JUDGED,
            "lower",
            "for n in range(random.randrange(99)): yield Score(value, region=f'part{n}')",
            "gives_the_same_twice",
            "all",
        ),
        (
            JUDGED,
            "lower",
            "if not seen.any(): raise ValueError('empty')",
            "scores_no_holes",
            "ValueError",
        ),
    ],
)
def test_each_way_a_metric_breaks_the_contract_is_named(
    tmp_path: Path, needs: str, better: str, body: str, rule: str, named: str
) -> None:
    assert named in names(
        broken(tmp_path, "metric", METRIC, body, needs=needs, better=better)[rule]
    )


def run(*arguments: str) -> Result:
    return CliRunner().invoke(command, arguments)


def test_the_command_takes_options_and_gives_json(tmp_path: Path) -> None:
    body = "assert self.gain == 0.5\nreturn Restoration(view.rgb * np.float32(self.gain))"
    path = write(tmp_path, METHOD, body, needs="()")
    done = run(str(path), "method.gain=0.5", "--quick", "--json")
    (told,) = json.loads(done.stdout)
    assert (told["kind"], told["name"]) == ("method", "tried")
    assert (told["ok"], done.exit_code) == (True, 0)
    assert {rule["status"] for rule in told["rules"]} == {"kept"}
    assert run(str(path), "--quick").exit_code == 1


def test_the_command_imports_in_another_process(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb)", needs="()")
    path.write_text(f"import scipy.linalg\n{path.read_text()}")
    assert "imports scipy " in run(str(path)).stdout


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("gray_world", "--kind", "metric"), "'gray_world'"),
        (("gray_world", "method.gain=2"), "'gain'"),
        (("nowhere.py",), "nowhere.py"),
    ],
)
def test_the_command_refuses_what_is_not_there(arguments: tuple[str, ...], named: str) -> None:
    fault = run(*arguments).exception
    assert isinstance(fault, PluginError if named == "nowhere.py" else InputError)
    assert named in names(fault)


def test_a_name_that_two_kinds_have_is_asked_about(tmp_path: Path) -> None:
    path = write(tmp_path, METHOD, "return Restoration(view.rgb)", needs="()")
    metric = METRIC.format(needs=JUDGED, better="lower", body="").replace("Tried", "Tried2 ")
    path.write_text(path.read_text() + metric.replace("@metric(", '@metric(name="tried", '))
    load_file(path)
    assert re.search("method.*metric; .*--kind method", str(run("tried").exception))
    done = run(str(path), "--quick")
    assert done.stdout.index("method tried") < done.stdout.index("metric tried")


def test_the_water_of_the_contract_is_that_of_the_model() -> None:
    """Methods are checked on these scenes: a wrong sign here would let the same wrong sign there pass."""
    view = charted()["far.png"]
    B, beta, gamma = (WATER.veiling_light, WATER.attenuation, WATER.backscatter)
    for y, x, c in itertools.product((0, 20, 60, 95), (0, 30, 70, 127), range(3)):
        expected = seen_through(
            float(view.reference[y, x, c]), view.distance[y, x], B[c], beta[c], gamma[c]
        )
        assert view.rgb[y, x, c] == pytest.approx(expected, abs=1e-6)
