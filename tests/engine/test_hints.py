"""Hints come after the table, one a method, in words that the same command takes; neighbours are named before it."""

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd
import pytest
from support.command_line import Done

PLUGIN = '''
from dataclasses import dataclass
from sucre_bench import Restoration, method
from sucre_bench.plugins.call_method import typed_option

@method()
@dataclass(frozen=True)
class Dim:
    """Darken a photograph."""
    gain: float = 0.5
    def restore(self, scene, view):
        hints = [f"{view.rgb.mean():.3f} is dark; use {typed_option('gain')}=2"]
        if view.name == "view_000.png":
            hints.insert(0, "its edge is odd; use method=gray_world")
        return Restoration(view.rgb * self.gain, info={"hints": hints})
'''
DEMO = (
    "dataset=demo",
    "dataset.width=64",
    "dataset.height=48",
    "dataset.views=3",
    "dataset.root=demo",
    "report=false",
)


def test_one_hint_a_method_after_the_table(tmp_path: Path, bench: Callable[..., Done]) -> None:
    (tmp_path / "dim.py").write_text(PLUGIN)
    words = ("metrics=[psnr]", "tracking.uri=off", "out=out", "workers=0", "--plugin", "dim.py")
    done = bench("run", "-m", *DEMO, "method=dim,gray_world", *words)
    assert done.returncode == 0, done.stderr
    table, _, after = done.stdout.partition("more: ")
    assert table.count("psnr")
    lines = [line for line in after.splitlines() if line.startswith("hint")]
    assert len(lines) == 1
    assert "demo / dim, in 3 of 3 views" in lines[0]
    assert "dim.gain=2" in lines[0]
    assert "hint" not in done.stderr
    assert (
        bench(
            "run", "-m", *DEMO, "method=dim,gray_world", "dim.gain=2", "overwrite=always", *words
        ).returncode
        == 0
    )


@pytest.mark.parametrize("place", ["warm_up(self)", "restore(self, scene, view)"])
def test_a_reason_names_an_option_as_the_command_takes_it(
    tmp_path: Path, bench: Callable[..., Done], place: str
) -> None:
    broken = PLUGIN.replace("import Restoration", "import Restoration, SolveError")
    broken += f"""
    def {place}:
        raise SolveError(f"all is dark; use {{typed_option('gain')}}=2")
"""
    (tmp_path / "dim.py").write_text(broken)
    (tmp_path / "mine.yaml").write_text(
        "hydra: {mode: MULTIRUN, sweeper: {methods: [{method: dim, label: bright}]}}\n"
    )
    words = ("first=1", "tracking.uri=off", "out=results", "workers=0", "--plugin", "dim.py")
    bench("run", "mine.yaml", "metrics=[psnr]", *DEMO, *words)
    (reason,) = set(pd.read_parquet(tmp_path / "results/scores.parquet").reason)
    assert "bright.gain=2" in reason


@pytest.mark.parametrize(
    ("words", "n_named"),
    [
        (("first=2",), "2"),
        (("-m", "first=2", "shard.count=2", "shard.index=0,1"), "2"),
        (("-m", "shard.count=2", "shard.index=0,1"), ""),
        (("shard.count=2", "shard.index=0"), ""),
        (("views=[view_000.png,view_002.png]",), ""),
    ],
)
def test_a_run_says_if_the_chosen_views_are_neighbours(
    small_demo: list[str], bench: Callable[..., Done], words: tuple[str, ...], n_named: str
) -> None:
    done = bench(
        "run",
        *words,
        *small_demo,
        "method=gray_world",
        "metrics=[coverage]",
        "tracking.uri=off",
        "report=false",
        "workers=0",
    )
    assert done.returncode == 0, done.stderr
    found = re.findall(
        r"these (\d) of 4 views are neighbours.* every=2 ", done.stdout + done.stderr
    )
    assert found == ([n_named] if n_named else [])
