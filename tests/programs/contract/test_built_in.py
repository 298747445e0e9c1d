"""What every plugin must keep to, whoever wrote it: the rules of `sucre-bench check`, on all that is built in."""

import ast
import functools
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.command_line import HEAVY
from support.datasets_in_miniature import MINIATURES
from support.made_networks import ARCHITECTURES, network_options

import sucre_bench
from sucre_bench import plugins
from sucre_bench.plugins.plugin import KINDS, Plugin
from sucre_bench.plugins.registry import discover
from sucre_bench.programs.contract.contract import Subject, check
from sucre_bench.programs.contract.made_scenes import wall

pytestmark = pytest.mark.short

# Names of plugins that mean something else in the engine: roles of metrics, figures, quantities, packages.
ORDINARY_WORDS = {
    "command",
    "coverage",
    "faults",
    "hue",
    "negative",
    "observations",
    "onnx",
    "photos",
    "seams",
}
ORDINARY_WORDS |= {"colours", "water"}
NORMALISATIONS = {"display.py", "white_balance.py"}  # gray_world is one of them too
# The datasets that know the models of other programs; the presets that are gone, and what to use; the forms of PSNR and
# SSIM that papers compute, in words.
TABLES = {"given.py", "catalogue.py", "match_published.py"}
QUICK: dict[str, dict[str, Any]] = {
    "sucre_paper": {"steps": 3},
    # To choose them takes several times as long as all the rest, and has tests of its own.
    "sucre": {"light": "even", "footprint": True, "physical": False, "robust": False},
    "sucre_plus": {"light": "even", "footprint": True, "physical": False, "robust": False},
    "command": {"run": "cp {input} {output}"},
}

SMALL: dict[str, Any] = {"width": 64, "height": 48, "views": 2}  # of made scenes


def built_in(kind: plugins.Kind) -> list[Plugin]:
    found = [p for p in discover(kind).values() if isinstance(p, Plugin)]
    return [p for p in found if p.cls.__module__.startswith("sucre_bench.")]


ALL = [plugin for kind in plugins.KINDS for plugin in built_in(kind)]


def options_for(plugin: Plugin, folder: Path) -> dict[str, Any]:
    """Options that make a plugin quick, and those that must be given: data in miniature, a program, weights."""
    if plugin.kind == "dataset":
        return _data(plugin.name, folder)
    if plugin.name == "precomputed":
        for view in wall():
            np.save(folder / f"{Path(view.name).stem}.npy", view.rgb)
        return {"folder": folder, "resize": True}
    if plugin.name in (*ARCHITECTURES, "onnx"):
        return _network(plugin.name, folder.parent)  # the folder of all tests of this process
    return QUICK.get(plugin.name, {})


_network = functools.cache(network_options)  # up to 45 MB to write


def _data(name: str, folder: Path) -> dict[str, Any]:
    if name == "demo":
        return {"root": folder.parent / "demo", **SMALL}
    if name == "nature":
        return {"root": folder, **SMALL}
    if name in MINIATURES:
        MINIATURES[name].write_into(folder)
    return {"root": folder}


@pytest.mark.parametrize("plugin", ALL, ids=[f"{p.kind}-{p.name}" for p in ALL])
def test_every_plugin_keeps_the_contract(plugin: Plugin, tmp_path: Path) -> None:
    subject = Subject(plugin, options_for(plugin, tmp_path))
    outcomes = list(check(subject, lasting=False))
    assert not [
        f"{outcome.rule}: {finding.text}"
        for outcome in outcomes
        for finding in outcome.findings
        if finding.level in ("breach", "doubt")
    ]
    assert not [f"{outcome.rule}: {outcome.skipped}" for outcome in outcomes if outcome.skipped]


def test_importing_every_plugin_brings_nothing_heavy() -> None:
    (package,) = {plugin.cls.__module__.partition(".")[0] for plugin in ALL}
    modules = sorted({plugin.cls.__module__ for plugin in ALL})
    code = f"import sys, importlib; import {package}.plugins; known = set(sys.modules)\n"
    code += f"for name in {modules}: importlib.import_module(name)\nprint(*(set(sys.modules) - known))"
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert not {*HEAVY, "matplotlib"} & set(done.stdout.split())


def test_no_room_names_a_plugin() -> None:
    """Everything runs and shows any plugin alike: only a command's default may name one.

    Looked for are whole strings, and "NAME:" of a score's key; docstrings may have examples.
    """
    engine = Path(sucre_bench.__file__).parent
    names = {p.name for kind in KINDS for p in built_in(kind)} - ORDINARY_WORDS
    # parsing every file takes seconds
    quoted = re.compile(rf"""["'`]({"|".join(names)})["'`:]""")
    plugin_folders = {"methods", "metrics", "datasets", "conf", "commands"}
    for path in engine.rglob("*"):
        room = path.relative_to(engine).parts[0]
        if (
            room in plugin_folders
            or not path.name.endswith((".py", ".js", ".html.j2"))
            or path.name in NORMALISATIONS | TABLES
        ):
            continue
        text = path.read_text(encoding="utf-8")
        found = (
            {text.partition(":")[0] for text in strings_of(path, text)} & names
            if quoted.search(text)
            else set()
        )
        assert not found, f"{path.relative_to(engine)} names {sorted(found)}"


def strings_of(path: Path, text: str) -> Iterator[str]:
    """The strings of a program, without docstrings."""
    if path.suffix != ".py":
        text = re.sub(r"^\s*//.*", "", text, flags=re.MULTILINE)
        yield from (match[1] for match in re.finditer(r"""["'`]([\w:]+)""", text))
        return
    tree = ast.parse(text)
    bodies = [
        node.body
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
    ]
    docstrings = {id(b[0].value) for b in bodies if b and isinstance(b[0], ast.Expr)}
    for node in ast.walk(tree):
        if (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in docstrings
        ):
            yield node.value
