"""The gate of `compare --fail-below`: it fails on losses beyond limit and chance, and on nothing else."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.made_rows import rows_of

from sucre_bench.compare import Gate, gated
from sucre_bench.errors import InputError

OLD = np.array([20.0, 25.0, 22.0, 28.0, 24.0, 21.0])
STEADY = np.array([-1.0, -1.1, -0.9, -1.0, -1.2, -0.8])  # a loss of 1, surely
NOISY = np.array([-9.0, 7.0, -8.0, 8.0, -9.0, 5.0])  # a loss of 1, by chance


def table(**changes: np.ndarray) -> pd.DataFrame:
    """Scores of the baseline "old", and of methods that differ from it: psnr, and an error that grows as psnr falls."""
    scores = {
        method: [float(value) if np.isfinite(value) else None for value in OLD + change]
        for method, change in {"old": np.zeros(6), **changes}.items()
    }
    errors = {
        method: [None if value is None else 50 - value for value in values]
        for method, values in scores.items()
    }
    track = {"options": "{}"}
    return pd.concat(
        [rows_of(scores, **track), rows_of(errors, metric="error", better="lower", **track)]
    )


def outcome(text: str, **changes: np.ndarray) -> str:
    (found,) = gated(table(**changes), [Gate.read(text)], "old")
    assert found.fails == (found.outcome in ("failed", "no score"))
    return found.outcome


def test_four_views_of_a_track_can_neither_pass_nor_fail():
    rows = table(new=STEADY)
    (found,) = gated(
        rows[rows["view"].isin(sorted(rows["view"].unique())[:4])],
        [Gate.read("psnr=-0.5")],
        "old",
    )
    assert found.outcome == "unknown"


@pytest.mark.parametrize("metric", ["psnr", "psnr:masked", "new/psnr", "error"])
def test_a_loss_fails_beyond_limit_and_chance(metric: str):
    assert outcome(f"{metric}=-0.5", new=STEADY) == "failed"
    assert outcome(f"{metric}=-2", new=STEADY) == "passed"
    assert outcome(f"{metric}=-0.5", new=NOISY) == "passed"
    assert outcome(f"{metric}=0", new=-STEADY) == "passed"


def test_the_views_that_lose_most_come_first():
    (found,) = gated(table(new=STEADY), [Gate.read("psnr=-0.5")], "old")
    assert [view for view, _ in found.worst] == [
        "v004",
        "v001",
        "v000",
        "v003",
        "v002",
    ]
    assert [gain for _, gain in found.worst] == pytest.approx([-1.2, -1.1, -1.0, -1.0, -0.9])
    (found,) = gated(table(new=STEADY), [Gate.read("error=-0.5")], "old")
    assert found.worst[0] == ("v004", pytest.approx(-1.2))


def test_a_limit_may_be_for_one_method():
    rows = table(new=STEADY, other=-STEADY)
    assert {(g.method, g.fails) for g in gated(rows, [Gate.read("psnr=-0.5")], "old")} == {
        ("new", True),
        ("other", False),
    }
    assert [g.method for g in gated(rows, [Gate.read("other/psnr=-0.5")], "old")] == ["other"]


def test_a_method_that_lost_everything_fails():
    assert outcome("psnr=-0.5", new=np.full(6, np.nan)) == "no score"


@pytest.mark.parametrize("text", ["ssim=-1", "nobody/psnr=-1"])
def test_names_that_are_not_there_are_refused(text: str):
    with pytest.raises(InputError, match=r"ssim|nobody"):
        gated(table(new=STEADY), [Gate.read(text)], "old")


def test_the_exit_code_tells(bench, tmp_path: Path):
    rows = table(new=STEADY)
    rows[rows["metric"] != "error"].to_parquet(tmp_path / "scores.parquet")
    words = ("compare", str(tmp_path), "--fail-below")
    done = bench(*words, "psnr=-0.5", "--baseline", "old", "--json")
    assert (done.returncode, "psnr" in done.stderr, done.stdout[0]) == (1, True, "[")
    assert bench(*words, "psnr=-9", "--baseline", "old").returncode == 0
    assert bench(*words, "psnr=-9").returncode == 2
