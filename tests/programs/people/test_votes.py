"""Files of votes from strangers: what is no vote does not count, and is named."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from support.command_line import registry, run, succeeded
from support.places import TOYS

from sucre_bench import plugins, results

Bench = Callable[..., Any]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of two methods on three views."""
    place = tmp_path_factory.mktemp("made")
    with plugins.using(registry(TOYS)):
        for label, gain in (("bright", 1.0), ("dark", 0.4)):
            run(place / "results", f"method.gain={gain}", f"method.label={label}")
    succeeded(place, "study", "results", "--methods", "bright,dark", "--out", "study.html")
    return place


@pytest.fixture
def study(made: Path, tmp_path: Path, toys: str) -> dict[str, Any]:
    """The study's key, with the pictures by view and method; the results lie in the test's folder."""
    shutil.copytree(made / "results", tmp_path / "results")
    (key,) = (tmp_path / "results" / "people").glob("*.json")
    told = json.loads(key.read_text())
    return {
        **told,
        "by": {(one["view"], one["method"]): name for name, one in told["pictures"].items()},
    }


def vote(
    study: dict[str, Any], n: int, view: str = "v0.png", choice: str = "left", **other: Any
) -> dict[str, Any]:
    sides = {"left": study["by"][view, "bright"], "right": study["by"][view, "dark"]}
    return {"n": n, **sides, "choice": choice, "seconds": 1.5, **other}


def write(path: Path, study: dict[str, Any], votes: Any, **other: Any) -> str:
    told = {
        "format": "sucre_bench votes",
        "version": 1,
        "study": study["study"],
        "observer": "o1",
        "votes": votes,
    }
    path.write_text(json.dumps({**told, **other}))
    return str(path)


def files_of_six(
    tmp_path: Path, study: dict[str, Any], n: int = 6, against: int = 1
) -> list[str]:
    """Files of six observers with so many votes each for the bright pictures, some of them against."""
    votes = [
        vote(study, k, f"v{k % 3}.png", "right" if k < against else "left") for k in range(n)
    ]
    return [write(tmp_path / f"{name}.json", study, votes, observer=name) for name in "abcdef"]


def evaluated(bench: Bench, *files: str) -> tuple[dict[str, Any], str]:
    done = bench("study", "results", "--votes", *files, "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


def test_votes_become_a_metric_that_a_run_keeps(
    bench: Bench, study: dict[str, Any], tmp_path: Path
):
    told, _ = evaluated(bench, *files_of_six(tmp_path, study))
    assert told["missing"] == ""
    run(tmp_path / "results", "method.gain=1.0", "method.label=bright")
    rows = results.read(tmp_path / "results")
    own = rows[rows["metric"] == "preference"]
    assert (len(own), set(own["view"])) == (6, {"v0.png", "v1.png", "v2.png"})
    means = own.groupby("method")["value"].mean()
    assert means["bright"] == pytest.approx(-means["dark"])
    assert means["bright"] > 0.5
    assert "preference" in bench("compare", "results", "--metric", "preference").stdout


def test_rows_of_pictures_that_are_made_anew_go(
    bench: Bench, study: dict[str, Any], tmp_path: Path
):
    files = files_of_six(tmp_path, study)
    evaluated(bench, *files)
    again = ("method.gain=0.9", "method.label=bright", "overwrite=always")
    run(tmp_path / "results", *again)
    rows = results.read(tmp_path / "results")
    assert set(rows.loc[rows["metric"] == "preference", "method"]) == {"dark"}
    done = bench("study", "results", "--votes", *files)
    assert done.returncode == 2
    assert done.stderr.count("6 votes ") == 6


def test_few_votes_make_no_lead_and_no_interval(
    bench: Bench, study: dict[str, Any], tmp_path: Path
):
    missing, files = "30 votes of 6 people are needed", files_of_six(tmp_path, study, 1, 0)
    told, _ = evaluated(bench, *files)
    assert missing in told["missing"]
    assert {(one["low"], one["high"]) for one in told["preference"]} == {(None, None)}
    assert all(metric["low"] is None for metric in told["metrics"])
    said = bench("study", "results", "--votes", *files).stdout
    assert missing in said
    assert not {"leads", "ahead", "[", " to "} & set(said.split())
    rows = results.read(tmp_path / "results")
    assert "preference" not in set(rows["metric"])


def test_a_vote_counts_once(bench: Bench, study: dict[str, Any], tmp_path: Path):
    """An observer saves after ten votes, and again after twelve."""
    early, late = ([vote(study, n) for n in range(count)] for count in (10, 12))
    first = write(tmp_path / "a.json", study, early)
    told, said = evaluated(bench, first, write(tmp_path / "b.json", study, late))
    assert told["votes"] == 12
    assert "10 votes" in said
    other = write(tmp_path / "d.json", study, early, observer="o2")
    told, _ = evaluated(bench, first, other)
    assert (told["votes"], told["observers"]) == (20, 2)


def test_a_file_with_a_wrong_vote_does_not_count(
    bench: Bench, study: dict[str, Any], tmp_path: Path
):
    other_view = {"right": study["by"]["v1.png", "dark"]}
    bad = [
        vote(study, 1, left="nothing"), vote(study, 2, left=["x"]), vote(study, 3, **other_view),
        vote(study, 4, choice="both"), {**vote(study, 5), "n": "5"}, "text", None, vote(study, 6, choice=["left"]),
    ]  # fmt: skip
    files = [
        write(tmp_path / f"bad{k}.json", study, [vote(study, 0), one], observer=f"x{k}")
        for k, one in enumerate(bad)
    ]
    told, said = evaluated(bench, write(tmp_path / "a.json", study, [vote(study, 0)]), *files)
    assert told["votes"] == 1
    assert [line.partition(": ")[0] for line in said.splitlines()] == files


def test_files_that_hold_no_votes_are_named(
    bench: Bench, study: dict[str, Any], tmp_path: Path
):
    texts = [
        "",
        "no JSON",
        "[]",
        "{}",
        '{"format": "sucre_bench votes", "version": 1}',
        "[" * 100_000,
        '{"format": 1}',
    ]
    texts.append(
        Path(write(tmp_path / "b.json", study, [vote(study, 1)], observer="\udc80")).read_text()
    )
    bad = [f"bad{k}.json" for k in range(len(texts))]
    for name, text in zip(bad, texts, strict=True):
        (tmp_path / name).write_text(text)
    told, said = evaluated(bench, write(tmp_path / "a.json", study, [vote(study, 0)]), *bad)
    assert told["votes"] == 1
    assert [line.partition(": ")[0] for line in said.splitlines()] == bad
    done = bench("study", "results", "--votes", *bad)
    assert done.returncode == 2
    assert all(name in done.stderr for name in bad)


def test_votes_of_another_study_are_named(bench: Bench, study: dict[str, Any], tmp_path: Path):
    file = write(tmp_path / "a.json", {**study, "study": "0000abcd"}, [vote(study, 0)])
    done = bench("study", "results", "--votes", file)
    assert done.returncode == 2
    assert "0000abcd" in done.stderr
