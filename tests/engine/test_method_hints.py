import subprocess
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest

PLUGIN = """
from dataclasses import dataclass
from sucre_bench import Restoration, method
from sucre_bench.machine.progress import say


@method()
@dataclass(frozen=True)
class Wary:
    strong: bool = False

    def restore(self, scene, view):
        say("no view has this")
        return Restoration(view.rgb, info={"hints": [f"{len(view.name)}.5% are dark; method.strong=true helps"]})
"""


@pytest.mark.parametrize(("methods", "word"), [("wary", "wary"), ("wary,gain", "wary")])
def test_a_hint_names_method_and_dataset_once_and_an_option_as_the_command_takes_it(
    bench: Callable[..., subprocess.CompletedProcess[str]], toys: str, tmp_path: Path, methods: str, word: str
):
    (tmp_path / "wary.py").write_text(PLUGIN)
    done = bench("run", "-m", "--plugin", toys, "--plugin", "wary.py", "dataset=toy", f"method={methods}",
                 "metrics=[redness]", "tracking.uri=off", "report=false", "out=results")  # fmt: skip
    assert done.returncode == 0, done.stderr
    (hint,) = [line for line in done.stdout.splitlines() if "are dark" in line]
    views = len(list((tmp_path / "results/restored/toy/wary").glob("*.png")))
    assert f"in {views} of {views} views" in hint
    assert f" {word}.strong=true" in hint
    assert done.stderr.splitlines().count("no view has this") == views


def test_a_reason_names_an_option_as_the_command_takes_it(
    bench: Callable[..., subprocess.CompletedProcess[str]], toys: str, tmp_path: Path
):
    broken = PLUGIN.replace("import Restoration, method", "import Restoration, SolveError, method")
    broken = broken.replace(
        "        return", '        raise SolveError("all is dark; use method.strong=true")\n        return'
    )
    (tmp_path / "wary.py").write_text(broken)
    text = "datasets: [toy]\nmethods: [{name: wary, label: bright}]\nmetrics: [redness]\n"
    (tmp_path / "lineup.yaml").write_text(text)
    bench(
        "run", "lineup.yaml", "--plugin", toys, "--plugin", "wary.py", "tracking.uri=off", "report=false", "out=results"
    )
    reasons = set(pd.read_parquet(tmp_path / "results/scores.parquet").reason)
    assert len(reasons) == 1
    assert "bright.strong=true" in reasons.pop()
