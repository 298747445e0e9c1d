"""HTML pages that open from disk: filled-in templates, and hashes of their styles and scripts."""

from __future__ import annotations

import base64
import functools
import hashlib
from importlib.resources import files
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment


def filled_in(package: str, template: str, **values: Any) -> bytes:
    """Return a package's template, filled in with values. It escapes every text that is not Markup.

    In the template, `source(NAME)` is a style or script of the package, and `source_hash(NAME)` its `policy_hash`.
    Raises jinja2.UndefinedError if a value that the template uses is missing.
    """
    return (
        _templates(package)
        .get_template(template)
        .render(**values)
        .encode(errors="backslashreplace")
    )


@functools.cache
def _templates(package: str) -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    pages = Environment(
        loader=PackageLoader(package, ""), autoescape=True, undefined=StrictUndefined
    )
    pages.globals["source"] = lambda name: Markup(source(package, name))
    pages.globals["source_hash"] = lambda name: policy_hash(source(package, name))
    return pages


def source(package: str, name: str) -> str:
    """Return the text of a style or script that lies in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def policy_hash(text: str) -> str:
    """Return what a Content-Security-Policy says of an inline style or script with this exact text."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
