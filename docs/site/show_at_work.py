"""Makes what the site shows of the program at work: a page of results, and the tutorial with its outputs.

`make docs` calls it before it builds the site. It writes below outputs/ and repeats only what has changed.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import nbformat
from nbclient import NotebookClient

ROOT = Path(__file__).resolve().parent.parent.parent
RUN = [
    *(
        "run",
        "-m",
        "dataset=demo",
        "dataset.width=320",
        "dataset.height=240",
        "dataset.root=outputs/data/sample",
    ),
    *(
        "method=underwater,gray_world,seathru,sucre,sucre_plus",
        "every=4",
        "out=outputs/sample",
        "tracking.uri=off",
    ),
]


def run_tutorial(source: Path, executed: Path) -> None:
    """Execute the notebook `source` and write it with its outputs to `executed`, unless that has the same cells."""
    notebook = nbformat.read(source, as_version=4)
    cells = [cell.source for cell in notebook.cells]
    if (
        not executed.is_file()
        or [cell.source for cell in nbformat.read(executed, as_version=4).cells] != cells
    ):
        NotebookClient(notebook, timeout=1200).execute()
        executed.parent.mkdir(exist_ok=True)
        nbformat.write(notebook, executed)


if __name__ == "__main__":
    subprocess.run(
        [str(Path(sys.executable).with_name("sucre-bench")), *RUN],
        cwd=ROOT,
        check=True,
        capture_output=True,
    )
    run_tutorial(ROOT / "docs" / "tutorial.ipynb", ROOT / "outputs" / "tutorial.ipynb")
