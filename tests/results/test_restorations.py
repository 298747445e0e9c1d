"""What is kept of a restoration comes back as it was, or not at all."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from support.command_line import calls, run

from sucre_bench.errors import DamagedFileError
from sucre_bench.plugins.registry import find
from sucre_bench.results.restorations import (
    Measured,
    read_full,
    read_full_arrays,
    read_mask,
    write_full,
    write_masked_png,
)
from sucre_bench.results.rows import Row
from sucre_bench.scene import Restoration, Water

BASE = Row("sea", "reef", "a.png", "m", options_id="o1", data_id="d1", code="c1")
RNG = np.random.default_rng(5)
IMAGE = RNG.normal(0.5, 0.4, (24, 32, 3)).astype(np.float32)
IMAGE[3:5] = np.nan
WATER = Water(np.array([0.1, 0.4, 0.5]), np.array([0.4, 0.2, np.nan]), np.full(3, 0.3), "gamma")
INFO = {
    "cost": 0.1, "steps": 7, "why": "steep", "nothing": None, "unknown": float("nan"), "of": {"red": [1, 2.5]},
    "left": RNG.normal(size=(2, 3)).astype(np.float32), "peak": np.float32(0.1), "seen": np.array([True, False]),
}  # fmt: skip


def kept(folder: Path, info: dict[str, Any] | None = None) -> Path:
    restoration = Restoration(
        IMAGE, WATER, np.abs(IMAGE[..., 0]), INFO if info is None else info
    )
    write_full(folder / "a.npz", Measured(restoration, 12.5, float("nan")), BASE)
    return folder / "a.npz"


def test_all_of_it_comes_back_bit_by_bit(tmp_path: Path) -> None:
    found = read_full(kept(tmp_path), BASE)
    assert (found.seconds, np.isnan(found.peak_mb)) == (12.5, True)
    restoration = found.restoration
    np.testing.assert_array_equal(restoration.image, IMAGE, strict=True)
    np.testing.assert_array_equal(restoration.confidence, np.abs(IMAGE[..., 0]), strict=True)
    for name in ("veiling_light", "attenuation", "backscatter"):
        np.testing.assert_array_equal(getattr(restoration.water, name), getattr(WATER, name))
    assert restoration.water.encoding == "gamma"
    np.testing.assert_equal(restoration.info, INFO)
    assert restoration.info["left"].dtype == np.float32


@pytest.mark.parametrize("other", [{"options_id": "o2"}, {"data_id": "d2"}, {"code": "c2"}])
def test_of_other_options_data_or_code_it_is_none(
    tmp_path: Path, other: dict[str, str]
) -> None:
    assert read_full(kept(tmp_path), replace(BASE, **other)) is None


@pytest.mark.parametrize(
    "info", [{"path": Path("a")}, {1: "a whole number for a name"}, {"own": object()}]
)
def test_what_would_come_back_otherwise_is_kept_as_arrays_alone(
    tmp_path: Path, info: dict[Any, Any]
) -> None:
    path = kept(tmp_path, info)
    assert read_full(path, BASE) is None
    np.testing.assert_array_equal(read_full_arrays(path)["image"], IMAGE)


def test_of_damaged_bytes_nothing_is_read_and_nothing_raised(tmp_path: Path) -> None:
    path = kept(tmp_path)
    whole = path.read_bytes()
    unread = 0
    for place in range(10, len(whole), len(whole) // 60):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 16]) + whole[place + 1 :])
        found = read_full(path, BASE)
        if found is None:
            unread += 1
        else:  # in what no array rests on, such as the times of members
            np.testing.assert_array_equal(found.restoration.image, IMAGE)
        path.write_bytes(whole[:place])
        assert read_full(path, BASE) is None
    assert unread > 40
    path.unlink()
    assert read_full(path, BASE) is None


def test_a_damaged_mask_is_restored_again_although_its_rows_are_stored(tmp_path: Path) -> None:
    mask = np.isfinite(IMAGE[..., 0])
    write_masked_png(tmp_path / "a.png", np.zeros(IMAGE.shape, np.uint8), mask)
    whole = (tmp_path / "a.png").read_bytes()
    np.testing.assert_array_equal(read_mask(tmp_path / "a.png"), mask)
    (tmp_path / "a.png").write_bytes(whole[:41] + bytes(8) + whole[49:])
    with pytest.raises(DamagedFileError) as fault:
        read_mask(tmp_path / "a.png")
    assert "overwrite=always" in fault.value.remedy


# -- in a run ----------------------------------------------------------------------------------------------


@pytest.fixture
def out(tmp_path: Path, toys: str) -> Path:
    return tmp_path / "out"


def test_what_was_kept_whole_is_scored_again_without_restoring_it(out: Path, tmp_path: Path):
    log, wanted = f"method.log={tmp_path / 'log'}", "metrics=[psnr,ssim,water,redness]"
    run(out, log, "save=full")
    later = run(out, log, wanted)
    assert calls(tmp_path / "log") == ["v0.png", "v1.png", "v2.png"]
    times = ["time", "value", "seconds", "peak_mb"]
    fresh = run(tmp_path / "fresh", log, wanted)
    pd.testing.assert_frame_equal(
        later.rows.drop(columns=times), fresh.rows.drop(columns=times)
    )
    scored = [
        rows.loc[~rows["metric"].isin(["seconds", "peak_mb"]), "value"]
        for rows in (later.rows, fresh.rows)
    ]
    pd.testing.assert_series_equal(*scored, check_exact=True)
    took = later.rows.groupby("view")["seconds"].nunique()
    assert (took == 1).all(), "those of the one restoration"


@pytest.mark.parametrize(("change", "again"), [("overwrite=always", 3), ("damage", 1)])
def test_what_was_kept_whole_of_something_else_is_not_scored(
    out: Path, tmp_path: Path, change: str, again: int
):
    log = tmp_path / "log"
    run(out, f"method.log={log}", "save=full")
    kept = out / "restored/toy/gain/v1.npz"
    if change == "damage":
        kept.write_bytes(kept.read_bytes()[:-100])
    run(out, f"method.log={log}", "metrics=[psnr,ssim]", *([change] if "=" in change else []))
    assert len(calls(log)) == 3 + again


def test_what_was_kept_whole_is_of_the_picture_beside_it(out: Path, tmp_path: Path):
    """Also when the same label was run otherwise in between."""
    run(out, "method.gain=1.1", "save=full")
    run(out, "method.gain=0.5", "method.label=gain", "overwrite=always")
    assert not list(out.rglob("restored/**/*.npz"))
    run(out, "method.gain=0.5", "method.label=gain", "save=full")
    with np.load(out / "restored/toy/gain/v1.npz") as arrays:
        image = arrays["image"]
    (view,) = (
        view
        for view in next(iter(find("dataset", "toy").cls().scenes()))
        if view.name == "v1.png"
    )
    np.testing.assert_allclose(image, view.rgb * 0.5, rtol=1e-6)
