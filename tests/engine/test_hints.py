"""Hints come after the table, one a method, in words that the same command takes."""

from collections.abc import Callable
from pathlib import Path

from support.command_line import Done

PLUGIN = '''
from dataclasses import dataclass
from sucre_bench import Restoration, method

@method()
@dataclass(frozen=True)
class Dim:
    """Darken a photograph."""
    gain: float = 0.5
    def restore(self, scene, view):
        hints = [f"{view.rgb.mean():.3f} is dark; use method.gain=2"]
        if view.name == "view_000.png":
            hints.insert(0, "its edge is odd; use method=gray_world")
        return Restoration(view.rgb * self.gain, info={"hints": hints})
'''
SMALL = ("dataset.width=64", "dataset.height=48", "dataset.views=3", "dataset.root=demo")


def test_one_hint_a_method_after_the_table(tmp_path: Path, bench: Callable[..., Done]) -> None:
    (tmp_path / "dim.py").write_text(PLUGIN)
    quiet = ("tracking.uri=off", "report=false", "workers=0", "--plugin", "dim.py")
    made = ("dataset=demo", *SMALL, "method=dim,gray_world", "metrics=[psnr]", *quiet)
    done = bench("run", "-m", *made)
    assert done.returncode == 0, done.stderr
    table, _, after = done.stdout.partition("more: ")
    assert table.count("psnr")
    lines = [line for line in after.splitlines() if line.startswith("hint")]
    assert len(lines) == 1
    assert "demo / dim, in 3 of 3 views" in lines[0]
    assert "method.gain=2" in lines[0]
    assert "hint" not in done.stderr
    assert bench("run", "-m", *made, "dim.gain=2", "overwrite=always").returncode == 0
