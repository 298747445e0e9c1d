"""Tests assert data: classes, fields, names and numbers. What a message says in words may change at any time.

Whole outputs of commands are compared in one place, with the files of tests/commands/golden.
"""

from __future__ import annotations

import ast
import builtins
import re
from collections.abc import Iterator

import pytest
from support.places import ROOT

# Three words in a row; not a list ("depth and colour"), a command, a selector of a page or a part of a pattern.
WORDS = re.compile(r"(?<![\w./'\"=#*-])(?!pip )[A-Za-z]{2,},? (?!and |or )[a-z]+ (?!and |or )[a-z]{2,}(?![\w/=(])")
SEEKING = {"search", "match", "fullmatch", "findall", "startswith", "endswith", "count", "index", "partition"}
COMPARING = (ast.In, ast.NotIn, ast.Eq, ast.NotEq, ast.LtE)
Function = ast.FunctionDef | ast.AsyncFunctionDef


def texts(node: ast.AST) -> Iterator[ast.Constant]:
    """The strings of an expression, but those that are keys: names of columns, features or cases."""
    if isinstance(node, ast.Subscript):
        yield from texts(node.value)
    elif isinstance(node, ast.Dict):
        for value in node.values:
            yield from texts(value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield node
    else:
        for child in ast.iter_child_nodes(node):
            yield from texts(child)


def called(node: ast.Call) -> str:
    return ast.unparse(node.func).rpartition(".")[2]


def seeks(node: ast.Call) -> bool:
    """Whether a call looks for its arguments: functions of text, and the checks of tests/support."""
    return called(node) in SEEKING or called(node).startswith("check_")


def compared(tree: ast.AST) -> Iterator[ast.expr]:
    """What a file's tests compare with something, or look for."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assert):
            for part in ast.walk(node.test):
                if isinstance(part, ast.Compare) and all(isinstance(op, COMPARING) for op in part.ops):
                    yield from (part.left, *part.comparators)
                elif isinstance(part, ast.Call) and seeks(part):
                    yield from part.args
        elif isinstance(node, ast.keyword) and node.arg == "match":
            yield node.value
        elif isinstance(node, ast.Expr) and isinstance(node.value, ast.Call) and seeks(node.value):
            yield from node.value.args


def sought(tree: ast.AST) -> Iterator[ast.Constant]:
    """The strings that a file's tests look for, where they look or in a table of cases."""
    for node in compared(tree):
        yield from texts(node)
    assigned = {
        ast.unparse(target): node.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
    }
    for function in ast.walk(tree):
        if isinstance(function, Function):
            names = looked_for(function)
            for columns, table in tables(function, assigned):
                for column, cell in cells(columns, table):
                    if column in names:
                        yield from texts(cell)


def names_in(node: ast.AST) -> Iterator[str]:
    """The names of an expression, but those that it hands to a function of ours."""
    if isinstance(node, ast.Name):
        yield node.id
    elif isinstance(node, ast.Call) and not is_of_python(node):
        yield from names_in(node.func)
    else:
        for child in ast.iter_child_nodes(node):
            yield from names_in(child)


def is_of_python(node: ast.Call) -> bool:
    return seeks(node) or hasattr(builtins, called(node)) or called(node) in ("escape", "raises", "names", "format")


def looked_for(function: Function) -> set[str]:
    """The names whose values a test compares, and does not hand to the code."""
    names = {name for node in compared(function) for name in names_in(node)}
    steps = [(node.target, node.iter) for node in ast.walk(function) if isinstance(node, ast.For | ast.comprehension)]
    steps += [(node.targets[0], node.value) for node in ast.walk(function) if isinstance(node, ast.Assign)]
    for target, source in steps * 2:  # a name may be given on twice
        if names & set(names_in(target)):
            names |= set(names_in(source))
    calls = [node for node in ast.walk(function) if isinstance(node, ast.Call) and not is_of_python(node)]
    return names - {argument.id for call in calls for argument in call.args if isinstance(argument, ast.Name)}


def tables(function: Function, assigned: dict[str, ast.expr]) -> Iterator[tuple[list[str], ast.expr]]:
    """The tables of cases that a test gets or goes through, with the names of their columns."""
    for node in function.decorator_list:
        if isinstance(node, ast.Call) and called(node) == "parametrize":
            columns = ast.literal_eval(node.args[0])
            names = columns.replace(" ", "").split(",") if isinstance(columns, str) else list(columns)
            yield names, written_out(node.args[1], assigned)
    for loop in ast.walk(function):
        if isinstance(loop, ast.For):
            yield list(names_in(loop.target)), written_out(loop.iter, assigned)


def written_out(table: ast.expr, assigned: dict[str, ast.expr]) -> ast.expr:
    """A table where it is written: under its name, or as the entries of a dictionary."""
    if isinstance(table, ast.Call) and isinstance(table.func, ast.Attribute) and table.func.attr in ("items", "values"):
        made = written_out(table.func.value, assigned)
        if isinstance(made, ast.Dict):
            pairs = zip(made.keys, made.values, strict=True)
            return ast.Tuple([v if table.func.attr == "values" or not k else ast.Tuple([k, v]) for k, v in pairs])
    return assigned.get(ast.unparse(table), table)


def cells(columns: list[str], table: ast.expr) -> Iterator[tuple[str, ast.expr]]:
    """The cells of a table with the name of their column."""
    rows = table.elts if isinstance(table, ast.List | ast.Tuple) else [table]
    for row in rows:
        parts = row.elts if isinstance(row, ast.Tuple) and len(columns) > 1 else [row]
        if isinstance(row, ast.Call) and called(row) == "param":
            parts = row.args
        yield from zip(columns, parts if len(parts) == len(columns) else [row] * len(columns), strict=True)


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


def enumerated() -> str:
    """The values of the types of sucre_bench that list theirs: names of kinds may be several words."""
    sources = (path.read_text("utf-8") for path in (ROOT / "sucre_bench").rglob("*.py"))
    return "\n".join(listed for source in sources for listed in re.findall(r"Literal\[([^]]*)\]", source))


def test_no_test_asserts_prose() -> None:
    files = sorted((ROOT / "tests").rglob("*.py"))
    assert len(files) > 100
    shared = "\n".join(written(ast.parse(path.read_text("utf-8"))) for path in files if "support" in path.parts)
    shared = f"{shared}\n{enumerated()}"
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
