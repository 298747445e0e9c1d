"""What was killed goes on, and what is run twice says the same."""

import json
from pathlib import Path

import pandas as pd
from support.colmap_folder import write_dive
from support.command_line import Started, but_times, run as run_toys, succeeded

from sucre_bench import results
from sucre_bench.engine.hydra_run import run_words as run
from sucre_bench.engine.run import Outcome
from sucre_bench.results.table import read_both


def test_the_same_command_twice_gives_the_same_table_but_for_times(
    tmp_path: Path, small_demo: list[str]
):
    """Those that the contract's test does not run in another process, and one that works on threads."""
    command = ["run", "-m", *small_demo, "first=1", "tracking.uri=off", "report=false"]
    command += ["method=ibla,sucre_paper,sucre_plus", "metrics=[psnr,uciqe]"]
    command += ["degrade.noise=0.01", "sucre_paper.steps=20"]
    command += ["workers=0"]  # each would import torch
    succeeded(tmp_path, *command, "out=here")
    there = Started(tmp_path, *command, "out=there").ended()
    assert there.returncode == 0, there.stdout + there.stderr
    tables = (but_times(results.read(tmp_path / out)) for out in ("here", "there"))
    pd.testing.assert_frame_equal(*tables)


# -- shards and replicates ---------------------------------------------------------------------------------


def toy(out: Path, *overrides: str) -> Outcome:
    return run_toys(out, "dataset.views=7", "dataset.label=toy", *overrides, multirun=True)


def test_shards_together_are_the_whole(tmp_path: Path, toys: str):
    """Also in scores of pairs of views, and on the pixels that all methods fill."""
    words = ("method=gain,left_half", "metrics=[psnr,apart]")
    toy(tmp_path / "whole", *words)
    parts = toy(tmp_path / "parts", *words, "shard.count=3", "shard.index=range(3)")
    assert (parts.ok, parts.exit_code) == (14, 0)
    both = [read_both(tmp_path / name) for name in ("parts", "whole")]
    for found, expected in zip(*both, strict=True):
        pd.testing.assert_frame_equal(but_times(found), but_times(expected))


def test_a_shard_has_neighbours(tmp_path: Path, toys: str):
    rows = toy(tmp_path, "shard.count=3", "shard.index=2").rows
    assert set(rows["view"]) == {"v4.png", "v5.png", "v6.png"}


def test_replicates_draw_anew_and_are_one_method(tmp_path: Path, toys: str):
    """Noise of another seed; in the comparison the replicates of a view are averaged, and not taken for more views."""
    from sucre_bench import compare

    outcome = toy(tmp_path, "degrade.noise=0.1", "replicate=0,1,2")
    assert (outcome.ok, outcome.exit_code) == (21, 0)
    scores = outcome.rows[outcome.rows["metric"] == "redness"]
    assert scores.groupby("view")["value"].nunique().tolist() == [3] * 7
    assert len(list((tmp_path / "restored").rglob("*.png"))) == 21
    (table,) = compare.compare(outcome.rows)
    (column,) = [c for c in table.columns if c.metric == "redness"]
    assert (column.n_views, table.methods) == (7, ("gain",))
    assert toy(tmp_path, "degrade.noise=0.1", "replicate=0,1,2").cached == 21


def test_data_of_a_replicate_are_the_same_for_every_method(tmp_path: Path, toys: str):
    rows = toy(tmp_path, "method=gain,gain2", "degrade.noise=0.1", "replicate=1").rows
    values = rows[rows["metric"] == "redness"].pivot(
        index="view", columns="method", values="value"
    )
    assert (values["gain"] == values["gain2"]).all()


def test_variants_of_one_sweep_use_the_same_pairs_and_say_what_they_cost(
    tmp_path: Path, small_demo: list[str]
):
    """Paired once, on the disk while the sweep runs; each is told to have taken the time of pairing."""
    words = ["method=sucre,sucre_paper", "metrics=[coverage]", "first=1", f"out={tmp_path}"]
    outcome = run([*small_demo, *words, "tracking.uri=off"], True)
    assert outcome.ok == 2
    told = [json.loads(path.read_text()) for path in (tmp_path / "restored").rglob("*.json")]
    assert len(told) == 2
    pairing = {one["stage_seconds"]["pair"] for one in told}
    assert len(pairing) == 1
    taken = outcome.rows[outcome.rows["metric"] == "seconds"]["value"]
    assert (taken > pairing.pop()).all()
    assert not list(tmp_path.glob(".pairs"))


def test_a_chart_that_is_marked_later_is_scored_and_nothing_is_restored_again(tmp_path: Path):
    dive, out = write_dive(tmp_path / "dive"), tmp_path / "out"
    words = ["dataset=colmap", f"dataset.root={dive}", "method=gray_world", f"out={out}"]
    words += ["save=full", "report=false", "tracking.uri=off"]

    def psi(corner: int) -> float:
        corners = [[corner, 2], [36, 3], [35, 27], [5, 26]]
        (dive / "charts.json").write_text(json.dumps({"images": {"a.png": {"chart": corners}}}))
        rows = run([*words, "metrics=[psi,coverage]"], True).rows
        return float(rows.query("metric == 'psi' and region == 'chart'")["value"].item())

    run([*words, "metrics=[coverage]"], True)
    restored = {file: file.read_bytes() for file in out.rglob("*.npz")}
    assert len(restored) == 2
    assert psi(4) != psi(12)
    assert {file: file.read_bytes() for file in out.rglob("*.npz")} == restored
