"""Shows the examples of docstrings as code: griffe, which reads the docstrings, calls `on_instance` for each object."""

import re
from typing import Any

from griffe import Extension, Object

# from a prompt to an empty line
_EXAMPLE = re.compile(r"^>>> .*(?:\n.*\S.*)*", re.MULTILINE)


class Examples(Extension):
    """Puts examples into fences of Markdown."""

    def on_instance(self, *, obj: Object, **_: Any) -> None:
        """Change an object's docstring, where it has one."""
        if obj.docstring:
            obj.docstring.value = _EXAMPLE.sub(r"```pycon\n\g<0>\n```", obj.docstring.value)
