"""Reads the help texts of options: the strings under the fields of a class."""

import ast
import functools
import inspect
import itertools
import textwrap
from typing import Any


@functools.cache
def field_docs(cls: type[Any]) -> dict[str, str]:
    """Return the string under each annotated name of a class body, as every documentation generator reads them."""
    docs: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        try:
            body = ast.parse(textwrap.dedent(inspect.getsource(base))).body[0].body  # type: ignore[attr-defined]
        except (OSError, TypeError):
            continue  # made in a console: it has no source
        for above, below in itertools.pairwise(body):
            if isinstance(above, ast.AnnAssign) and isinstance(above.target, ast.Name):
                said = (
                    below.value.value if isinstance(below, ast.Expr) and isinstance(below.value, ast.Constant) else ""
                )
                if isinstance(said, str) and said:
                    docs[above.target.id] = " ".join(said.split())
    return docs
