"""`sucre-bench verify` computes a metric with the options that its scores were made with."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.command_line import succeeded

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


MADE = (
    "dataset=demo",
    "dataset.width=64",
    "dataset.height=48",
    "dataset.views=2",
    "metrics=[bright]",
)
RUNS = [
    ("results", "gray_world", "above=0.5"),
    ("results", "underwater", "above=0.6"),  # the folder has scores with both thresholds
    ("other", "underwater", "table=table.txt"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Bundles of scores that were made with options."""
    place = tmp_path_factory.mktemp("options")
    (place / "bright.py").write_text(BRIGHT)
    (place / "table.txt").write_text("")
    for out, method, option in RUNS:
        words = (
            *MADE,
            f"method={method}",
            f"metrics.bright.{option}",
            "tracking.uri=off",
            "report=false",
        )
        succeeded(place, "run", "--plugin", "bright.py", *words, f"out={out}")
    for out in ("results", "other"):
        succeeded(place, "bundle", out, f"{out}.zip", "--pictures", "restored")
    return place


@pytest.mark.parametrize(
    ("bundle", "n_agree", "reason"), [("results", 2, "bright"), ("other", 0, "bright .*file")]
)
def test_options_of_the_last_run_are_used_but_no_file_is_opened(
    bench: Callable[..., Any], folder: Path, bundle: str, n_agree: int, reason: str
):
    """Those of the earlier run are in no file, and no default takes their place."""
    done = bench(
        "verify", str(folder / f"{bundle}.zip"), "--plugin", str(folder / "bright.py"), "--json"
    )
    found = json.loads(done.stdout)
    assert (done.returncode, found["n_agree"], found["differing"]) == (0, n_agree, [])
    (said,) = found["unchecked"]
    assert re.search(reason, said)
