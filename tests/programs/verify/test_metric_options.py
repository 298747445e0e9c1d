"""`sucre-bench verify` computes a metric with the options that its scores were made with."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.command_line import run_here

# The share of pixels in which the first channel is brighter than a threshold: its options change every score.
BRIGHT = """
from dataclasses import dataclass
from pathlib import Path
from sucre_bench import Score, metric

@metric(variants={"share": "of all pixels"}, unit="", better="higher", range=(0, 1))
@dataclass(frozen=True)
class Bright:
    "How many pixels are bright."

    above: float = 0.3
    table: Path | None = None

    def score(self, restored, shown, view, variant):
        yield Score(float((shown[..., 0] > self.above).mean()))
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One method's scores with a threshold, then another method's with another: the folder has both."""
    place = tmp_path_factory.mktemp("options")
    (place / "bright.py").write_text(BRIGHT)
    made = ("dataset=demo", "dataset.width=160", "dataset.height=120", "dataset.views=2", "tracking.uri=off")
    words = ("--plugin", "bright.py", *made, "metrics=[bright]", "report=false", "out=results")
    for method, above in (("gray_world", 0.5), ("underwater", 0.6)):
        done = run_here(place, "run", *words, f"method={method}", f"metrics.bright.above={above}")
        assert done.returncode == 0, done.stderr
    done = run_here(place, "bundle", "results", "b.zip", "--pictures", "restored")
    assert done.returncode == 0, done.stderr
    return place


def test_options_of_the_last_run_are_used(bench: Callable[..., Any], folder: Path):
    done = bench("verify", str(folder / "b.zip"), "--plugin", str(folder / "bright.py"), "--json")
    found = json.loads(done.stdout)
    assert (done.returncode, found["n_agree"], found["differing"]) == (0, 2, [])
    (reason,) = found["unchecked"]
    assert "bright" in reason, "those of the earlier run are in no file, and no default takes their place"


def test_a_file_that_an_option_names_is_not_opened(bench: Callable[..., Any], folder: Path, tmp_path: Path):
    (tmp_path / "table.txt").write_text("")
    words = ("--plugin", str(folder / "bright.py"), "dataset=demo", "dataset.width=160", "dataset.height=120")
    words = (
        *words,
        "first=1",
        "method=underwater",
        "metrics=[bright]",
        f"metrics.bright.table={tmp_path / 'table.txt'}",
    )
    done = bench("run", *words, "tracking.uri=off", "report=false", "out=other")
    assert done.returncode == 0, done.stderr
    assert bench("bundle", "other", "c.zip", "--pictures", "restored").returncode == 0
    done = bench("verify", "c.zip", "--plugin", str(folder / "bright.py"), "--json")
    found = json.loads(done.stdout)
    (reason,) = found["unchecked"]
    assert found["n_agree"] == 0
    assert re.search("bright .*file", reason)
