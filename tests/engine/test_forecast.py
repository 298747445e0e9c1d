"""What a run would do and take, before it does anything."""

import json
import math
from collections.abc import Callable
from pathlib import Path

from support.command_line import Done, run

from sucre_bench import results
from sucre_bench.engine.forecast import forecast

WORDS = ["dataset=toy", "metrics=[psnr,redness]", "tracking.uri=off"]


def test_it_tells_what_is_stored_and_writes_nothing_to_the_results_folder(tmp_path: Path, toys: str):
    out = tmp_path / "out"
    words = [*WORDS, f"out={out}", "method=gain"]
    (before,) = forecast(words, False).jobs
    assert (before.dataset, before.method, before.views, before.stored) == ("toy", "gain", 3, 0)
    assert math.isnan(before.seconds)
    assert "first=" in before.reason
    assert not out.exists()
    assert run(out, "first=1").ok == 1
    (after_one,) = forecast(words, False).jobs
    rows = results.read(out)
    assert after_one.stored == 1
    assert after_one.seconds == 2 * rows["seconds"].iloc[0]
    files = [path for path in out.rglob("*") if path.suffix in (".png", ".jpg") and "v0" in path.name]
    written = sum(path.stat().st_size for path in files if path.parts[len(out.parts)] != "references")
    assert math.isclose(after_one.disk_mb, 2 * written / 1e6)
    assert after_one.memory_mb > 0
    assert run(out).ok == 3
    (after,) = forecast(words, False).jobs
    assert (after.stored, after.seconds, after.disk_mb) == (3, 0, 0)


def test_a_methods_other_options_are_no_measure(tmp_path: Path, toys: str):
    run(tmp_path, "first=1")
    (job,) = forecast([*WORDS, f"out={tmp_path}", "method=gain", "method.gain=3", "overwrite=always"], False).jobs
    assert math.isnan(job.seconds)


def test_the_command_prints_jobs_and_an_object_for_programs(bench: Callable[..., Done], toys: str, tmp_path: Path):
    words = ["run", "--dry-run", "--plugin", toys, "-m", *WORDS, "method=gain,underwater", f"out={tmp_path / 'out'}"]
    told = bench(*words)
    assert told.returncode == 0, told.stderr
    assert "gain" in told.stdout
    assert "underwater" in told.stdout
    found = json.loads(bench(*words, "--json").stdout)
    assert [(job["method"], job["views"], job["stored"]) for job in found["jobs"]] == [
        ("gain", 3, 0),
        ("underwater", 3, 0),
    ]
    assert not (tmp_path / "out").exists()


def test_jobs_of_a_cluster_are_counted_together_and_their_limits_checked(
    bench: Callable[..., Done], toys: str, tmp_path: Path
):
    words = ["--plugin", toys, *WORDS, "-m", "method=gain", "shard.count=3", "shard.index=range(3)", "out=out"]
    run(tmp_path / "out", "first=1")
    cluster = ("hydra/launcher=slurm", "hydra.launcher.timeout_min=1", "hydra.launcher.mem_gb=0.1")
    done = bench("run", "--dry-run", *words, *cluster)
    (line,) = (line.split() for line in done.stdout.splitlines() if line.startswith("toy"))
    assert line[:5] == ["toy", "gain", "3", "3", "1"]  # jobs, views, stored
    assert "hydra.launcher.timeout_min=3" in done.stdout
    assert "hydra.launcher.mem_gb=1" in done.stdout
