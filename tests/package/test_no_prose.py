"""Tests assert data: classes, fields, names and numbers. What a message says in words may change at any time.

Whole outputs of commands are compared in one place, with the files of tests/commands/golden.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
from support.places import ROOT

# Three words in a row; not a list ("depth and colour"), a command, a selector of a page or a part of a pattern.
WORDS = re.compile(r"(?<![\w./'\"=#*-])(?!pip )[A-Za-z]{2,},? (?!and |or )[a-z]+ (?!and |or )[a-z]{2,}(?![\w/=(])")
SEEKING = {"search", "match", "fullmatch", "findall", "startswith", "endswith", "count", "index", "partition"}
COMPARING = (ast.In, ast.NotIn, ast.Eq, ast.NotEq)


def texts(node: ast.AST) -> Iterator[ast.Constant]:
    """The strings of an expression, but those that are keys: names of columns or features."""
    if isinstance(node, ast.Subscript):
        yield from texts(node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node
    else:
        for child in ast.iter_child_nodes(node):
            yield from texts(child)


def sought(tree: ast.AST) -> Iterator[ast.Constant]:
    """The strings that a file's tests compare with something, or look for."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            for part in ast.walk(node.test):
                if isinstance(part, ast.Compare) and all(isinstance(op, COMPARING) for op in part.ops):
                    for side in (part.left, *part.comparators):
                        yield from texts(side)
                elif isinstance(part, ast.Call) and ast.unparse(part.func).split(".")[-1] in SEEKING:
                    for argument in part.args:
                        yield from texts(argument)
        elif isinstance(node, ast.keyword) and node.arg == "match":
            yield from texts(node.value)


def written(tree: ast.AST) -> str:
    """All strings of a file but those that its tests look for: what it hands to the code."""
    looked_for = {id(text) for text in sought(tree)}
    strings = (n for n in ast.walk(tree) if isinstance(n, ast.Constant) and isinstance(n.value, str))
    return "\n".join(str(one.value) for one in strings if id(one) not in looked_for)


def prose(source: str, shared: str = "") -> Iterator[str]:
    """Each sought string of three words or more that neither the file nor the shared helpers hand to the code."""
    tree = ast.parse(source)
    handed = f"{shared}\n{written(tree)}"
    for text in sought(tree):
        said = WORDS.search(str(text.value))
        if said and said[0] not in handed:
            yield f"line {text.lineno}: {text.value!r}"


def test_no_test_asserts_prose() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    assert len(files) > 100
    shared = "\n".join(written(ast.parse(path.read_text("utf-8"))) for path in files if "support" in path.parts)
    found = [f"{path.relative_to(ROOT)}, {text}" for path in files for text in prose(path.read_text("utf-8"), shared)]
    assert not found, "\n".join(["assert the class, the field or the names in the message, no words:", *found])


@pytest.mark.parametrize(
    "source",
    [
        "assert 'no such file' in done.stderr",
        "assert 'nothing to do' not in said",
        "assert str(fault.value) == 'a.png: is not an image'",
        "assert any('cannot be read' in line for line in lines)",
        "assert f'{name}: holds no such {kind}' in said",
        "assert re.search(r'a\\.png: has no depth', said)",
        "assert said.startswith('no pixel is seen')",
        "with pytest.raises(InputError, match=r'is no camera'): pass",
        "with pytest.raises(InputError, match=f'{name}: cannot be read'): pass",
    ],
)
def test_prose_is_found(source: str) -> None:
    assert list(prose(source))


@pytest.mark.parametrize(
    "source",
    [
        "assert 'a.png: ' in done.stderr",
        "assert re.search(r'12x8, .*6x4; .*method\\.resize', said)",
        "assert notes == [Note('images lost', ('b',), n=3)]",
        "assert states['tests in a browser'] == 'missing'",
        "row = Row(reason='no such folder')\nassert 'no such folder' in page.text",
        "raise InputError('holds no scene; give another')",
        "assert page.ask('#scores-sheet tbody tr') == 3",
        "assert re.search('camera, pose and depth', said)",
        "assert said.endswith('pip install onnx')",
    ],
)
def test_data_are_none(source: str) -> None:
    assert not list(prose(source))
