"""Several configurations in one run: by words, by a line-up file, and from results back to the file."""

import os
import re
import sys
from pathlib import Path
from typing import Any

import pytest
from support.command_line import run
from support.messages import names, refused
from support.places import TOYS

from sucre_bench import InputError, results
from sucre_bench.engine.run import run as run_jobs
from sucre_bench.jobs import compose_jobs
from sucre_bench.jobs.catalogue import moved_paths
from sucre_bench.jobs.job import Job
from sucre_bench.jobs.lineup import line_up_in, line_up_of, record_line_up

pytestmark = pytest.mark.usefixtures("toys")


def jobs(*words: str) -> tuple[Job, ...]:
    return compose_jobs.jobs(["dataset=toy", "metrics=[psnr]", *words], True).jobs


def from_file(path: Path, text: str, *words: str) -> tuple[Job, ...]:
    path.write_text(text)
    return compose_jobs.jobs([str(path), *words], False).jobs


def labelled(made: tuple[Job, ...], option: str) -> dict[str, Any]:
    return {job.method.label: job.method.options.get(option) for job in made}


def test_an_option_by_a_methods_name_is_for_that_method_alone():
    made = labelled(jobs("method=gain,gain2,halved", "gain2.gain=3"), "gain")
    assert made == {"gain": 1.0, "gain2": 3.0, "halved": None}


def test_an_option_by_name_with_several_values_sweeps_that_method_alone():
    made = labelled(jobs("method=gain,gain2", "gain2.gain=2,4"), "gain")
    assert made == {"gain": 1.0, "gain2,gain=2.0": 2.0, "gain2,gain=4.0": 4.0}


def test_an_option_for_methods_in_general_is_for_those_that_have_it():
    made = labelled(jobs("method=gain,halved,gain2", "method.gain=2,4"), "gain")
    assert made == {"gain,gain=2.0": 2, "gain,gain=4.0": 4, "halved": None, "gain2,gain=2.0": 2, "gain2,gain=4.0": 4}


def test_an_option_of_a_dataset_by_its_name():
    made = compose_jobs.jobs(["dataset=toy,two_scenes", "method=gain", "metrics=[psnr]", "toy.views=2"], True).jobs
    assert [(job.dataset.label, job.dataset.options.get("views")) for job in made] == [("toy", 2), ("two_scenes", None)]


def test_options_of_one_method_leave_the_stored_results_of_others_alone(tmp_path: Path):
    run(tmp_path, "method=halved")
    outcome = run(tmp_path, "method=gain,halved", "gain.gain=2", multirun=True)
    assert (outcome.ok, outcome.cached) == (6, 3)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["method=gain,halved", "method.gian=2"], {"method.gian", "'gain'"}),
        (["method=gain,halved", "gain.gian=2"], {"gain.gian", "'gain'"}),
        (["method=gain,halved", "gain2.gain=2"], {"gain2", "-m", "method=gain,halved,gain2"}),
        (["method=gain,gain2", "gain=2"], {"gain.gain=2", "gain2.gain=2"}),
        (["method=gain", "gain=2"], {"method.gain=2"}),
        (["method=gain", "redness.factor=2"], {"metrics.redness.factor=2"}),
        (["method=gain,gain2", "gain2.gain=much"], {"gain2.gain", "much", "number"}),
        (["method=gain", "metrics=psnr,redness"], {"metrics=[psnr,redness]"}),
        (["method=gain", "seed=abc"], {"seed", "abc", "whole"}),
        (["method=sucre_plus", "method.robust=1"], {"method.robust", "1", "true", "false", "auto"}),
        (["method=sucre", "method.lamp=true"], {"method.lamp", "method.light=strobe"}),
        (["method=gain,sucre_exact", "sucre_exact.lr=1"], {"sucre_exact.lr", "method=sucre_paper"}),
        (["dataset=colmap", "dataset.root=x", "method=gain", "every=1.5"], {"every", "1.5", "whole"}),
    ],
)
def test_a_wrong_option_is_blamed_on_its_own_word(words: list[str], named: set[str]):
    with refused(*named):
        jobs(*words)


@pytest.mark.parametrize(
    ("word", "place"),
    [
        ("metrics=[psnr:foo]", "psnr"),
        ("dataset=colmap", "colmap.root"),
        ("dataset=nowhere/", "dataset=./nowhere"),
        ("views=none.txt", "none.txt"),
        ("shard.index=5", "shard"),
        ("halved.display=foo", "halved.display"),
        ("method.display=foo", "method.display"),
        ("out=${nowhere}", "out"),
    ],
)
def test_a_typed_mistake_is_not_blamed_on_the_line_up(tmp_path: Path, word: str, place: str):
    file = tmp_path / "l.yaml"
    file.write_text("datasets: [toy]\nmethods: [gain, halved]\nmetrics: [psnr]")
    with pytest.raises(InputError) as fault:
        compose_jobs.jobs([str(file), word], False)
    assert fault.value.place == place


def test_a_mistake_of_the_line_up_is_not_blamed_on_the_words(tmp_path: Path):
    file = tmp_path / "l.yaml"
    file.write_text("datasets: [toy]\nmethods: [gain, {name: halved, display: foo}]\nmetrics: [psnr]")
    with pytest.raises(InputError) as fault:
        compose_jobs.jobs([str(file), "metrics=[redness]", "every=2", "gain.gain=2"], False)
    assert fault.value.place == str(file)


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        (["demo", "gray_world"], "sucre-bench run dataset=demo method=gray_world"),
        (["demo", "gain", "gain2", "every=4"], "sucre-bench run -m dataset=demo method=gain,gain2 every=4"),
        (["demo", "psnr", "gray_wrld"], "sucre-bench run dataset=demo 'metrics=[psnr]' method=gray_world"),
    ],
)
def test_bare_words_are_answered_with_the_command_that_was_meant(words: list[str], meant: str):
    with pytest.raises(InputError) as fault:
        compose_jobs.jobs(words, False)
    assert str(fault.value).endswith(f"write {meant}")


def test_a_path_with_a_comma_is_answered_with_its_quotes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    (tmp_path / "a,b").mkdir()
    monkeypatch.chdir(tmp_path)
    for is_sweep in (False, True):
        with pytest.raises(InputError, match=r"write \"dataset\.root='a,b'\""):
            compose_jobs.jobs(["dataset=photos", "dataset.root=a,b", "method=gain"], is_sweep)


def test_variants_are_chosen_with_the_metrics():
    (one,) = compose_jobs.jobs(["dataset=toy", "method=gain", "metrics=[redness:all,psnr:raw,psnr]"], False).jobs
    chosen = {metric.plugin.name: metric.variants for metric in one.metrics}
    assert chosen == {"redness": ("plain", "double"), "psnr": ("raw", "masked")}
    (one,) = compose_jobs.jobs(["dataset=toy", "method=gain", "metrics=[default,uciqe:matlab]"], False).jobs
    assert {m.plugin.name: m.variants for m in one.metrics}["uciqe"] == ("matlab",)


LINE_UP = """# What it is for.
datasets:
  - toy
  - {name: toy, label: short, views: 2, degrade: {noise: 0.1}}
methods:
  - halved
  - gain
  - {name: gain, gain: 2}
  - {name: gain, label: logged, log: a.txt}
metrics: [redness:all]
sweep:
  gain2.gain: [3]
  degrade.bits: [4, null]
baseline: halved
every: 2
"""


def test_a_line_up_is_every_dataset_with_every_configuration(tmp_path: Path):
    made = from_file(tmp_path / "l.yaml", LINE_UP.replace("gain2.gain: [3]", "logged.mode: [fancy]"))
    assert {(job.dataset.label, job.method.label) for job in made} == {
        (dataset, method)
        for dataset in ("toy,bits=4", "toy", "short,noise=0.1,bits=4", "short,noise=0.1")
        for method in ("halved", "gain", "gain,gain=2.0", "logged")
    }
    assert labelled(made, "mode") == {"halved": None, "gain": "plain", "gain,gain=2.0": "plain", "logged": "fancy"}
    assert {(job.every, job.baseline, job.metrics[0].variants) for job in made} == {(2, "halved", ("plain", "double"))}


def test_paths_in_a_line_up_are_relative_to_it_but_for_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "paper").mkdir()
    text = "datasets: [toy]\nmethods: [{name: gain, log: ../logs/a}]\nmetrics: [psnr]\nout: here\n"
    (one,) = from_file(Path("paper/l.yaml"), text)
    assert (one.method.options["log"], one.out) == (Path("logs/a"), Path("here"))
    text = "methods: [{name: sucre, water: water.json}, {name: sucre, water: truth}, {name: sucre, water: seathru}]"
    made = from_file(Path("paper/l.yaml"), text)
    assert [job.method.options["water"] for job in made] == ["paper/water.json", "truth", "seathru"]


def test_the_file_of_an_environment_is_relative_to_the_line_up_and_stays_where_that_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bin").mkdir()
    (tmp_path / "bin" / "uv").symlink_to(sys.executable)
    monkeypatch.setenv("PATH", f"{tmp_path / 'bin'}{os.pathsep}{os.environ['PATH']}")
    (tmp_path / "paper").mkdir()
    (tmp_path / "paper" / "req.txt").write_text("numpy\n")
    text = (
        "datasets: [toy]\nmethods: [{name: command, run: 'cp {input} {output}', env: 'uv:req.txt'}]\nmetrics: [psnr]\n"
    )
    (job,) = from_file(Path("paper/l.yaml"), text)
    assert job.method.record["env"].startswith("uv:paper/req.txt@sha256:")
    record_line_up([job])
    (entry,) = line_up_in(job.out / "lineup.yaml").methods
    env = entry.options["env"].removeprefix("uv:").partition("@")[0]
    assert (job.out / env).resolve() == tmp_path / "paper" / "req.txt"
    for env, moved in (("conda:./one", "conda:./seen"), ("conda:one", None), ("docker:a/b@sha256:1", None)):
        assert moved_paths("method", "command", {"env": env}, lambda _: "seen").get("env") == moved


def test_a_sweep_over_a_method_that_words_replace_is_left_out(tmp_path: Path):
    text = LINE_UP.replace("gain2.gain: [3]", "logged.gain: [3, 4]\n  method.mode: [plain, fancy]")
    made = from_file(tmp_path / "l.yaml", text)
    assert {job.method.label for job in made if job.method.label.startswith("logged")} == {
        f"logged,gain={gain},mode={mode}" for gain in ("3.0", "4.0") for mode in ("plain", "fancy")
    }
    assert {job.method.label for job in from_file(tmp_path / "l.yaml", text, "method=halved")} == {"halved"}
    with pytest.raises(InputError, match=r"'logged'.*methods"):
        from_file(tmp_path / "l.yaml", text, "method=halved", "logged.gain=3")


def test_words_prevail_over_a_line_up(tmp_path: Path):
    text = LINE_UP.replace("  gain2.gain: [3]\n", "")
    made = from_file(tmp_path / "l.yaml", text, "every=1", "degrade.bits=8", "metrics=[psnr]", "gain.gain=5")
    assert {job.every for job in made} == {1}
    assert {job.degrade.bits for job in made} == {8}
    assert {metric.plugin.name for job in made for metric in job.metrics} == {"psnr"}
    assert {job.method.options.get("gain") for job in made} == {5.0, None}
    made = from_file(tmp_path / "l.yaml", text, "method=gain2", "dataset=two_scenes")
    assert {(job.dataset.plugin.name, job.method.label) for job in made} == {("two_scenes", "gain2")}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("method: [gain]", {"l.yaml", "method", "'methods'"}),
        ("methods: [gian]", {"l.yaml", "gian", "'gain'"}),
        ("methods: [{name: gain, gian: 2}]", {"l.yaml", "gain.gian", "'gain'"}),
        ("methods: [{name: gain, gain: much}]", {"l.yaml", "gain.gain", "much", "number"}),
        ("methods: [{name: gain, label: a}, {name: halved, label: a}]", {"l.yaml", "2", "label", "'a'"}),
        ("methods: [gain, {name: halved, label: gain}]", {"two", "'toy / gain'"}),
        ("methods: [gain, gain]", {"l.yaml", "2", "label", "'gain'"}),
        ("methods: [gain", {"l.yaml", "YAML"}),
        ("methods: [gain]\nmethods: [halved]", {"l.yaml", "'methods'", "twice"}),
        ("", {"l.yaml", "empty"}),
        ("- datasets", {"l.yaml", "keys"}),
        ("methods: [{name: gain, gain: {a: 1}}]", {"l.yaml", "gain.gain"}),
        ("study: {name: s, metrcs: [psnr]}\nmethods: [gain]", {"l.yaml", "study.metrcs", "'metrics'"}),
        ("datasets: [./nowhere]\nmethods: [gain]", {"l.yaml", "dataset=./nowhere", "folder"}),
        ("metrics: [redness:pink]\nmethods: [gain]", {"l.yaml", "variant", "pink"}),
        ("sweep: {out: [a, b]}\nmethods: [gain]", {"l.yaml", "sweep.out"}),
        ("sweep: {gain.gain: 2}\nmethods: [gain]", {"l.yaml", "sweep.gain.gain", "list"}),
        ("sweep: {'x=1 hydra.mode': [2]}\nmethods: [gain]", {"l.yaml", "hydra.mode"}),
        ("every: 1.5\nmethods: [gain]", {"l.yaml", "every", "1.5", "whole"}),
        ("sweep: {gain.gian: [1, 2]}\nmethods: [gain]", {"l.yaml", "gain.gian", "'gain'"}),
        ("study: table1\nmethods: [gain]", {"l.yaml", "study", "{OPTION"}),
        ("baseline: none_such\nmethods: [gain]", {"baseline", "none_such"}),
        ("plugins: [none.py]\nmethods: [gain]", {"l.yaml", "none.py"}),
    ],
)
def test_what_is_wrong_with_a_line_up_is_one_line_with_its_name(bench, tmp_path: Path, text: str, named: set[str]):
    (tmp_path / "l.yaml").write_text(text if "datasets" in text else f"{text}\ndatasets: [toy]\n" if text else "")
    done = bench("run", "--plugin", str(TOYS), "l.yaml", "tracking.uri=off", "report=false")
    assert done.returncode == 2
    assert named <= names(done.stderr)
    assert len(done.errors) == 1


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (["nowhere.yaml"], {"nowhere.yaml", "file"}),
        (["a.yaml", "b.yaml"], {"b.yaml", "second"}),
        (["a.yaml", "experiment=demo"], {"experiment=demo", "one"}),
        (["folder.yaml"], {"folder.yaml", "folder"}),
    ],
)
def test_a_line_up_that_cannot_be_had(bench, tmp_path: Path, words: list[str], named: set[str]):
    (tmp_path / "folder.yaml").mkdir()
    done = bench("run", *words)
    assert (done.returncode, len(done.errors)) == (2, 1)
    assert named <= names(done.stderr)


def test_values_of_a_line_up_are_not_interpolated(tmp_path: Path):
    (one,) = from_file(tmp_path / "l.yaml", "datasets: [{name: toy, tag: '${oc.env:HOME}'}]\nmethods: [gain]")
    assert one.dataset.options["tag"] == "${oc.env:HOME}"


def identity(job: Job) -> tuple[Any, ...]:
    return (
        (job.dataset.label, results.fingerprint(job.dataset.record)),
        (job.method.label, results.fingerprint(job.method.record)),
        job.degrade,
        job.replicate,
        frozenset((m.plugin.name, m.variants, results.fingerprint(m.record)) for m in job.metrics),
        (job.views, job.every, job.first, job.seed, job.save, job.baseline, job.study),
    )


def test_running_the_line_up_of_a_results_folder_gives_the_same_jobs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    text = LINE_UP.replace("gain2.gain: [3]", "replicate: [0, 1]").replace("every: 2", "first: 2\nseed: 3")
    text = text.replace("  - gain\n", "").replace("bits: [4, null]", "bits: [4]")
    Path("l.yaml").write_text(f"{text}study: {{name: s, metrics: [redness], figures: [scores]}}\n")
    words = ["tracking.uri=off", "report=false", "workers=0", "metrics.redness.factor=2"]
    outcome = run_jobs(["l.yaml", *words, "out=results", f"plugins=[{TOYS}]"], False)
    assert not outcome.failed
    first = compose_jobs.jobs(["l.yaml", *words], False).jobs
    line_up, notes = line_up_of(Path("results"), Path("published"))
    assert not notes
    Path("published").mkdir()
    again = from_file(Path("published/l.yaml"), line_up.as_yaml("A comment."))
    assert set(map(identity, again)) == set(map(identity, first))
    assert len(again) == len(first) == 12


def test_the_line_up_of_a_folder_has_what_older_commands_made_in_it(tmp_path: Path):
    run(tmp_path / "results", "method.gain=2", "method.label=double")
    run(tmp_path / "results", "method=gain,halved", "metrics=[psnr:raw]", multirun=True)
    line_up, _ = line_up_of(tmp_path / "results", tmp_path)
    made = from_file(tmp_path / "l.yaml", line_up.as_yaml())
    assert labelled(made, "gain") == {"double": 2.0, "gain": 1.0, "halved": None}
    assert [job.method.label for job in made] == ["double", "gain", "halved"]
    assert {m.plugin.name: m.variants for m in made[0].metrics} == {"psnr": ("raw",), "redness": ("plain",)}


def test_the_line_up_of_a_folder_says_where_it_asks_for_more(tmp_path: Path):
    run(tmp_path / "results", "dataset.views=2", "dataset.label=two")
    run(tmp_path / "results", "method=halved")
    _, notes = line_up_of(tmp_path / "results", tmp_path)
    assert any({"gain", "toy"} <= set(re.findall(r"\w+", note)) for note in notes)


def test_the_line_up_of_a_sweep_keeps_the_labels_of_a_dataset_with_options(tmp_path: Path):
    run(tmp_path / "results", "dataset.views=2", "degrade.noise=0,0.1", multirun=True)
    made = from_file(tmp_path / "l.yaml", line_up_of(tmp_path / "results", tmp_path)[0].as_yaml())
    assert [job.dataset.label for job in made] == ["toy", "toy,noise=0.1"]


def test_paths_in_the_line_up_of_a_folder_stay_when_another_command_adds_to_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    for words in (["method.log=logs/a"], ["method=halved"]):
        run(Path("results"), *words)
    (logged, _) = line_up_of(Path("results"), Path("paper"))[0].methods
    assert (logged.name, logged.options["log"]) == ("gain", "../logs/a")


def test_other_options_for_a_label_of_a_line_up_are_answered_with_a_word_that_works(bench, tmp_path: Path):
    (tmp_path / "l.yaml").write_text("datasets: [toy]\nmethods: [gain, {name: halved, label: half}]\nmetrics: [psnr]")
    words = ("run", "--plugin", str(TOYS), "l.yaml", "out=results", "tracking.uri=off", "report=false", "workers=0")
    assert bench(*words).returncode == 0
    refused = bench(*words, "half.display=white-99")
    assert (refused.returncode, "half.label=..." in refused.stderr) == (2, True)
    assert bench(*words, "half.display=white-99", "half.label=shown").returncode == 0


@pytest.mark.parametrize("key", ["onnx.model", "method.model"])
def test_a_method_that_lacks_a_file_names_the_option_as_the_command_takes_it(bench, key: str):
    done = bench("run", "-m", "dataset=demo", "method=underwater,onnx", f"{key}=none.onnx")
    assert (done.returncode, "file in onnx.model" in done.stderr) == (2, True)


def test_a_water_that_a_folder_names_is_found_by_the_next_run_and_from_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.chdir(tmp_path)
    Path("waters").mkdir()
    Path("waters/sea.json").write_text('{"B": [0.1, 0.2, 0.3], "beta": [0.3, 0.2, 0.1], "gamma": [0.3, 0.2, 0.1]}')
    for method in ("gain", "halved"):
        run(Path("results"), f"method={method}", "first=1", "degrade.add_water=waters/sea.json")
    line_up, _ = line_up_of(Path("results"), Path("waters"))
    assert [entry.options["degrade"]["add_water"] for entry in line_up.datasets] == ["sea.json"]
    assert [entry.name for entry in line_up.methods] == ["gain", "halved"]


def test_the_command_writes_a_file_that_runs(bench, tmp_path: Path):
    run(tmp_path / "results", "method=gain,halved", multirun=True)
    done = bench("lineup", "results", "--plugin", str(TOYS))
    assert (done.returncode, done.errors) == (0, [])
    words = ("out=results", "tracking.uri=off", "report=false", "workers=0")
    again = bench("run", "--plugin", str(TOYS), "results/lineup.yaml", *words)
    assert "6 ok (6 cached)" in again.stdout
    assert bench("lineup", "results", "--out", "-", "--plugin", str(TOYS)).stdout.startswith("#")
