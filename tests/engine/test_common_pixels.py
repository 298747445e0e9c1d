"""Where methods fill different pixels, they are compared on those that all of them fill; no method runs again."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from support.command_line import but_times, calls, run
from support.toy_plugins import Toy

from sucre_bench import compare, results
from sucre_bench.engine.run import Outcome
from sucre_bench.results.restorations import read_mask
from sucre_bench.results.rows import COMMON
from sucre_bench.results.table import read_both


def sweep(out: Path, methods: str, *overrides: str) -> Outcome:
    return run(out, f"method={methods}", *overrides, multirun=True)


@pytest.fixture
def both(tmp_path: Path, toys: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A results folder of a method without holes and of one that fills the left half; made once, then copied."""
    made = tmp_path_factory.getbasetemp() / "gain-and-left-half"
    if not made.exists():
        sweep(made, "gain,left_half")
    return Path(shutil.copytree(made, tmp_path / "both"))


def scores(out: Path, pixels: compare.Pixels) -> pd.DataFrame:
    """A score by view and method, as it is compared."""
    rows = results.read(out)
    rows = compare.on_pixels(rows, read_both(out)[1]) if pixels == "common" else rows
    rows = rows[rows["metric"] == "psnr"]
    return rows.pivot(index="view", columns="method", values="value")


def psnr(columns: slice, bits: int = 8) -> list[float]:
    """Of each view of the toy scene, from the definition: the picture of so many bits against its reference."""
    (scene,) = Toy().scenes()
    levels = 2**bits - 1
    values = []
    for view in scene:
        picture = np.floor(view.rgb[:, columns] * levels + 0.5) / levels
        values.append(-10 * np.log10(np.mean((picture - view.reference[:, columns]) ** 2)))
    return values


def test_equal_restorations_tie_on_common_pixels_whatever_their_holes(both: Path):
    own, common = scores(both, "own"), scores(both, "common")
    assert (own["gain"] - own["left_half"]).abs().min() > 1e-3
    np.testing.assert_array_equal(common["gain"], common["left_half"])
    np.testing.assert_allclose(common["gain"], psnr(slice(0, 30)), rtol=1e-6)
    np.testing.assert_allclose(own["gain"], psnr(slice(None)), atol=1e-3)
    rows = read_both(both)[1]
    assert set(rows.loc[rows["metric"] == "psnr", "n_pixels"]) == {40 * 30}


def test_pictures_of_16_bits_are_compared_as_such(tmp_path: Path, toys: str):
    sweep(tmp_path, "gain,left_half", "bits=16")
    common = scores(tmp_path, "common")
    np.testing.assert_allclose(common["gain"], psnr(slice(0, 30), bits=16), rtol=1e-6)


def test_nothing_is_kept_or_computed_where_all_pixels_are_filled(tmp_path: Path, toys: str):
    sweep(tmp_path, "gain,gain2")
    assert not len(read_both(tmp_path)[1])
    assert read_mask(tmp_path / "restored" / "toy" / "gain" / "v0.png") is None


def test_holes_at_the_same_pixels_are_not_scored_twice(tmp_path: Path, toys: str):
    run(tmp_path, "method=left_half")
    run(tmp_path, "method=left_half", "method.label=again")
    assert not read_both(tmp_path)[1]["metric"].isin(["psnr", "redness"]).any()
    pd.testing.assert_frame_equal(scores(tmp_path, "common"), scores(tmp_path, "own"))


def test_a_method_that_comes_later_changes_the_common_pixels_of_all(tmp_path: Path, toys: str):
    log = tmp_path / "log"
    run(tmp_path, "method=left_half", f"method.log={log}")
    run(tmp_path, "method=gain", f"method.log={log}")
    common = scores(tmp_path, "common")
    np.testing.assert_allclose(common, np.transpose([psnr(slice(0, 30))] * 2), rtol=1e-6)
    run(tmp_path, "method=middle")
    assert len(calls(log)) == 6, "no method runs again"
    common = scores(tmp_path, "common")
    np.testing.assert_allclose(common, np.transpose([psnr(slice(15, 30))] * 3), rtol=1e-6)


def test_the_same_command_again_scores_nothing_and_goes_on_where_it_was_stopped(
    tmp_path: Path, toys: str
):
    sweep(tmp_path, "gain,left_half", "first=1")
    before = read_both(tmp_path)[1]
    sweep(tmp_path, "gain,left_half")
    whole = read_both(tmp_path)[1]
    same = whole[whole["view"] == "v0.png"].reset_index(drop=True)
    pd.testing.assert_frame_equal(same, before)  # their times too
    table = tmp_path / "scores.parquet"
    results.read(tmp_path).to_parquet(table, index=False)  # without the scores on common pixels
    sweep(tmp_path, "gain,left_half")
    pd.testing.assert_frame_equal(but_times(read_both(tmp_path)[1]), but_times(whole))


def test_a_score_that_failed_on_common_pixels_is_tried_again(both: Path):
    whole = read_both(both)[1]
    rows = pd.read_parquet(both / "scores.parquet")
    is_common = rows["variant"].str.endswith(COMMON) & (rows["metric"] == "psnr")
    assert is_common.any()
    rows.loc[is_common, ["status", "value"]] = "failed", float("nan")
    rows.to_parquet(both / "scores.parquet", index=False)
    sweep(both, "gain,left_half")
    pd.testing.assert_frame_equal(but_times(read_both(both)[1]), but_times(whole))


def test_a_restoration_made_anew_is_scored_anew(both: Path):
    run(both, "method=left_half", "method.stop=.25", "overwrite=always")
    np.testing.assert_allclose(scores(both, "common")["gain"], psnr(slice(0, 15)), rtol=1e-6)


def test_a_method_that_fails_or_fills_next_to_nothing_leaves_the_others_their_pixels(
    tmp_path: Path, toys: str
):
    sweep(tmp_path, "gain,left_half,faulty")
    assert scores(tmp_path, "common").loc["v1.png"].isna().to_dict() == {
        "gain": False,
        "left_half": False,
        "faulty": True,
    }
    run(tmp_path, "method=right_half", "method.stop=.517", "method.rows=.5")
    common = scores(tmp_path, "common")
    assert common["right_half"].isna().all()
    np.testing.assert_allclose(common["gain"], psnr(slice(0, 30)), rtol=1e-6)


def test_a_method_with_holes_on_older_data_takes_no_part(both: Path):
    sweep(both, "gain,gain2", "dataset.tag=newer", "overwrite=always")
    assert (read_both(both)[1]["status"] == "ok").all()
    np.testing.assert_allclose(scores(both, "common")["gain2"], psnr(slice(0, 60)), rtol=1e-3)


def test_methods_that_share_no_pixel_have_no_score_and_this_is_said(
    tmp_path: Path, toys: str, bench
):
    sweep(tmp_path, "left_half,right_half")
    assert scores(tmp_path, "common").isna().all(axis=None)
    done = bench("compare", str(tmp_path))
    assert "3 of 3 images" in done.stdout
    assert (
        "psnr" in bench("compare", str(tmp_path), "--pixels", "own", "--format", "csv").stdout
    )


def rewrite(picture: Path) -> None:
    """Write a picture again, as a program does that knows nothing of its mask."""
    import cv2

    cv2.imwrite(str(picture), cv2.imread(str(picture)))


# -- files that are gone or damaged ------------------------------------------------------------------------


def test_a_damaged_mask_or_picture_is_named_and_other_views_go_on(
    tmp_path: Path, toys: str, bench
):
    # all black: the picture does not show the holes
    run(tmp_path, "method=left_half", "method.gain=0")
    pictures = tmp_path / "restored" / "toy" / "left_half"
    rewrite(pictures / "v0.png")
    (pictures / "v1.png").write_bytes((pictures / "v1.png").read_bytes()[:40])
    sweep(tmp_path, "gain")
    own, common = scores(tmp_path, "own"), scores(tmp_path, "common")
    assert (own["gain"] == common["gain"]).tolist() == [True, True, False]
    said = bench("compare", str(tmp_path)).stdout
    assert "1 of 3 images" in said
    assert str(pictures / "v0.png") in said
    assert str(pictures / "v1.png") in said


# -- what cannot be scored again ---------------------------------------------------------------------------


def test_the_computed_image_is_scored_on_common_pixels_only_where_it_is_stored(
    tmp_path: Path, toys: str
):
    display, full = tmp_path / "display", tmp_path / "full"
    raw = "metrics.psnr.variants=[raw]"
    sweep(display, "gain,left_half", raw)
    pd.testing.assert_frame_equal(scores(display, "common"), scores(display, "own"))
    sweep(full, "gain,left_half", raw, "save=full")
    computed = psnr(slice(0, 30), bits=48)
    np.testing.assert_allclose(scores(full, "common")["gain"], computed, rtol=1e-6)


def compared(bench, *words: str) -> dict[str, dict]:
    """What `compare` says of each method's psnr."""
    told = json.loads(bench("compare", *words, "--json").stdout)
    return {record["method"]: record for record in told if record["metric"] == "psnr"}


def test_folders_with_a_method_each_are_compared_on_common_pixels_where_their_data_are_known(
    tmp_path: Path, toys: str, bench
):
    one, two = str(tmp_path / "one"), str(tmp_path / "two")
    run(tmp_path / "one", "method=gain", f"plugins=[{toys}]")
    run(tmp_path / "two", "method=left_half", f"plugins=[{toys}]")
    apart = compared(bench, one, two, "--plugin", toys)
    assert {record["pixels"] for record in apart.values()} == {"common"}
    means = [record["mean"] for record in apart.values()]
    assert means == pytest.approx([np.mean(psnr(slice(0, 30)))] * 2, rel=1e-6)
    assert not len(read_both(tmp_path / "one")[1])
    own = compared(bench, one, two, "--pixels", "own")
    assert {record["pixels"] for record in own.values()} == {"own"}
    for name in ("one", "two"):
        (tmp_path / name / "config.yaml").unlink()
    done = bench("compare", one, two)
    assert re.search(r"psnr .*own pixels.*\(.*common.*folder\)", done.stdout)


# -- what tables say ---------------------------------------------------------------------------------------


def test_the_page_and_the_run_take_common_pixels_by_default(both: Path, bench):
    outcome = sweep(both, "gain,left_half")
    (table,) = compare.compare(outcome.rows)
    (column,) = [column for column in table.columns if column.metric == "psnr"]
    (mean,) = {table.cells[name, column].mean for name in ("gain", "left_half")}
    assert mean == pytest.approx(np.mean(psnr(slice(0, 30))), rel=1e-6)
    assert bench("report", str(both)).returncode == 0
    page = (both / "report" / "index.html").read_text()
    assert "<small>common pixels</small>" in page
    assert ": 50.0 %" in page
