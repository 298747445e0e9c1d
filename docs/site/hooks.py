"""What the site does beyond mkdocs: README as the first page, formulae as MathML, the notebook as a page.

mkdocs calls these functions by their names. Pages stay plain Markdown that reads well anywhere: `$...$` and `$$...$$`
are formulae as LaTeX writes them, and a link such as ../examples leads somewhere in the repository, not in the site.
"""

from __future__ import annotations

import html
import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from latex2mathml.converter import convert
from mkdocs.structure.files import File, Files

_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_MATHML = "{http://www.w3.org/1998/Math/MathML}"
_BELOW = {"msub": "munder", "msubsup": "munderover"}  # where the limits of a sum stand in a line of its own
_LINK_OUT = re.compile(r"\[([^\]]+)\]\(\.\./[^)]*\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the pages made of README and of the tutorial's notebook, which itself can be downloaded from there."""
    readme = (Path(config.config_file_path).parent / "README.md").read_text(encoding="utf-8")
    first = readme.replace("](docs/tutorial.ipynb", "](tutorial.md").replace("](CONTRIB", "](../CONTRIB")
    files.append(File.generated(config, "index.md", content=first.replace("](docs/", "](")))
    notebook = files.get_file_from_path("tutorial.ipynb")
    if notebook is None:
        raise FileNotFoundError("docs/tutorial.ipynb")
    files.append(File.generated(config, "tutorial.md", content=page_of(notebook.content_string)))
    return files


def page_of(notebook: str) -> str:
    """Return a notebook's cells as Markdown."""
    cells = json.loads(notebook)["cells"]
    texts = ["".join(cell["source"]) for cell in cells]
    return "\n\n".join(
        f"```python\n{text}\n```" if cell["cell_type"] == "code" else text
        for cell, text in zip(cells, texts, strict=True)
    )


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Leave the words of links that lead out of docs/."""
    return _LINK_OUT.sub(r"\1", markdown)


def on_page_content(content: str, **_: Any) -> str:
    """Write formulae in the language that browsers render by themselves, and keep an uncertainty beside its value."""
    content = content.replace(" ± ", "\u00a0±\u00a0")
    return _FORMULA.sub(lambda found: _mathml(found[1], html.unescape(found[2])), content)


def _mathml(tag: str, latex: str) -> str:
    display = "block" if tag == "div" else "inline"
    formula = ElementTree.fromstring(convert(latex.strip(), display=display))
    for element in formula.iter():
        element.tag = element.tag.removeprefix(_MATHML)
        if tag == "div" and element.tag in _BELOW and element[0].text == "∑":
            element.tag = _BELOW[element.tag]
    text = ElementTree.tostring(formula, encoding="unicode")
    return f'<div class="formula">{text}</div>' if tag == "div" else text
