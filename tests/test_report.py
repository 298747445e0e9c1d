from __future__ import annotations

import re
from pathlib import Path

import pytest

from sucre_bench import report, sweep

pytestmark = pytest.mark.usefixtures("toys")


def page(out: Path, *overrides: str) -> str:
    base = ["dataset=toy", "metrics=[redness]", "tracking.uri=off", f"out={out}"]
    outcome = sweep.run([*base, *overrides], True)
    return report.write(out, outcome.rows).read_text()


def test_the_page_shows_table_pictures_faults_and_how_it_was_made(tmp_path: Path):
    text = page(tmp_path, "method=gain,faulty,needs_charts")
    for said in (
        "redness",
        "ValueError: boom",
        "needs charts",
        "5 restorations ok, 1 failed, 3 skipped",
        "sucre-bench run",
    ):
        assert said in text
    # three views, each with original and reference; five restorations; what is missing says why
    assert text.count('src="data:image/jpeg;base64,') == 3 + 3 + 5
    assert text.count('class="none') == 4


def test_the_page_needs_no_network(tmp_path: Path):
    text = page(tmp_path, "method=gain")
    assert not re.findall(r"""(?:src|href)=["'](?:https?:)?//""", text)
    assert "@import" not in text
    for link in re.findall(r'<a href="([^"]+)"', text):
        assert (tmp_path / "report" / link).resolve().is_file()


def test_names_are_escaped(tmp_path: Path):
    text = page(tmp_path, "method=gain", "method.label='<script>alert(1)</script>'")
    assert "<script>" not in text
    assert "&lt;script&gt;" in text
