"""The page's script: its ES modules joined into one, as browsers load no modules from disk.

Each module becomes a function that returns its exports; nothing is global. Two forms of ES modules are used and known
here: ``import { a, b } from "./name.js";`` (or without names), and ``export`` before a declaration.
"""

import re
from collections.abc import Callable

_IMPORT = re.compile(r'^import (?:\{([^{}]*)\} from )?"\./(\w+)\.js";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:const|let|async function|function) ([\w$]+))", re.MULTILINE)


def join_scripts(entry: str, read: Callable[[str], str]) -> str:
    """Return one script that runs a module after all that it imports.

    entry: the module's name, without ".js"; read: returns a module's text. Raises ValueError if modules import each
    other in a circle, or import a name that is not exported.
    """
    made: dict[str, str] = {}
    _add(entry, read, made, {}, ())
    return "\n".join(['(() => {\n"use strict";\nconst modules = {};', *made.values(), "})();"])


def _add(
    name: str, read: Callable[[str], str], made: dict[str, str], exported: dict[str, set[str]], above: tuple[str, ...]
) -> None:
    """Add a module after its imports. above: the modules that led to it."""
    if name in above:
        raise ValueError(f"{name}.js imports itself: {' -> '.join([*above, name])}")
    if name in made:
        return
    text = read(name)
    for match in _IMPORT.finditer(text):
        _add(match[2], read, made, exported, (*above, name))
        if unknown := set(_names(match)) - exported[match[2]]:
            raise ValueError(f"{name}.js: {match[2]}.js does not export {', '.join(sorted(unknown))}")
    exports = _EXPORT.findall(text)
    body = _EXPORT.sub("", _IMPORT.sub(_destructured, text)).rstrip()
    exported[name] = set(exports)
    made[name] = f"\nmodules.{name} = (() => {{\n{body}\nreturn {{ {', '.join(exports)} }};\n}})();"


def _names(match: re.Match[str]) -> list[str]:
    return [name for name in re.split(r"[\s,]+", match[1] or "") if name]


def _destructured(match: re.Match[str]) -> str:
    names = _names(match)
    return f"const {{ {', '.join(names)} }} = modules.{match[2]};\n" if names else ""
