"""What a run would do and take, before it does anything."""

import json
import math
from collections.abc import Callable
from pathlib import Path

from support.command_line import Done, run

from sucre_bench import results
from sucre_bench.engine.forecast import forecast

WORDS = ["dataset=toy", "metrics=[psnr,redness]", "tracking.uri=off"]


def test_it_says_what_is_stored_and_writes_nothing_to_the_results_folder(tmp_path: Path, toys: str):
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


def test_the_command_prints_parts_of_the_views_as_one_line_and_an_object_for_programs(
    bench: Callable[..., Done], toys: str, tmp_path: Path
):
    words = [
        "run",
        "--dry-run",
        "--plugin",
        toys,
        *WORDS,
        "-m",
        "method=gain",
        "shard.count=3",
        "shard.index=range(3)",
    ]
    run(tmp_path / "out", "first=1")
    done = bench(*words, "out=out")
    assert done.returncode == 0, done.stderr
    (line,) = (line.split() for line in done.stdout.splitlines() if line.startswith("toy"))
    assert line[:6] == ["toy", "gain", "3", "3", "1", "2"]  # jobs, views, stored, to do
    (job,) = json.loads(bench(*words, "out=out", "--json").stdout)
    assert (job["method"], job["jobs"], job["views"], job["stored"]) == ("gain", 3, 3, 1)
