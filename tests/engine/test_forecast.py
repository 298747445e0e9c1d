"""What a run would do and take, before it does anything."""

import math
from pathlib import Path

import numpy as np
from support.command_line import run

from sucre_bench import results
from sucre_bench.engine.forecast import forecast
from sucre_bench.imaging.image_files import write_png

WORDS = ["dataset=toy", "metrics=[psnr,redness]", "tracking.uri=off"]


def test_it_says_what_is_stored_and_writes_nothing_to_the_results_folder(
    tmp_path: Path, toys: str
):
    out = tmp_path / "out"
    words = [*WORDS, f"out={out}", "method=gain"]
    (before,) = forecast(words, False)
    assert (before.dataset, before.method, before.views, before.stored) == ("toy", "gain", 3, 0)
    assert math.isnan(before.seconds)
    assert not out.exists()
    assert run(out, "first=1").ok == 1
    (after_one,) = forecast(words, False)
    assert after_one.stored == 1
    assert after_one.seconds == 2 * results.read(out)["seconds"].iloc[0]
    (other,) = forecast([*words, "method.gain=3", "overwrite=always"], False)
    assert math.isnan(other.seconds), "other options are no measure"
    assert run(out).ok == 3
    (after,) = forecast(words, False)
    assert (after.stored, after.seconds) == (3, 0)


def test_views_that_lack_what_a_method_needs_are_not_counted_as_work(tmp_path: Path) -> None:
    write_png(tmp_path / "a.png", np.zeros((8, 9, 3), np.uint8))
    words = [f"dataset.root={tmp_path}", f"out={tmp_path / 'out'}", "tracking.uri=off"]
    (one,) = forecast(["dataset=photos", "method=sucre", "metrics=[uciqe]", *words], False)
    assert (one.views, one.stored, one.skipped, one.seconds) == (1, 0, 1, 0)
    assert "depth" in one.lack
