"""Tests assert data: classes, fields, names and numbers. What a message says in words may change at any time.

Whole error lines are compared in one place, one for each command: tests/commands/test_errors.py.
"""

from __future__ import annotations

import ast
import builtins
import functools
import re
from collections.abc import Iterable, Iterator

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


def compared(nodes: Iterable[ast.AST]) -> Iterator[ast.expr]:
    """What the tests among the nodes compare with something, or look for."""
    for node in nodes:
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


def sought(nodes: list[ast.AST]) -> Iterator[ast.Constant]:
    """The strings that a file's tests look for, where they look or in a table of cases."""
    for node in compared(nodes):
        yield from texts(node)
    assigned = {
        ast.unparse(target): node.value
        for node in nodes
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.value
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }
    for function in nodes:
        if isinstance(function, Function):
            within = list(ast.walk(function))
            cases = list(tables(function, within, assigned))
            names = looked_for(within) if cases else set()
            for columns, table in cases:
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


def looked_for(nodes: list[ast.AST]) -> set[str]:
    """The names whose values a test compares, and does not hand to the code."""
    names = {name for node in compared(nodes) for name in names_in(node)}
    steps = [(node.target, node.iter) for node in nodes if isinstance(node, ast.For | ast.comprehension)]
    steps += [(node.targets[0], node.value) for node in nodes if isinstance(node, ast.Assign)]
    for target, source in steps * 2:  # a name may be given on twice
        if names & set(names_in(target)):
            names |= set(names_in(source))
    calls = [node for node in nodes if isinstance(node, ast.Call) and not is_of_python(node)]
    return names - {argument.id for call in calls for argument in call.args if isinstance(argument, ast.Name)}


def tables(
    function: Function, within: list[ast.AST], assigned: dict[str, ast.expr]
) -> Iterator[tuple[list[str], ast.expr]]:
    """The tables of cases that a test gets or goes through, with the names of their columns."""
    for node in function.decorator_list:
        if isinstance(node, ast.Call) and called(node) == "parametrize":
            columns = ast.literal_eval(node.args[0])
            names = columns.replace(" ", "").split(",") if isinstance(columns, str) else list(columns)
            yield names, written_out(node.args[1], assigned)
    for loop in within:
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


@functools.cache
def read(source: str) -> tuple[list[ast.Constant], str]:
    """The strings that a file's tests look for; all its other strings: what it hands to the code."""
    nodes = list(ast.walk(ast.parse(source)))
    looked_for = list(sought(nodes))
    known = {id(text) for text in looked_for}
    strings = (n for n in nodes if isinstance(n, ast.Constant) and isinstance(n.value, str) and id(n) not in known)
    return looked_for, "\n".join(str(one.value) for one in strings)


def prose(source: str, shared: str = "") -> Iterator[str]:
    """Each sought string of three words or more that neither the file nor the shared helpers hand to the code."""
    looked_for, handed = read(source)
    for text in looked_for:
        said = WORDS.search(str(text.value))
        if said and said[0] not in handed and said[0] not in shared:
            yield f"line {text.lineno}: {text.value!r}"


def enumerated() -> str:
    """The values of the types of sucre_bench that list theirs: names of kinds may be several words."""
    sources = (path.read_text("utf-8") for path in (ROOT / "sucre_bench").rglob("*.py"))
    return "\n".join(listed for source in sources for listed in re.findall(r"Literal\[([^]]*)\]", source))


def test_no_test_asserts_prose() -> None:
    sources = {path: path.read_text("utf-8") for path in sorted((ROOT / "tests").rglob("*.py"))}
    assert len(sources) > 100
    shared = "\n".join([enumerated(), *(read(text)[1] for path, text in sources.items() if "support" in path.parts)])
    found = [f"{path.relative_to(ROOT)}, {text}" for path in sources for text in prose(sources[path], shared)]
    assert not found, "\n".join(["assert the class, the field or the names in the message, no words:", *found])


CASES = "@pytest.mark.parametrize(('word', 'said'), {})\ndef test(word, said):\n    {}"


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
        "assert {'nothing', 'is not there'} <= names(fault.value)",
        "check_message(str(fault.value), 'has no depth')",
        CASES.format("[('a', 'no such file')]", "assert said in str(fault.value)"),
        CASES.format("[pytest.param('a', 'no such file')]", "assert said in str(fault.value)"),
        CASES.format("[('a', ['file', 'no such file'])]", "assert all(one in message for one in said)"),
        CASES.format("[('a', 'no such file')]", "text = said.format(word)\n    assert re.search(text, message)"),
        CASES.format("[('a', 'no such file')]", "with pytest.raises(InputError, match=said): pass"),
        "MADE = {'a': ('a', 'no such file')}\n" + CASES.format("MADE.values()", "assert said in message"),
        "def test():\n    for word, said in [('a', 'no such file')]:\n        assert said in run(word)",
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
        CASES.format("[('a', {'file', 'a.png'})]", "assert said <= names(fault.value)"),
        CASES.format("[('no such file', 'a')]", "assert said in run(word)"),
        CASES.format("[('a', 'no such file')]", "assert reason_of(said) == said"),
        "MADE = {'no such file': ('a', 'b')}\n" + CASES.format("MADE.values()", "assert said in message"),
    ],
)
def test_data_are_none(source: str) -> None:
    assert not list(prose(source))
