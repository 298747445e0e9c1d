"""What a study may be."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import yaml
from support.made_results import followed, words
from support.messages import refused
from support.places import ROOT

from sucre_bench.compare import COSTS
from sucre_bench.engine.preflight import base_row
from sucre_bench.jobs import compose_jobs
from sucre_bench.reports.paper import Study
from sucre_bench.results.rows import frame


@pytest.mark.parametrize(
    ("given", "named"),
    [
        ({"metric": ["psnr"]}, {"study.metric", "'metrics'"}),
        ({"metrics": ["pnsr"]}, {"study.metrics", "pnsr", "'psnr'"}),
        ({"metrics": ["psnr:maskd"]}, {"maskd", "'masked'"}),
        ({"metrics": 3}, {"study.metrics", "tuple"}),
        ({"figures": ["score"]}, {"study.figures", "score", "'scores'"}),
        ({"along": "degrade.withn"}, {"study.along", "withn", "'within'"}),
        ({"along": "within"}, {"study.along", "degrade.NAME"}),
        ({"baseline": ["a"]}, {"study.baseline", "text"}),
        ({"spread": "wide"}, {"study.spread", "True", "False"}),
        ({"name": "../up"}, {"study.name", "../up"}),
        ({"name": ""}, {"study.name"}),
    ],
)
def test_what_is_wrong_with_a_study_is_said(given: dict[str, Any], named: set[str]):
    with refused(*named):
        Study.of({"name": "s", **given})


def test_a_study_takes_one_word_for_a_list_and_null_for_nothing():
    study = Study.of(
        {"name": "s", "metrics": "psnr", "baseline": None, "figures": ["scores"], "along": None}
    )
    assert study == Study("s", metrics=("psnr",), figures=("scores",))


@pytest.mark.parametrize("path", sorted((ROOT / "conf" / "experiment").glob("*.yaml")), ids=str)
def test_every_experiment_has_a_study_that_can_be_made(path: Path):
    experiment = yaml.safe_load(path.read_text())
    if "study" not in experiment:
        pytest.skip("only restores")
    study = Study.of(experiment["study"])
    computed = {metric.partition(":")[0] for metric in experiment.get("metrics", [])}
    assert not computed or {metric.partition(":")[0] for metric in study.metrics} <= {
        *computed,
        *COSTS,
    }
    assert path.stem == study.name == Path(experiment["out"]).name
    sweeper = experiment["hydra"]["sweeper"]
    methods = [
        one["label"] if isinstance(one, dict) else one for one in sweeper.get("methods", [])
    ]
    assert not study.baseline or study.baseline in methods
    assert not study.along or study.along in sweeper["params"]


@pytest.mark.parametrize(
    ("swept", "expected"),
    [
        ("degrade.bits=3,null,5", ["3", "5", "none"]),
        ("degrade.depth_noise=0.1,0,0.02", ["0", "0.02", "0.1"]),
        ("dataset.water=turbid,clear", ["turbid", "clear"]),
        ("method.refine=true,false", ["True", "False"]),
    ],
)
def test_what_the_bench_writes_into_rows_is_what_a_study_reads(swept: str, expected: list[str]):
    jobs = compose_jobs.jobs(["dataset=demo", "method=sucre", swept], True).jobs
    rows = frame(replace(base_row(job), view="v", value=1.0) for job in jobs)
    one = followed(rows, swept.partition("=")[0])
    assert words(one) == expected
    assert (one.title, one.methods) == ("demo", ("sucre",))
