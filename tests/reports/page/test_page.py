import base64
import json
import math
import re
import shlex
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from support.made_results import ESTIMATE, PSNR, TRUTH, made_results

from sucre_bench import results
from sucre_bench.compare import compare
from sucre_bench.engine.hydra_run import run_words as run
from sucre_bench.jobs import compose_jobs
from sucre_bench.jobs.rerun import Rerun
from sucre_bench.reports import page as report
from sucre_bench.results.restorations import write_masked_png
from sucre_bench.results.rows import Row


class Page(HTMLParser):
    """What a browser makes of the page: script blocks by id, elements with attributes, text outside of scripts."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.scripts: list[tuple[dict[str, str | None], str]] = []
        self.text = ""
        self.source = path.read_text()
        self.feed(self.source)

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.append((tag, dict(attributes)))
        if tag == "script":
            self.scripts.append((dict(attributes), ""))

    def handle_data(self, data: str) -> None:
        if self.scripts and self.tags[-1][0] == "script" and self.lasttag == "script":
            self.scripts[-1] = (self.scripts[-1][0], self.scripts[-1][1] + data)
        else:
            self.text += data

    def handle_endtag(self, tag: str) -> None:
        self.tags.append((f"/{tag}", {}))

    @property
    def datasets(self) -> list[dict[str, Any]]:
        return [
            json.loads(text)
            for attributes, text in self.scripts
            if attributes.get("class") == "dataset"
        ]

    def blocks(self, kind: str) -> dict[str, dict[str, str | None]]:
        return {str(a["id"]): a for a, _ in self.scripts if a.get("data-kind") == kind}

    def picture(self, name: str) -> np.ndarray:
        (text,) = [text for attributes, text in self.scripts if attributes.get("id") == name]
        return np.asarray(
            cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_UNCHANGED)
        )


def written(out: Path, rows: pd.DataFrame, **how: Any) -> Page:
    return Page(report.write(out, rows, compare(rows), **how))


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Page, Path]:
    """A page as it usually is, and its folder."""
    folder = tmp_path_factory.mktemp("made")
    return written(folder, made_results(folder)), folder


def test_a_run_with_faults_makes_a_page_that_says_what_failed_and_how_it_was_made(
    toys: str, tmp_path: Path
):
    words = ("dataset=toy", "method=gain,faulty,needs_charts", "metrics=[redness]")
    outcome = run([*words, "tracking.uri=off", f"out={tmp_path}"], True)
    page = written(tmp_path, outcome.rows)
    for said in (
        "ValueError: boom",
        "needs charts",
        "5 restorations ok, 1 failed, 3 skipped",
        "sucre-bench run",
    ):
        assert said in page.text
    (dataset,) = page.datasets
    states = [[r["status"] for r in view["results"]] for view in dataset["views"]]
    assert [m["label"] for m in dataset["methods"]] == ["gain", "faulty", "needs_charts"]
    assert states == [
        ["ok", "ok", "skipped"],
        ["ok", "failed", "skipped"],
        ["ok", "ok", "skipped"],
    ]
    assert len(page.blocks("image/webp")) == 3 + 3 + 5  # views, references, restorations


def test_views_have_their_scores_coverage_water_and_truth(made: tuple[Page, Path]):
    view = made[0].datasets[0]["views"][1]
    clever = view["results"][1]
    assert clever["scores"]["psnr:masked"] == PSNR["clever"][1]
    # what is of charts, or took time, covers nothing
    assert clever["covers"] == {"psnr:masked": 0.75}
    assert {k: clever["water"][k] for k in ESTIMATE} == ESTIMATE
    assert view["truth"] == TRUTH
    assert (clever["record"], clever["limits"]) == (
        {"steps": 7, "write_seconds": 0.1},
        ["flat"],
    )
    assert view["results"][0]["water"] is None


def test_the_page_may_reach_nothing_outside_and_its_links_lead_to_files(
    made: tuple[Page, Path],
):
    page, folder = made
    (policy,) = [a["content"] for tag, a in page.tags if tag == "meta" and "http-equiv" in a]
    assert policy.startswith("default-src 'none'")
    assert "http" not in policy
    assert "unsafe" not in policy
    for _, attributes in page.tags:
        for name in ("src", "href"):
            assert not re.match(r"\s*(https?:)?//", attributes.get(name) or "")
    links = re.findall(r'"link":"([^"]+)"', page.source)
    assert len(links) == 3 + 3 + 8
    assert all((folder / "report" / link).resolve().is_file() for link in links)


def test_damaged_files_cost_their_picture_and_nothing_else(tmp_path: Path):
    rows = made_results(tmp_path)
    (tmp_path / "restored/reef/clever/v0.png").write_bytes(b"\x89PNG not")
    (tmp_path / "restored/reef/clever/v0.json").write_text("{")
    page = written(tmp_path, rows)
    result = page.datasets[0]["views"][0]["results"][1]
    assert result["picture"]["id"] not in page.blocks("image/webp")
    assert result["water"] is None


def test_nothing_that_went_well_still_makes_a_page(tmp_path: Path):
    rows = results.frame(
        [Row("reef", method="m", value=math.nan, status="failed", reason="no such folder")]
    )
    page = written(tmp_path, rows)
    assert "no such folder" in page.text
    assert len(page.source) < 200_000  # no plotting library for no plot


# -- pictures ----------------------------------------------------------------------------------------------


def test_a_stored_mask_tells_holes_from_black_pixels(tmp_path: Path):
    rows = made_results(tmp_path)
    mask = np.ones((64, 96), np.bool_)
    mask[:, :10] = False  # of the 24 columns that are black
    path = tmp_path / "restored/reef/clever/v0.png"
    write_masked_png(path, cv2.imread(str(path)), mask)
    page = written(tmp_path, rows)
    ids = [result["picture"]["id"] for result in page.datasets[0]["views"][0]["results"]]
    holes = page.picture(f"{ids[1]}-holes")[..., 3] > 0
    np.testing.assert_array_equal(holes, ~mask)
    assert f"{ids[0]}-holes" not in page.blocks("image/png")  # its coverage is 1


def test_the_map_of_confidence_is_bright_where_it_is_large(tmp_path: Path):
    rows = made_results(tmp_path)
    confidence = np.tile(np.linspace(2, 4, 96, dtype=np.float32), (64, 1))
    np.savez(tmp_path / "restored/reef/clever/v0.npz", confidence=confidence)
    page = written(tmp_path, rows)
    name = page.datasets[0]["views"][0]["results"][1]["picture"]["id"]
    about = page.blocks("image/webp")[f"{name}-confidence"]
    assert [float(str(about[k])) for k in ("data-low", "data-high")] == pytest.approx(
        [2.04, 3.96], abs=0.025
    )
    shown = page.picture(f"{name}-confidence").astype(int)
    assert shown[32, 90].sum() > shown[32, 4].sum()  # bright where it is large


def test_many_views_keep_some_pictures_evenly_and_link_to_the_others(tmp_path: Path):
    # 2 x (3 views, 3 references, 8 restorations): half of them may be kept
    datasets = [
        "reef",
        "wreck",
    ]
    rows = made_results(tmp_path, datasets=datasets)
    page = written(tmp_path, rows, widths=((5, 960), (14, 40)))
    kept = [[bool((v["original"] or {}).get("id")) for v in d["views"]] for d in page.datasets]
    assert [sum(k) for k in kept] == [1, 1]
    assert all(v["original"]["link"] for d in page.datasets for v in d["views"])
    assert {page.picture(name).shape[1] for name in page.blocks("image/webp")} == {40}


# -- commands ----------------------------------------------------------------------------------------------


def composed(words: list[str]) -> Any:
    assert words[:2] == ["sucre-bench", "run"]
    return compose_jobs.jobs(shlex.split(shlex.join(words))[2:], False).jobs[0]


@pytest.mark.parametrize(
    "overrides",
    [
        [
            "dataset=toy",
            "dataset.views=2",
            "dataset.tag='a, \"b\" $(c)'",
            "dataset.label='my reef'",
            "method=gain",
        ],
        [
            "dataset=toy",
            "method=gain",
            "method.gain=1e-7",
            "method.mode=fancy",
            "method.label='it\\'s true'",
        ],
        [
            "dataset=toy",
            "method=gain",
            "method.log='/tmp/dive ünï/[x]{y}=z'",
            "method.display=stretch-2-98",
        ],
        ["dataset=toy", "dataset.tag='true'", "method=gain", "degrade.depth_noise=0.1"],
        [
            "dataset=toy",
            "dataset.tag='3'",
            "method=gain",
            "degrade.within=2",
            "degrade.noise=0.02",
            "degrade.seed=4",
        ],
        [
            "dataset=demo",
            "dataset.water=turbid",
            "seed=5",
            "method=sucre",
            "method.physical=true",
            "replicate=2",
        ],
    ],
)
def test_a_rows_command_composes_to_the_job_that_made_it(toys: str, overrides: list[str]):
    from sucre_bench.engine.preflight import base_row

    job = compose_jobs.jobs(overrides, False).jobs[0]
    row = base_row(job)
    again = composed(Rerun(row.dataset, row.method, json.loads(row.options), row.seed).words())
    assert json.loads(base_row(again).options) == json.loads(row.options)
    assert (again.dataset.label, again.method.label, again.degrade) == (
        row.dataset,
        row.method,
        job.degrade,
    )
    assert (base_row(again).seed, base_row(again).options_id) == (row.seed, row.options_id)


def test_a_views_command_runs_and_gives_the_same_score(
    toys: str, tmp_path: Path, bench: Callable[..., Any]
):
    out = tmp_path / "first run"
    base = [
        "dataset=toy",
        "metrics=[redness]",
        "metrics.redness.variants=[double]",
        "tracking.uri=off",
        f"out='{out}'",
    ]
    rows = run([*base, f"plugins=[{toys}]", "method=gain", "method.gain=0.7"], False).rows
    (dataset,) = written(out, rows).datasets
    parts = [dataset["methods"][0]["command"], dataset["views"][1]["words"], dataset["metrics"]]
    said = shlex.split(" ".join(parts))
    assert "--plugin" in said
    done = bench(*said[1:], "tracking.uri=off", "report=false")
    assert done.returncode == 0, done.stderr
    again = results.read(tmp_path / "again")
    keys = ["view", "method", "metric", "variant", "value", "options_id"]
    wanted = rows[(rows["metric"] == "redness") & (rows["view"] == "v1.png")][keys]
    pd.testing.assert_frame_equal(
        again[again["metric"] == "redness"][keys].reset_index(drop=True),
        wanted.reset_index(drop=True),
    )
