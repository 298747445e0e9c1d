from pathlib import Path

import pytest
from click.testing import CliRunner

from sucre_bench.commands.run import run
from sucre_bench.compare.statistics import Units

pytestmark = pytest.mark.usefixtures("toys")


def test_a_run_compares_each_score_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Terminal, page and mlflow show one comparison: two methods by redness, seconds and memory, on two views."""
    made: list[int] = []
    of = Units.of
    monkeypatch.setattr(Units, "of", lambda views, *more: made.append(len(views)) or of(views, *more))
    words = ["-m", "dataset=toy", "method=gain", "method.gain=1,2", "metrics=[redness]", "workers=0"]
    result = CliRunner().invoke(run, [*words, f"out={tmp_path}"], catch_exceptions=False)
    assert (tmp_path / "report" / "index.html").is_file(), result.output
    assert (tmp_path / "mlflow.db").is_file()
    assert len(made) == 3
