"""The main job, from overrides to table and files."""

import errno
import json
import os
import re
import shutil
import signal
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from support.command_line import Started, calls, run
from support.messages import names

import sucre_bench as sb
from sucre_bench import plugins, results
from sucre_bench.engine import job as job_, preflight
from sucre_bench.engine.hydra_run import run_words as run_jobs
from sucre_bench.errors import DiskFullError, InputError, SucreBenchError
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.machine.files import not_writable
from sucre_bench.results.layout import Place

pytestmark = pytest.mark.short


@pytest.fixture
def out(tmp_path: Path, toys: str) -> Path:
    return tmp_path / "out"


def test_a_run_leaves_table_config_environment_and_pictures(out: Path):
    outcome = run(out, "save=full")
    assert (outcome.ok, outcome.failed, outcome.exit_code) == (3, (), 0)
    assert {p.name for p in (out / "restored" / "toy" / "gain").iterdir()} == {
        f"v{n}.{s}" for n in range(3) for s in ("png", "json", "npz")
    }
    for name in ("scores.parquet", "config.yaml", "environment.json"):
        assert (out / name).is_file()
    rows = pd.read_parquet(out / "scores.parquet")
    assert tuple(rows.columns) == (
        "dataset", "scene", "view", "method", "options", "options_id", "metric", "variant", "region", "value", "unit",
        "better", "n_pixels", "coverage", "status", "reason", "seconds", "peak_mb", "device", "seed", "code",
        "data_id", "time",
    )  # fmt: skip
    assert set(rows["metric"]) == {"psnr", "redness", "seconds", "peak_mb"}
    assert (rows["status"] == "ok").all()
    assert not (out / "parts").exists()
    # of a folder that was copied in part
    (out / "environment.json").unlink()
    assert run(out, "save=full").cached == 3


@pytest.mark.parametrize(
    ("change", "again"),
    [
        ("overwrite=always", 3),
        ("overwrite=never", 0),
        ("metrics=[psnr,redness,negative]", 3),
        ("metrics=[psnr]", 0),
        ("metrics.redness.factor=2", 3),
        ("save=full", 3),
        ("views=[v1.png]", 0),
    ],
)
def test_what_changed_is_computed_again_and_nothing_else(
    out: Path, tmp_path_factory: pytest.TempPathFactory, change: str, again: int
):
    made = tmp_path_factory.getbasetemp() / "unchanged"
    log = made.with_suffix(".log")
    words = (f"method.log={log}", "dataset.label=toy")
    if not made.exists():
        run(made, *words)
    shutil.copytree(made, out)
    before = len(calls(log))
    run(out, *words, change)
    assert len(calls(log)) == before + again


def test_results_of_other_data_are_not_replaced_unless_asked_for(out: Path):
    run(out)
    with pytest.raises(
        preflight.ProblemsError, match=r"its 'toy' has other options and data; give .*label"
    ):
        run(out, "method=gain2", "dataset.tag=other")
    assert run(out).cached == 3
    assert run(out, "dataset.tag=other", "overwrite=always").ok == 3


@pytest.mark.parametrize("folder", [False, True])
def test_a_file_that_results_rest_on_is_followed(out: Path, tmp_path: Path, folder: bool):
    table = tmp_path / "table"
    file = table / "gain" if folder else table
    file.parent.mkdir(exist_ok=True)
    options = ("method=tabulated", f"method.table={table}")
    file.write_text("1.5")
    assert run(out, *options).cached == 0
    first = run(out, *options)
    assert (first.ok, first.cached) == (2, 2)
    file.write_text("2.25")
    changed = run(out, *options)
    assert changed.cached == 0
    psnr = [
        o.rows.query("metric == 'psnr' and view == 'v0.png'")["value"].item()
        for o in (first, changed)
    ]
    assert psnr[0] != psnr[1]


def test_a_job_reads_what_an_earlier_job_of_its_sweep_writes(out: Path):
    size = ("dataset.width=64", "dataset.height=48", "dataset.views=3", "first=1")
    words = ("dataset=demo", *size, "metrics=[coverage]", "method=sucre,sucre_plus")
    other = out.with_name("other") / "restored/demo/sucre"
    with pytest.raises(SucreBenchError, match=rf"^{re.escape(str(other))}: .*method\.water"):
        run(out, *words, f"sucre_plus.water={other}", multirun=True)
    assert not (out / "scores.parquet").exists(), "nothing ran, not even the job before"
    outcome = run(out, *words, f"sucre_plus.water={out}/restored/demo/sucre", multirun=True)
    assert (outcome.ok, outcome.failed) == (2, ())


def test_what_a_method_took_elsewhere_counts_and_what_it_tells_is_json(
    out: Path, tmp_path: Path
):
    (tmp_path / "table").write_text("1")
    rows = run(out, "method=tabulated", f"method.table={tmp_path / 'table'}").rows
    kept = rows[rows["view"] == "v0.png"].set_index("metric")["value"]
    assert kept["seconds"] == 12.5
    assert np.isnan(kept["peak_mb"])
    told = (out / "restored" / "toy" / "tabulated" / "v0.json").read_text()
    content = json.loads(told, parse_constant=lambda word: pytest.fail(f"{word} is not JSON"))
    assert {
        "B": [0.2] * 3,
        "beta": [None] * 3,
        "deviation": [1.0, None],
    }.items() <= content.items()
    true = {"B": [0.1] * 3, "beta": [0.2] * 3, "gamma": [0.3] * 3, "encoding": "gamma"}
    assert content["true_water"] == true


def test_a_method_for_encoded_intensities_gets_them_and_its_result_is_brought_back(toys: str):
    """Half of an encoded intensity, in linear light: decode(encode(x) / 2)."""
    linear = np.linspace(0, 1, 60, dtype=np.float32).reshape(4, 5, 3)
    view = sb.View("a.png", sb.Arrays(linear), encoding="linear")
    result = sb.restore("halved", sb.Scene("one", [view], frozenset()), view)
    np.testing.assert_allclose(result.image, srgb_decode(srgb_encode(linear) / 2), atol=1e-6)
    assert "converted" in result.info
    plain = sb.View("a.png", sb.Arrays(linear))
    assert np.array_equal(
        sb.restore("halved", sb.Scene("one", [plain], frozenset()), plain).image, linear / 2
    )


def test_a_picture_that_is_gone_is_made_again(out: Path, tmp_path: Path):
    log = f"method.log={tmp_path / 'log'}"
    run(out, log)
    (out / "restored" / "toy" / "gain" / "v1.png").unlink()
    run(out, log)
    assert calls(tmp_path / "log")[3:] == ["v1.png"]


def test_another_metric_later_keeps_the_scores_there_were(out: Path):
    run(out, "metrics=[psnr]")
    outcome = run(out, "metrics=[negative]")
    assert {"psnr", "negative"} <= set(outcome.rows["metric"])
    assert (outcome.rows.groupby("metric").size() == 3).all()


@pytest.mark.parametrize(
    ("choice", "kept"),
    [
        ("views=[v2.png]", {"v2.png"}),
        ("every=2", {"v0.png", "v2.png"}),
        ("first=1", {"v0.png"}),
    ],
)
def test_views_can_be_chosen(out: Path, choice: str, kept: set[str]):
    assert set(run(out, choice).rows["view"]) == kept


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        ("raise", {"ValueError", "boom", "lines"}),
        ("shape", {"(20, 60, 3)", "(40, 60, 3)"}),
        ("nan", {"v1.png", "colour"}),
        ("none", {"NoneType", "Restoration"}),
        ("mutate", {"ValueError", "read-only"}),
        ("exit", {"SystemExit", "0"}),
    ],
)
def test_a_fault_on_one_view_is_a_row_and_the_others_go_on(
    out: Path, fault: str, named: set[str]
):
    outcome = run(out, "method=faulty", f"method.fault={fault}")
    assert (outcome.ok, len(outcome.failed), outcome.exit_code) == (2, 1, 1)
    failed = outcome.rows[outcome.rows["status"] == "failed"]
    assert list(failed["view"]) == ["v1.png"]
    assert named <= names(failed["reason"].item())
    assert "\n" not in failed["reason"].item()
    assert "Traceback" in (out / "logs" / "failures.log").read_text() or fault in (
        "shape",
        "nan",
        "none",
    )


NEEDS_A_BROKEN_LIBRARY = """
from dataclasses import dataclass
from sucre_bench import Restoration, method

@method(requires=("broken_library_xyz",))
@dataclass(frozen=True)
class Uses:
    def restore(self, scene, view):
        return Restoration(view.rgb)
"""


def test_a_package_that_breaks_when_imported_fails_the_job_with_its_reason(
    out: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "broken_library_xyz.py").write_text(
        "raise OSError('libcudart.so: cannot open')\n"
    )
    (tmp_path / "uses.py").write_text(NEEDS_A_BROKEN_LIBRARY)
    monkeypatch.syspath_prepend(tmp_path)
    plugins.load_file(tmp_path / "uses.py")
    outcome = run(out, "method=uses,gain", multirun=True)
    assert (outcome.ok, outcome.exit_code) == (3, 1)
    (reason,) = {f.reason for f in outcome.failed}
    assert (
        "broken_library_xyz does not import, OSError: libcudart.so: cannot open; pip install"
        in reason
    )


def test_a_metric_without_a_value_says_so_and_one_that_writes_into_the_picture_is_stopped(
    out: Path,
):
    rows = run(out, "metrics=[redness,undefined,painter,uciqe]").rows.set_index("metric")
    assert set(rows.loc["undefined", "status"]) == {"skipped"}
    assert set(rows.loc["undefined", "reason"]) == {"no value (NaN)"}
    assert set(rows.loc["painter", "status"]) == {"failed"}
    assert (rows.loc["redness", "value"] > 0).all()


@pytest.mark.parametrize(
    ("dataset", "named"),
    [("twins", r"two views .*'a.png'"), ("namesakes", r"2 scenes .*'one'")],
)
def test_a_dataset_with_two_views_or_scenes_of_one_name_is_refused(
    out: Path, dataset: str, named: str
):
    with pytest.raises(preflight.ProblemsError, match=named):
        run(out, f"dataset={dataset}")


def test_a_failed_view_is_tried_again_and_a_log_that_cannot_be_written_costs_no_result(
    out: Path,
):
    (out / "logs" / "failures.log").mkdir(parents=True)
    assert run(out, "method=faulty").ok == 2
    again = run(out, "method=faulty")
    assert (again.cached, len(again.failed)) == (2, 1)


def test_a_home_folder_is_understood(
    toys: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    assert run(Path("'~/results'"), "method.log='~/calls'").ok == 3
    assert (tmp_path / "results" / "scores.parquet").is_file()
    assert (tmp_path / "calls").is_file()
    assert not (tmp_path / "~").exists()


def test_a_launcher_that_is_not_known_here_is_refused_before_any_work(out: Path):
    with pytest.raises(SucreBenchError, match=r"no hydra/launcher is called .nowhere."):
        run_jobs(["dataset=toy", "method=gain", f"out={out}", "hydra/launcher=nowhere"], True)
    assert not out.exists()


@pytest.mark.filterwarnings("ignore")  # of optuna
@pytest.mark.parametrize(
    ("objective", "words", "best"),
    [
        ("psnr", (), "max"),
        ("psnr", ("hydra.sweeper.direction=minimize",), "min"),
        ("psi:colour", (), "min"),
    ],
)
def test_optuna_looks_for_the_better_values_unless_told(
    out: Path, tmp_path: Path, objective: str, words: tuple[str, ...], best: str
):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    sweep = ("hydra/sweeper=optuna", "hydra.sweeper.n_trials=3", f"hydra.sweep.dir={tmp_path}")
    demo = ("dataset=demo", "dataset.width=160", "dataset.height=120", "dataset.views=2")
    scored = ("metrics=[psnr,psi]", f"objective={objective}", "method.gain=interval(0.2,2)")
    rows = run(out, *sweep, *demo, *scored, *words, multirun=True).rows
    rows = rows[rows["metric"] == objective.partition(":")[0]]
    whole = rows[~rows["region"].str.contains("/", regex=False)]
    each = whole.groupby("method")["value"].mean()
    found = yaml.safe_load((tmp_path / "optimization_results.yaml").read_text())
    assert len(each) == 3
    assert found["best_value"] == pytest.approx(each.agg(best))


@pytest.mark.parametrize("objective", ["psnr", "psrn.masked", "observations.all"])
def test_an_objective_that_cannot_be_optimised_is_refused_before_any_work(
    out: Path, objective: str
):
    pytest.importorskip("hydra_plugins.hydra_optuna_sweeper")
    words = ("hydra/sweeper=optuna", "method.gain=interval(0,2)", f"objective={objective}")
    with pytest.raises(InputError, match="objective"):
        run(out, "metrics=[psnr:all,observations]", *words, multirun=True)
    assert not (out / "scores.parquet").exists()


def test_two_scenes_with_equal_view_names_do_not_overwrite_each_other(out: Path):
    import cv2

    run(out, "dataset=two_scenes", "metrics=[redness]")
    folder = out / "restored" / "two_scenes" / "gain"
    levels = [cv2.imread(str(folder / scene / "a.png")).mean() for scene in ("left", "right")]
    assert levels == [pytest.approx(51, abs=1), pytest.approx(204, abs=1)]


@pytest.mark.parametrize("workers", [0, 1])
def test_a_full_disk_ends_a_sweep_at_the_first_view_that_cannot_be_written_and_keeps_the_rest(
    out: Path,
    workers: int,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    words = (f"method.log={tmp_path / 'log'}", "method.gain=1,2,3", f"workers={workers}")
    write = job_.write_pictures

    def full_at_v1(folder: Path, place: Place, *more: Any) -> None:
        if place.stem.name == "v1":
            fault = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            raise not_writable(folder / "a.png", fault)
        write(folder, place, *more)

    with monkeypatch.context() as small:
        small.setattr(job_, "write_pictures", full_at_v1)
        with pytest.raises(DiskFullError, match=r"a\.png: .*disk.*; "):
            run(out, *words, multirun=True)
    assert calls(tmp_path / "log") == ["v0.png", "v1.png"]
    assert "failed" not in capsys.readouterr().err
    kept = results.read(out)
    assert (set(kept["view"]), set(kept["status"])) == ({"v0.png"}, {"ok"})
    again = run(out, *words, multirun=True)
    assert (again.ok, again.cached) == (9, 1)


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_keeps_what_is_done_and_says_how_to_go_on(
    out: Path, toys: str, tmp_path: Path, how: signal.Signals
):
    log = tmp_path / "log"
    words = ("dataset=toy", "dataset.views=5", "method=gain", "metrics=[psnr]", f"out={out}")
    staying = (f"method.log={log}", "method.stays_at=v2.png", "--plugin", toys)
    stopped = Started(tmp_path, "run", *words, *staying)
    deadline = time.monotonic() + 300
    while "v2.png" not in calls(log):
        assert time.monotonic() < deadline, "the run did not get going"
        time.sleep(0.02)
    stopped.send(how)
    done = stopped.ended()
    assert done.returncode == 130
    assert "stopped" in done.stdout
    assert "2 ok, 0 failed" in done.stdout
    assert "Traceback" not in done.stderr
    assert pd.read_parquet(out / "scores.parquet")["view"].nunique() == 2
