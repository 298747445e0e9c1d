import subprocess
from collections.abc import Callable
from pathlib import Path

import pandas as pd

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
