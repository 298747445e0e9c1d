"""Metrics of pairs of restored views: scored once the views are there, from what the results folder holds."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.command_line import run

from sucre_bench import results
from sucre_bench.engine.run import Outcome
from sucre_bench.imaging.image_files import decode
from sucre_bench.results import Reason, brief

pytestmark = pytest.mark.short


@pytest.fixture
def out(tmp_path: Path, toys: str) -> Path:
    return tmp_path / "out"


def apart(out: Path, *overrides: str, multirun: bool = False) -> Outcome:
    return run(out, "metrics=[apart]", *overrides, multirun=multirun)


def scores(rows: pd.DataFrame) -> pd.DataFrame:
    return rows[rows["metric"] == "apart"].set_index("view").sort_index()


def test_a_views_score_is_the_mean_over_its_pairs_of_stored_pictures(out: Path):
    rows = scores(apart(out).rows)
    assert set(rows["status"]) == {"ok"}
    pictures = [
        decode(out / "restored" / "toy" / "gain" / f"v{n}.png", 1)[..., ::-1] / 255
        for n in range(3)
    ]
    # All toy views have one camera, so that patches are blocks of 8 x 8 pixels: 5 x 7 of them are whole.
    patches = [p[:, :56].reshape(5, 8, 7, 8, 3).mean(axis=(1, 3)) for p in pictures]
    between = {
        (i, j): np.abs(patches[i] - patches[j]).mean() for i in range(3) for j in range(3)
    }
    for n in range(3):
        own = [between[n, other] for other in range(3) if other != n]
        assert rows.loc[f"v{n}.png", "value"] == pytest.approx(np.mean(own), rel=1e-4)


def test_a_new_view_scores_all_views_anew_and_fewer_views_score_nothing(out: Path):
    two = scores(apart(out, "first=2").rows)
    assert len(two) == 2
    three = scores(apart(out).rows)
    assert len(three) == 3
    assert (three["value"].drop("v2.png") != two["value"]).all()
    pd.testing.assert_frame_equal(scores(apart(out, "first=2").rows), three)


def test_a_view_that_fails_takes_no_part_until_it_is_mended(out: Path, tmp_path: Path):
    """The factor stands in a file, which is mended: the method skips v2.png, and at first fails on all."""
    table = tmp_path / "gain"
    words = ("method=tabulated", f"method.table={table}", "dataset.views=4")
    table.write_text("no number")
    assert apart(out, *words).exit_code == 1
    table.write_text("1.0")
    rows = scores(apart(out, *words).rows)
    assert list(rows.index) == ["v0.png", "v1.png", "v3.png"]
    assert set(rows["status"]) == {"ok"}


def test_what_was_computed_is_scored_where_it_is_stored(out: Path):
    words = ("metrics.apart.variants=[all]", "method.gain=0.5")
    rows = apart(out, *words).rows
    assert set(rows[rows["variant"] == "computed"]["reason"]) == {"not stored"}
    stored = apart(out, *words, "save=full").rows
    both = stored[stored["metric"] == "apart"].pivot(
        index="view", columns="variant", values="value"
    )
    assert both["computed"].to_numpy() == pytest.approx(both["shown"].to_numpy(), rel=1e-2)


def test_black_pictures_without_holes_are_scored(out: Path):
    """A restoration without holes has no mask file; its black pixels are colours."""
    rows = scores(apart(out, "method.gain=0").rows)
    assert (set(rows["status"]), set(rows["value"])) == ({"ok"}, {0.0})


# -- what cannot be scored ---------------------------------------------------------------------------------


def test_scenes_without_depth_and_poses_are_skipped_with_the_reason(out: Path):
    outcome = run(out, "dataset=two_scenes", "metrics=[apart,redness]")
    assert outcome.exit_code == 0
    (reason,) = set(scores(outcome.rows)["reason"])
    assert Reason.of(reason) is Reason.LACK
    assert brief(reason) == "needs depth and poses"
    assert (outcome.rows.loc[outcome.rows["metric"] == "redness", "status"] == "ok").all()


def test_views_that_do_not_overlap_are_skipped_with_the_reason(out: Path):
    outcome = run(out, "metrics=[apart,redness]", "dataset.apart=true")
    assert outcome.exit_code == 0
    assert set(scores(outcome.rows)["reason"]) == {Reason.NO_OVERLAP.value}


def test_a_fault_of_a_metric_is_a_row_and_other_metrics_go_on(out: Path):
    outcome = run(out, "metrics=[apart,redness]", "metrics.apart.fails=true")
    assert (outcome.ok, outcome.exit_code) == (3, 1)
    assert set(scores(outcome.rows)["reason"]) == {"RuntimeError: no score of a pair"}
    assert "no score of a pair" in (out / "logs" / "failures.log").read_text()
    assert (results.read(out).query("metric == 'redness'")["status"] == "ok").all()


def test_single_pictures_are_skipped_with_the_reason(
    bench, tmp_path: Path, out: Path, toys: str
):
    apart(out)
    words = ("--metrics", "apart,uciqe", "--plugin", toys, "--csv", "scores.csv")
    done = bench("score", "out/restored/toy/gain", *words)
    assert done.returncode == 1, "a metric that was asked for gives nothing"
    rows = pd.read_csv(tmp_path / "scores.csv").set_index("metric")
    assert set(rows.loc["apart", "status"]) == {"skipped"}
    assert "restored_views" in rows.loc["apart", "reason"].iloc[0]
    assert set(rows.loc["uciqe", "status"]) == {"ok"}
