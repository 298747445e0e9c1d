"""What methods advise can be typed: every option that a text names, after the name of a method that has it."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.places import ROOT

from sucre_bench import plugins
from sucre_bench.jobs import compose_jobs
from sucre_bench.methods.sucre import Sucre, SucrePaper, SucrePlus
from sucre_bench.methods.sucre.record import faults_of_colours
from sucre_bench.plugins.options import options_of

_WORD = re.compile(
    r"(?<![\w.{-])(?:(?P<owner>[a-z_]+)\.)?(?P<option>[a-z_]+)=(?P<value>[A-Za-z0-9-][\w-]*)"
)


def texts(file: Path) -> Iterator[str]:
    """The texts of a file's code, without docstrings; {} where a text takes in a value."""
    tree = ast.parse(file.read_text())
    documented = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    parts = {
        id(part)
        for node in ast.walk(tree)
        if isinstance(node, ast.JoinedStr)
        for part in node.values
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.JoinedStr):
            yield "".join(
                str(part.value) if isinstance(part, ast.Constant) else "{}"
                for part in node.values
            )
        elif (
            isinstance(node, ast.Constant)
            and isinstance(node.value, str)
            and id(node) not in documented | parts
        ):
            yield node.value


def advised() -> Iterator[tuple[str, str, str, str]]:
    """Each option in the texts of methods: the file, the method before it, its name and value."""
    folder = ROOT / "methods"
    of_program = {folder / "networks" / "export.py"}  # which has words of its own
    for file in sorted({*folder.rglob("*.py")} - of_program):
        for text in texts(file):
            for found in _WORD.finditer(text):
                yield (
                    str(file.relative_to(folder)),
                    found["owner"] or "",
                    found["option"],
                    found["value"],
                )


def methods_of(file: str) -> list[str]:
    """The methods in a file, or in its folder."""
    home = Path(file).parts[0].removesuffix(".py")
    every = plugins.usable("method").values()
    return [plugin.name for plugin in every if home in plugin.cls.__module__.split(".")]


def words() -> list[tuple[str, str]]:
    """Every advised option, with a method that it is advised for."""
    found = set()
    for file, owner, option, value in advised():
        if option in ("method", "dataset"):
            continue
        owners = methods_of(file) if owner == "method" else [owner]
        having = [
            name
            for name in owners
            if option in {o.name for o in options_of(plugins.find("method", name).cls)}
        ]
        assert having or option == "display", f"{file}: no method has {owner}.{option}={value}"
        found |= {(name, f"{name}.{option}={value}") for name in having}
    return sorted(found)


def test_every_advised_word_can_be_typed(tmp_path: Path):
    (tmp_path / "water.json").write_text(
        '{"B": [0.1, 0.2, 0.3], "beta": [0.4, 0.2, 0.1], "gamma": [0.3, 0.2, 0.1]}'
    )
    places = {"FILE": tmp_path / "water.json", "FOLDER": tmp_path}
    must = {
        "onnx": "onnx.model=net.onnx",
        "command": "command.run='cp {image} {output}'",
        "precomputed": f"precomputed.folder={tmp_path}",
    }
    for method, word in words():
        key, _, value = word.partition("=")
        needed = (
            [must[method]] if method in must and must[method].partition("=")[0] != key else []
        )
        advised = f"{key}={places.get(value, value)}"
        (job,) = compose_jobs.jobs(
            ["dataset=demo", f"method={method}", "metrics=[psnr]", *needed, advised], False
        ).jobs
        assert job.method.plugin.name == method


@pytest.mark.parametrize(
    ("method", "options", "advice"),
    [
        (SucrePaper, {}, ("method=sucre_plus keeps", "method=sucre_plus draws")),
        (Sucre, {}, ("method.physical=true keeps", "method.refine=true draws")),
        (SucrePlus, {}, ("method.physical=true keeps", "")),
        (SucrePlus, {"physical": True}, ("", "")),
        (Sucre, {"water": "truth"}, ("", "method.refine=true draws")),
    ],
)
def test_colours_that_are_wrong_are_mended_by_options_that_the_method_takes(
    method: Any, options: dict[str, str], advice: tuple[str, str]
):
    said = faults_of_colours(np.array([0.5, 0, 0]), np.array([0.5, 0, 0]), method(**options))
    remedies = [line.partition("; ")[2] for line in said]
    assert [" ".join(remedy.split()[:2]) for remedy in remedies] == list(advice)
