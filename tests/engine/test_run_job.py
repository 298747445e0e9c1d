"""One job: what makes all of it fail, and `display=...@scene`, which shows all views of a scene alike."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from support.command_line import calls, run

pytestmark = pytest.mark.short

NAMES = ("v0", "v1", "v2")


@pytest.fixture
def out(tmp_path: Path, toys: str) -> Path:
    return tmp_path / "out"


def shown(out: Path, name: str) -> np.ndarray:
    return cv2.imread(str(out / "restored" / "toy" / "gain" / f"{name}.png"))[..., ::-1].astype(
        float
    )


def computed(out: Path) -> np.ndarray:
    """What the method has computed of every view (3, H, W, 3)."""
    stored = (np.load(out / "restored" / "toy" / "gain" / f"{name}.npz") for name in NAMES)
    return np.stack([arrays["image"].astype(float) for arrays in stored])


def test_all_views_are_shown_with_percentiles_of_the_scene(out: Path, tmp_path: Path) -> None:
    log = tmp_path / "log"
    outcome = run(out, "save=full", "method.display=stretch-5-95@scene", f"method.log={log}")
    assert (outcome.ok, outcome.exit_code) == (3, 0)
    assert calls(log) == ["v0.png", "v1.png", "v2.png"], "each view is restored once"
    J = computed(out)
    low, high = np.percentile(J.reshape(-1, 3), [5, 95], axis=0)
    expected = 255 * ((J - low) / (high - low)).clip(0, 1)
    np.testing.assert_allclose([shown(out, name) for name in NAMES], expected, atol=0.51)


def test_a_view_that_is_added_changes_how_all_are_shown(out: Path) -> None:
    command = ("save=full", "method.display=white-90@scene")
    run(out, *command, "views=[v0.png]")
    alone = shown(out, "v0")
    outcome = run(out, *command)
    assert (outcome.ok, outcome.exit_code) == (3, 0)
    J = computed(out)
    top = np.percentile(J.reshape(-1, 3), 90, axis=0)
    assert np.abs(shown(out, "v0") - alone).max() >= 1
    np.testing.assert_allclose(shown(out, "v0"), 255 * (J[0] / top).clip(0, 1), atol=0.51)


def test_shards_show_all_views_alike_and_are_not_done_again(out: Path, tmp_path: Path) -> None:
    log, display = tmp_path / "log", "method.display=white-90@scene"
    run(out, display)
    whole = {name: shown(out, name) for name in NAMES}
    shards = [display, "shard.count=2", "shard.index=0,1", f"method.log={log}"]
    assert run(tmp_path / "shards", *shards, multirun=True).exit_code == 0
    for name in NAMES:
        np.testing.assert_array_equal(shown(tmp_path / "shards", name), whole[name])
    before = calls(log)
    assert run(tmp_path / "shards", *shards, multirun=True).cached == 3
    assert calls(log) == before


def test_a_score_outside_its_metrics_range_failed(out: Path) -> None:
    rows = run(out, "metrics.redness.factor=100").rows
    of_metric = rows[rows["metric"] == "redness"]
    assert (of_metric["status"] == "failed").all()
    assert of_metric["reason"].str.contains("redness:plain is .* range 0 to 9").all()
    assert (rows.loc[rows["metric"] == "psnr", "status"] == "ok").all()
