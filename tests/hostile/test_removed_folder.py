"""A view whose method goes to a folder and removes it costs no other view, and the run writes where it was started."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from pathlib import Path

from sucre_bench import results

PLUGIN = """
import os, tempfile
from dataclasses import dataclass
from sucre_bench import Restoration, method


@method()
@dataclass(frozen=True)
class Wanderer:
    def restore(self, scene, view):
        if view.name == "v0.png":
            with tempfile.TemporaryDirectory() as place:
                os.chdir(place)
        return Restoration(view.rgb)
"""


def test_a_method_in_a_folder_that_is_removed_costs_no_other_view(
    program: Callable[..., subprocess.CompletedProcess[str]], toys: str, tmp_path: Path
):
    (tmp_path / "wanderer.py").write_text(PLUGIN)
    done = program("run", "-m", "--plugin", toys, "--plugin", "wanderer.py", "dataset=toy", "method=wanderer,gain",
                   "metrics=[redness]", "tracking.uri=off", "report=false", "out=results")  # fmt: skip
    rows = results.read(tmp_path / "results")
    others = rows[(rows["view"] != "v0.png") | (rows["method"] == "gain")]
    assert set(others["method"]) == {"wanderer", "gain"}
    assert set(others["status"]) == {"ok"}, done.stderr
    assert (tmp_path / "results/restored/toy/wanderer/v1.png").is_file()
