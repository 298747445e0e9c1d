"""What a run would do and take, before it does anything."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import pytest
from support.command_line import Done
from support.toy_runs import run

from sucre_bench.engine.forecast import forecast
from sucre_bench.machine.measured_rates import MeasuredRates, Rates

WORDS = ["dataset=toy", "metrics=[psnr,redness]", "tracking.uri=off"]


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name, appauthor: tmp_path / "cache" / name)
    return tmp_path / "cache"


def test_it_tells_what_is_stored_and_writes_nothing_to_the_results_folder(tmp_path: Path, toys: str, cache: Path):
    out = tmp_path / "out"
    words = [*WORDS, f"out={out}"]
    before = forecast([*words, "method=gain"], False).jobs[0]
    assert (before.dataset, before.method, before.views, before.stored) == ("toy", "gain", 3, 0)
    assert before.seconds > 0
    assert before.memory_mb > 0
    assert before.disk_mb > 0
    assert not out.exists()
    assert run(out).ok == 3
    after = forecast([*words, "method=gain"], False).jobs[0]
    assert (after.stored, after.seconds, after.disk_mb) == (3, 0, 0)


def test_a_method_that_fails_on_the_small_view_has_no_estimate(tmp_path: Path, toys: str, cache: Path):
    (job,) = forecast([*WORDS, f"out={tmp_path}", "method=faulty", "views=[v1.png]"], False).jobs
    assert (job.views, job.stored) == (1, 0)
    assert math.isnan(job.seconds)
    assert "boom" in job.reason


def test_rates_are_measured_once(tmp_path: Path):
    rates, times = Rates(1, 2, 3, 4, 5, 6), []

    def measure() -> Rates:
        times.append(1)
        return rates

    path = tmp_path / "cache" / "rates.json"
    assert [MeasuredRates(path).get("sucre", measure) for _ in range(3)] == [rates] * 3
    assert len(times) == 1
    for content in ("", "[]", '{"sucre": {"view_s": 1}}', '{"sucre": null}'):
        path.write_text(content)
        assert MeasuredRates(path).get("sucre", measure) == rates
    assert len(times) == 5


def test_the_command_prints_jobs_and_an_object_for_programs(
    bench: Callable[..., Done], toys: str, tmp_path: Path, cache: Path
):
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
    program: Callable[..., Done], toys: str, cache: Path
):
    words = ["--dry-run", "--plugin", toys, *WORDS, "-m", "method=gain", "shard.count=3", "shard.index=range(3)"]
    done = program("run", *words, "hydra/launcher=slurm", "hydra.launcher.timeout_min=1", "hydra.launcher.mem_gb=0.1")
    (line,) = (line.split() for line in done.stdout.splitlines() if line.startswith("toy"))
    assert line[:4] == ["toy", "gain", "3", "3"]  # jobs, views
    assert "hydra.launcher.timeout_min=3" in done.stdout
    assert "hydra.launcher.mem_gb=1" in done.stdout
