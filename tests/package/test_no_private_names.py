"""Tests use what a caller may use: they neither import, read nor replace a name that begins with an underscore."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
from support.places import ROOT

PROJECT = {"sucre_bench", "methods", "datasets", "metrics"}
PUBLIC = {"_exit", "_fields"}  # documented names of os and of named tuples
BY_NAME = {"setattr", "delattr", "getattr", "hasattr", "patch", "object"}  # functions that take an attribute's name


def is_private(dotted: str) -> bool:
    return any(part.startswith("_") and not part.endswith("__") for part in dotted.split("."))


def private_names(source: str) -> Iterator[str]:
    """Each private name that is imported from the project, or belongs to another object than the test's own self."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names if alias.name.split(".")[0] in PROJECT]
        elif isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] in PROJECT:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Attribute):
            own = isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")
            names = [] if own or node.attr in PUBLIC else [node.attr]
        elif isinstance(node, ast.Call) and ast.unparse(node.func).split(".")[-1] in BY_NAME:
            names = [word.value for word in node.args if isinstance(word, ast.Constant) and isinstance(word.value, str)]
        else:
            continue
        yield from (f"line {node.lineno}: {name}" for name in names if is_private(name))


def test_no_test_uses_a_private_name() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    assert len(files) > 100
    used = [f"{path.relative_to(ROOT)}, {name}" for path in files for name in private_names(path.read_text())]
    assert not used, "\n".join(used)


@pytest.mark.parametrize(
    "source",
    [
        "from sucre_bench.scene import _plane",
        "from sucre_bench.scene import _plane as plane",
        "from sucre_bench._scene import plane",
        "import sucre_bench._scene",
        "def test():\n    from methods.udcp import _transmission",
        "scene._plane(1)",
        "module._Sample.of(1)",
        "Demo()._id()",
        "monkeypatch.setattr(scene, '_plane', None)",
        "monkeypatch.setattr('sucre_bench.scene._plane', None)",
        "getattr(scene, '_plane')",
    ],
)
def test_a_private_name_is_found(source: str) -> None:
    assert list(private_names(source))


@pytest.mark.parametrize(
    "source",
    [
        "from sucre_bench.scene import plane",
        "from __future__ import annotations",
        "import _thread",
        "def test(self):\n    self._view = plugin.__plugin__",
        "monkeypatch.setenv('_SUCRE_BENCH_COMPLETE', '1')",
    ],
)
def test_other_names_are_none(source: str) -> None:
    assert not list(private_names(source))
