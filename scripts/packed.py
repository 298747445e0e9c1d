"""Counts constructions that pack several things into one line; `make check` fails if a room has more than its limit.

No room has any, but for "three joined": a limit is what the room had when it was last unpacked. Lower it whenever you
unpack, and never raise it. The rules:

assigned      an assignment inside a call, a condition or a comprehension that is used after that statement
parallel      several names on the left and as many unlike expressions on the right (`a, b = f(x), {}`)
text times    text or a list times a condition (`["x"] * bool(y)`)
nested if     a conditional expression within another one
three joined  three or more parts of one `and` or `or`, unless all are plain names and comparisons of them
told above    fields that the docstring of their class tells ("name: text; other: text") and not a text below each
"""

from __future__ import annotations

import ast
import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
JOINED = "three joined"
ROOMS = ("sucre_bench", "methods", "datasets", "metrics")
# The most of the rule "three joined"; of the other rules no room has any.
LIMITS: dict[str, int] = {
    "datasets": 15,
    "methods": 15,
    "sucre_bench": 9,
    "sucre_bench/commands": 2,
    "sucre_bench/compare": 9,
    "sucre_bench/degrade": 1,
    "sucre_bench/engine": 3,
    "sucre_bench/imaging": 4,
    "sucre_bench/jobs": 9,
    "sucre_bench/loading": 9,
    "sucre_bench/machine": 4,
    "sucre_bench/multiview": 3,
    "sucre_bench/plugins": 5,
    "sucre_bench/programs": 21,
    "sucre_bench/reports": 2,
    "sucre_bench/results": 1,
}


def packed(tree: ast.Module) -> Iterator[tuple[int, str]]:
    """Yield the line and the rule of each packed construction."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            yield from _assigned(function)
    for node in ast.walk(tree):
        if isinstance(node, ast.ClassDef) and _tells_fields(node):
            yield node.lineno, "told above"
        elif isinstance(node, ast.Assign) and _is_parallel(node):
            yield node.lineno, "parallel"
        elif (
            isinstance(node, ast.BinOp)
            and isinstance(node.op, ast.Mult)
            and _is_text_times(node)
        ):
            yield node.lineno, "text times"
        elif isinstance(node, ast.IfExp) and any(
            isinstance(part, ast.IfExp) for part in (node.body, node.orelse)
        ):
            yield node.lineno, "nested if"
        elif (
            isinstance(node, ast.BoolOp)
            and len(node.values) > 2
            and not all(map(_is_plain, node.values))
        ):
            yield node.lineno, JOINED


def _assigned(function: ast.FunctionDef) -> Iterator[tuple[int, str]]:
    """Assignment expressions whose name is read after the statement that has them."""
    statements = [
        node
        for node in ast.walk(function)
        if isinstance(node, ast.stmt) and node is not function
    ]
    reads = [
        (node.id, node.lineno) for node in ast.walk(function) if isinstance(node, ast.Name)
    ]
    seen = set[int]()
    for statement in sorted(statements, key=lambda node: (node.end_lineno or 0) - node.lineno):
        for node in ast.walk(statement):
            if not isinstance(node, ast.NamedExpr) or id(node) in seen:
                continue
            seen.add(id(node))
            last = statement.end_lineno or statement.lineno
            if any(name == node.target.id and line > last for name, line in reads):
                yield node.lineno, "assigned"


def _tells_fields(node: ast.ClassDef) -> bool:
    fields = [
        re.escape(part.target.id)
        for part in node.body
        if isinstance(part, ast.AnnAssign) and isinstance(part.target, ast.Name)
    ]
    told = rf"(?:^|[;.]\s+|\n\s*(?:- )?)(?:{'|'.join(fields)})(?:, \w+)*:"
    return bool(fields) and re.search(told, ast.get_docstring(node) or "") is not None


def _is_parallel(node: ast.Assign) -> bool:
    target, value = node.targets[0], node.value
    if not isinstance(target, ast.Tuple) or not isinstance(value, ast.Tuple):
        return False
    return len({type(part) for part in value.elts}) > 1


def _is_text_times(node: ast.BinOp) -> bool:
    for one, other in ((node.left, node.right), (node.right, node.left)):
        is_sequence = isinstance(one, ast.List | ast.JoinedStr) or (
            isinstance(one, ast.Constant) and type(one.value) is str
        )
        is_condition = isinstance(other, ast.Compare | ast.BoolOp) or _calls_bool(other)
        if is_sequence and is_condition:
            return True
    return False


def _calls_bool(node: ast.expr) -> bool:
    return (
        isinstance(node, ast.Call)
        and isinstance(node.func, ast.Name)
        and node.func.id in ("bool", "any", "all")
    )


def _is_plain(node: ast.expr) -> bool:
    if isinstance(node, ast.UnaryOp):
        return _is_plain(node.operand)
    if isinstance(node, ast.Compare):
        return all(map(_is_plain, (node.left, *node.comparators)))
    return isinstance(node, ast.Name | ast.Attribute | ast.Constant)


def main() -> int:
    """Print each room that has more than its limit, with the lines; return how many there are."""
    found: dict[str, list[tuple[str, str]]] = {}
    for top in ROOMS:
        for path in sorted((ROOT / top).rglob("*.py")):
            below = path.relative_to(ROOT)
            if below.parts[0] == "sucre_bench" and below.parts[1] in ROOMS:
                continue  # a link to a folder of its own
            room = (
                "/".join(below.parts[:2])
                if below.parts[0] == "sucre_bench" and len(below.parts) > 2
                else below.parts[0]
            )
            for line, rule in packed(ast.parse(path.read_text(encoding="utf-8"))):
                found.setdefault(room, []).append((f"{below}:{line}", rule))
    if "--limits" in sys.argv:
        for room in sorted(found):
            print(f"    {room!r}: {sum(rule == JOINED for _, rule in found[room])},")
        return 0
    failures = 0
    for room, places in sorted(found.items()):
        for rule, n in sorted(Counter(rule for _, rule in places).items()):
            most = LIMITS.get(room, 0) if rule == JOINED else 0
            if n > most:
                failures += 1
                print(
                    f"{room}: {n} of rule '{rule}', at most {most} are left there; unpack one of"
                )
                print("\n".join(f"  {place}" for place, its in places if its == rule))
    return failures


if __name__ == "__main__":
    sys.exit(bool(main()))
