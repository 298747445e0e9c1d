"""The main job on real underwater photographs, where they are at hand beside the checkout."""

from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from support.places import DATA

import sucre_bench as sb
from sucre_bench.engine.hydra_run import run_words as run_jobs
from sucre_bench.engine.run import Outcome
from sucre_bench.imaging.chart_patches import measure

# psi-bar of the unrestored photographs, degrees, by chart from near to far.
INPUT_PSI = {
    "D5_fig01_LFT_3374.png": [30.8, 33.8, 35.9, 36.8],
    "LFT_3411.png": [23.2, 26.9, 29.6, 34.9],
}


def run(folder: str, out: Path, *overrides: str) -> Outcome:
    root = DATA / folder
    if not root.is_dir():
        pytest.skip(f"needs the real scene {folder} in {DATA}")
    words = (
        "dataset=colmap",
        f"dataset.root={root}",
        f"out={out}",
        "tracking.uri=off",
        "report=false",
        "workers=0",
    )
    return run_jobs([*words, *overrides], True)


def by_chart(rows: pd.DataFrame, method: str) -> dict[str, list[float]]:
    charts = rows[
        (rows["metric"] == "psi")
        & (rows["method"] == method)
        & (rows["region"].str.fullmatch(r"chart\d"))
    ]
    return {
        str(v): own.sort_values("region")["value"].tolist() for v, own in charts.groupby("view")
    }


SCALE = 0.35  # a tenth of the time; psi of `sucre_plus` is a degree smaller than at full size
SUCRE = ("sucre_paper", "sucre_plus")


@pytest.fixture(scope="module")
def d5(tmp_path_factory: pytest.TempPathFactory) -> Outcome:
    """The two photographs of Sea-thru's D5 with their eight charts."""
    words = (
        f"method={','.join(('underwater', *SUCRE))}",
        f"views=[{','.join(INPUT_PSI)}]",
        "metrics=[psi,negative]",
    )
    outcome = run(
        "seathru_d5_charts",
        tmp_path_factory.mktemp("d5"),
        f"dataset.image_scale={SCALE}",
        *words,
    )
    assert outcome.exit_code == 0
    return outcome


def test_sucre_brings_the_charts_of_sea_thru_d5_closer_to_their_colours(d5: Outcome):
    unrestored, restored = (by_chart(d5.rows, m) for m in ("underwater", "sucre_paper"))
    for view, expected in INPUT_PSI.items():
        assert unrestored[view] == pytest.approx(expected, abs=1)
        assert (np.array(restored[view]) < unrestored[view]).all()

    # Red patches look red and yellow ones yellow, at every distance, where the photographs are blue-green.
    scene = next(sb.load_scenes("colmap", root=DATA / "seathru_d5_charts", image_scale=SCALE))
    compared = [
        (view, chart)
        for view in INPUT_PSI
        for chart in scene[view].charts
        if is_wide(scene[view], chart)
    ]
    assert len(compared) == 6
    for view, chart in compared:
        before, after = (
            patches(d5.out, method, view, chart) for method in ("underwater", "sucre_paper")
        )
        assert before["red"][0] < 1.2 * before["red"][1:].max()
        assert after["red"][0] > 1.3 * after["red"][1:].max()
        assert after["yellow"][:2].min() > 1.2 * after["yellow"][2]


def is_wide(view: sb.View, chart: sb.Chart) -> bool:
    """Whether patches of a chart have several pixels: a single one is mixed with those around it."""
    return all(
        r.n_pixels > 1 for r in measure(view.rgb, chart) if r.patch.name in ("red", "yellow")
    )


def test_sucre_plus_differs_less_between_charts_and_few_of_its_colours_are_negative(
    d5: Outcome,
):
    # (views, charts)
    psi = {name: np.array(list(by_chart(d5.rows, name).values())) for name in SUCRE}
    negative = d5.rows[d5.rows["metric"] == "negative"].groupby("method")["value"].mean()
    assert psi["sucre_plus"].std(ddof=1) < psi["sucre_paper"].std(ddof=1) - 2
    assert negative["sucre_plus"] < 0.005 < negative["sucre_paper"] < 0.5


def patches(out: Path, method: str, view: str, chart: sb.Chart) -> dict[str, np.ndarray]:
    """Median colours of a chart's patches in a restored picture, by name."""
    picture = cv2.imread(str(out / "restored" / "colmap" / method / view))[..., ::-1]
    return {
        reading.patch.name: reading.rgb
        for reading in measure(picture.astype(np.float32), chart)
    }


def test_every_restorer_runs_on_the_pool(tmp_path: Path):
    outcome = run(
        "subvo_pool", tmp_path, "method=underwater,gray_world,histogram_stretch,stitching,sucre_paper",
        "dataset.image_scale=0.15", "every=6", "metrics=[uciqe,uiqm,coverage]",
    )  # fmt: skip
    assert (outcome.ok, outcome.failed, outcome.skipped) == (10, (), ())
    coverage = (
        outcome.rows[outcome.rows["metric"] == "coverage"].groupby("method")["value"].mean()
    )
    assert coverage["underwater"] == 1
    assert 0.1 < coverage["sucre_paper"] < 0.9  # as far as its depth maps reach
