"""The tutorial's notebook: it runs from the first cell to the last, and says what its text says."""

from pathlib import Path

import nbformat
import pytest
from nbclient import NotebookClient
from support.places import ROOT

NOTEBOOK = ROOT / "docs" / "tutorial.ipynb"


def test_it_runs_without_a_screen_and_its_own_method_is_in_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path / "ipython"))
    notebook = nbformat.read(NOTEBOOK, as_version=4)
    assert not any(
        cell.get("outputs") or cell.get("execution_count") for cell in notebook.cells
    )
    size = "width=240, height=180, views=4"
    assert size in notebook.cells[2].source
    for (
        cell
    ) in notebook.cells:  # for the time: small pictures, and a fit that takes a tenth of it
        cell.source = cell.source.replace(size, "width=160, height=120, views=4").replace(
            '"sucre"', '"sucre_exact"'
        )
    NotebookClient(
        notebook,
        timeout=1200,
        startup_timeout=600,
        resources={"metadata": {"path": str(tmp_path)}},
    ).execute()
    outputs = [
        output for cell in notebook.cells if cell.cell_type == "code" for output in cell.outputs
    ]
    pages = [
        output["data"]["text/html"]
        for output in outputs
        if "text/html" in output.get("data", {})
    ]
    # scene, view and two restorations
    assert sum("data:image/jpeg" in page for page in pages) == 4
    assert sum("image/png" in output.get("data", {}) for output in outputs) == 1
    assert any("colorchecker-1" in page and "psi" in page for page in pages), (
        "the charts are scored"
    )
    tables = [out["data"].get("text/markdown", "") for out in outputs if "data" in out]
    assert all(
        f"| {method} |" in tables[-1] for method in ("gray_world", "sucre_exact", "known_water")
    )
    errors = [
        output.text
        for output in outputs
        if output.output_type == "stream" and output.name == "stderr"
    ]
    assert not [text for text in errors if not text.startswith("compiling loops")]
