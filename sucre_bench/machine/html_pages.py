"""Fills in the templates of pages that open from disk, and names the scripts and styles that they may run."""

import base64
import hashlib
from importlib.resources import files
from typing import Any


def filled_in(package: str, template: str, **values: Any) -> bytes:
    """Return a package's template, filled in with values. It escapes every text that is not Markup.

    Raises jinja2.UndefinedError if a value that the template uses is missing.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    pages = Environment(loader=PackageLoader(package, ""), autoescape=True, undefined=StrictUndefined)
    return pages.get_template(template).render(**values).encode()


def source(package: str, name: str) -> str:
    """Return the text of a style or script that lies in a package."""
    return files(package).joinpath(name).read_text(encoding="utf-8")


def policy_hash(text: str) -> str:
    """Return what a Content-Security-Policy says of an inline style or script with this exact text."""
    return f"sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}"
