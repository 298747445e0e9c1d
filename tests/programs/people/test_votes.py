"""Files of votes from strangers: what is no vote does not count, and is named."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.command_line import run_here
from support.places import TOYS
from support.registries import registry
from support.toy_runs import run

from sucre_bench import plugins, results

Bench = Callable[..., Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two methods on three views."""
    place = tmp_path_factory.mktemp("made")
    with plugins.using(registry(TOYS)):
        for label, gain in (("bright", 1.0), ("dark", 0.4)):
            run(place / "results", f"method.gain={gain}", f"method.label={label}", "report=false")
    done = run_here(place, "study", "results", "--methods", "bright,dark", "--out", "study.html")
    assert done.returncode == 0, done.stderr
    return place


@pytest.fixture
def study(made: Path, tmp_path: Path, toys: str) -> dict[str, Any]:
    """The study's key, with the pictures by view and method; the results lie in the test's folder."""
    shutil.copytree(made / "results", tmp_path / "results")
    (key,) = (tmp_path / "results" / "people").glob("*.json")
    told = json.loads(key.read_text())
    return {**told, "by": {(one["view"], one["method"]): name for name, one in told["pictures"].items()}}


def vote(study: dict[str, Any], n: int, view: str = "v0.png", choice: str = "left", **other: Any) -> dict[str, Any]:
    sides = {"left": study["by"][view, "bright"], "right": study["by"][view, "dark"]}
    return {"n": n, **sides, "choice": choice, "seconds": 1.5, **other}


def write(path: Path, study: dict[str, Any], votes: Any, **other: Any) -> str:
    told = {"format": "sucre_bench votes", "version": 1, "study": study["study"], "observer": "o1", "votes": votes}
    path.write_text(json.dumps({**told, **other}))
    return str(path)


def evaluated(bench: Bench, *files: str) -> tuple[dict[str, Any], str]:
    done = bench("study", "results", "--votes", *files, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def test_votes_become_a_metric_that_a_run_keeps(bench: Bench, study: dict[str, Any], tmp_path: Path):
    votes = [vote(study, n, f"v{n % 3}.png", "right" if n == 5 else "left") for n in range(12)]
    evaluated(bench, write(tmp_path / "a.json", study, votes))
    run(tmp_path / "results", "method.gain=1.0", "method.label=bright", "report=false")
    rows = results.read(tmp_path / "results")
    own = rows[rows["metric"] == "preference"]
    assert (len(own), set(own["view"])) == (6, {"v0.png", "v1.png", "v2.png"})
    means = own.groupby("method")["value"].mean()
    assert means["bright"] == pytest.approx(-means["dark"])
    assert means["bright"] > 0.5
    assert "preference" in bench("compare", "results", "--metric", "preference").stdout
    assert "preference" not in bench("lineup", "results", "--out", "-").stdout, "no run computes it"


def test_rows_of_pictures_that_are_made_anew_go(bench: Bench, study: dict[str, Any], tmp_path: Path):
    file = write(tmp_path / "a.json", study, [vote(study, n) for n in range(4)])
    evaluated(bench, file)
    again = ("method.gain=0.9", "method.label=bright", "overwrite=always", "report=false")
    run(tmp_path / "results", *again)
    rows = results.read(tmp_path / "results")
    assert set(rows.loc[rows["metric"] == "preference", "method"]) == {"dark"}
    done = bench("study", "results", "--votes", file)
    assert done.returncode == 2
    assert "4 votes " in done.stderr


def test_a_vote_counts_once(bench: Bench, study: dict[str, Any], tmp_path: Path):
    """An observer saves after ten votes, and again after twelve."""
    early, late = ([vote(study, n) for n in range(count)] for count in (10, 12))
    files = [write(tmp_path / name, study, votes) for name, votes in (("a.json", early), ("b.json", late))]
    told, said = evaluated(bench, *files)
    assert told["votes"] == 12
    assert "10 votes" in said
    contradicting = write(tmp_path / "c.json", study, [vote(study, 0, choice="right")])
    told, said = evaluated(bench, files[0], contradicting)
    assert told["votes"] == 10
    assert "contradict" in said
    told, _ = evaluated(bench, files[0], write(tmp_path / "d.json", study, early, observer="o2"))
    assert (told["votes"], told["observers"]) == (20, 2)


def test_what_is_no_vote_is_named_and_the_others_count(bench: Bench, study: dict[str, Any], tmp_path: Path):
    other_view = {"right": study["by"]["v1.png", "dark"]}
    bad = [
        vote(study, 1, left="nothing"), vote(study, 2, left=["x"]), vote(study, 3, **other_view),
        vote(study, 4, choice="both"), {**vote(study, 5), "n": "5"}, "text", None, vote(study, 6, choice=["left"]),
    ]  # fmt: skip
    told, said = evaluated(bench, write(tmp_path / "a.json", study, [vote(study, 0), *bad]))
    assert told["votes"] == 1
    assert sum(int(line.split(": ")[1].split()[0]) for line in said.splitlines()) == len(bad)


@pytest.mark.parametrize(
    "text",
    ["", "no JSON", "[]", "{}", '{"format": "sucre_bench votes", "version": 1}', "[" * 100_000, '{"format": 1}'],
)
def test_a_file_that_holds_no_votes_is_named(bench: Bench, study: dict[str, Any], tmp_path: Path, text: str):
    (tmp_path / "bad.json").write_text(text)
    good = write(tmp_path / "a.json", study, [vote(study, 0)])
    told, said = evaluated(bench, good, "bad.json")
    assert told["votes"] == 1
    assert said.startswith("bad.json: ")
    done = bench("study", "results", "--votes", "bad.json")
    assert done.returncode == 2
    assert "bad.json" in done.stderr


def test_votes_of_another_study_are_named(bench: Bench, study: dict[str, Any], tmp_path: Path):
    done = bench(
        "study", "results", "--votes", write(tmp_path / "a.json", {**study, "study": "0000abcd"}, [vote(study, 0)])
    )
    assert done.returncode == 2
    assert "0000abcd" in done.stderr
