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
# where the limits of a sum stand in a line of its own
_BELOW = {
    "msub": "munder",
    "msubsup": "munderover",
}
_LINK_OUT = re.compile(r"\[([^\]]+)\]\(\.\./[^)]*\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the first page, made of README; the tutorial's, made of its notebook; and a page of results.

    outputs/ has the notebook with its outputs, and the page of results, where show_at_work.py has made them.
    """
    root = Path(config.config_file_path).parent
    readme = (root / "README.md").read_text(encoding="utf-8")
    first = readme.replace("](docs/tutorial.ipynb", "](tutorial.md").replace(
        "](CONTRIB", "](../CONTRIB"
    )
    first = first.replace("](docs/", "](")
    sample, executed = (
        root / "outputs" / name for name in ("sample/report/index.html", "tutorial.ipynb")
    )
    if sample.is_file():
        files.append(File.generated(config, "sample.html", abs_src_path=str(sample)))
        first = first.replace(
            "pictures/page.jpg)\n",
            "pictures/page.jpg)\n\n**[Open such a page](sample.html).**\n",
        )
    files.append(File.generated(config, "index.md", content=first))
    notebook = files.get_file_from_path("tutorial.ipynb")
    if notebook is None:
        raise FileNotFoundError("docs/tutorial.ipynb")
    text = (
        executed.read_text(encoding="utf-8") if executed.is_file() else notebook.content_string
    )
    files.append(File.generated(config, "tutorial.md", content=page_of(text)))
    return files


def page_of(notebook: str) -> str:
    """Return a notebook's cells and outputs as Markdown."""
    parts = []
    for cell in json.loads(notebook)["cells"]:
        text = "".join(cell["source"])
        parts.append(f"```python\n{text}\n```" if cell["cell_type"] == "code" else text)
        parts += [shown for output in cell.get("outputs", []) if (shown := _output(output))]
    return "\n\n".join(parts)


def _output(output: Any) -> str:
    """An output of a cell as HTML in one line each: its richest form; nothing of what is on stderr."""
    data = {kind: "".join(text) for kind, text in output.get("data", {}).items()}
    if "text/html" in data:
        inner = data["text/html"]
    elif "image/png" in data:
        inner = f'<img alt="" src="data:image/png;base64,{data["image/png"].strip()}">'
    elif text := data.get("text/plain") or (
        "".join(output["text"]) if output.get("name") == "stdout" else ""
    ):
        inner = f"<pre>{html.escape(text.rstrip())}</pre>"
    else:
        return ""
    return f'<div class="output">{inner}</div>'.replace("\n\n", "\n")


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
