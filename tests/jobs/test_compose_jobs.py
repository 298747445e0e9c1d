"""Jobs from words: what is composed, what is refused, how a value is quoted, and what a folder is recognised as."""

from __future__ import annotations

import itertools
import shlex
from pathlib import Path

import pytest
import yaml
from hydra.core.override_parser.overrides_parser import OverridesParser
from omegaconf import OmegaConf
from support.colmap_folder import picture, write_dive, write_image
from support.messages import names, refused
from support.places import TOYS

from sucre_bench import InputError, plugins
from sucre_bench.jobs import compose_jobs
from sucre_bench.jobs.catalogue import recognised
from sucre_bench.jobs.experiment_file import EXPERIMENT, record_experiment
from sucre_bench.jobs.word_syntax import quoted, shell, value_of
from sucre_bench.machine import progress
from sucre_bench.plugins.registry import using

pytestmark = pytest.mark.usefixtures("toys")


def jobs(*overrides: str, multirun: bool = False) -> compose_jobs.Command:
    return compose_jobs.jobs(
        ["dataset=toy", "method=gain", "metrics=[psnr]", *overrides], multirun
    )


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("dataset=tou", "'toy'"),
        ("metrics=[psnrr]", "'psnr'"),
        ("experiment=dem", "'demo'"),
        ("method.gian=2", "'gain'"),
        ("dataset.view=2", "'views'"),
        ("ovewrite=never", "'overwrite'"),
        ("tracking.url=off", "'uri'"),
        ("method.gain=much", "number"),
        ("dataset.views=2.5", "whole"),
        ("method.mode=fanci", "'fancy'"),
        ("method.display=strech", "stretch-LOW-HIGH"),
        ("metrics.psnr.variants=[mask]", "'masked'"),
        ("overwrite=alway", "'always'"),
        ("save=all", "'full'"),
        ("every=0", "[1, inf)"),
        ("views=none.txt", "none.txt"),
        ("+speed=3", "speed"),
        ("+method.speed=3", "gain"),
        ("method=gain,faulty", "-m"),
        ("method=null", "method=a,b"),
        ("gain.raw=true", "gain.raw"),
        ("hydra.searchpath=mine", "hydra.searchpath"),
        ("dataset=[toy,demo]", "dataset=a,b"),
        ("out=${nowhere}", "nowhere"),
        ("hydra.launcher.n_jbs=2", "hydra.launcher.n_jbs"),
        ("hydra.mode=MULTI", "MULTIRUN"),
        ("hydra.launcher.partition=cpu,gpu", "hydra.launcher.partition=cpu,gpu"),
        ("hydra/launcher=jobli", "'joblib'"),
        ("dataset.label=ünï", "'ünï'"),
        ("hydra.job.chdri=true", "'chdir'"),
        ("dataset=colmap", "dataset.root=FOLDER"),
        ("method.gain", "key=value"),
        ("shard=3", "index"),
        ("study=3", "metrics"),
        ("metrics.psnr=3", "group"),
        ("metrics.psnr.variants=3", "list"),
        ("views={a: 1}", "list"),
        ("method='gray_world", "method='gray_world"),
    ],
)
def test_a_wrong_override_is_one_clear_line(override: str, named: str):
    with refused(named):
        jobs(override)


def test_words_of_hydra_itself_sweep_and_its_folders_have_no_effect():
    params = "+hydra.sweeper.params.method.gain='1,2'"
    swept = jobs("hydra.mode=MULTIRUN", params, "hydra.run.dir=x", "hydra.verbose=true")
    assert [job.method.make().gain for job in swept.jobs] == [1, 2]


TYPED = ["2026_11_22", "3.10", "1e3", "1_000", "+1", "007", "true", "nan", "plain-1"]


@pytest.mark.parametrize("typed", TYPED)
def test_names_and_paths_stay_as_typed(typed: str):
    places = ("out", "method.label", "dataset.label", "method.log")
    (one,) = jobs(f"views=[{typed},b.png]", *(f"{place}={typed}" for place in places)).jobs
    assert (str(one.out), one.method.label, one.dataset.label) == (typed, typed, typed)
    assert (one.method.options["log"], one.views) == (Path(typed), (typed, "b.png"))


def test_swept_paths_stay_as_typed():
    swept = jobs(f"method.log={','.join(TYPED)}", multirun=True)
    assert [job.method.label for job in swept.jobs] == [f"gain,log={typed}" for typed in TYPED]


@pytest.mark.parametrize(("typed", "number"), [("010", 10), ("1_0", 10), ("' 3'", 3)])
def test_a_number_is_decimal(typed: str, number: int):
    assert jobs(f"every={typed}").jobs[0].every == number


@pytest.mark.parametrize("typed", ["0x10", "0b11", "1:30", "yes", "''"])
def test_what_is_a_number_only_in_yaml_is_refused(typed: str):
    with refused("every", typed.strip("'")):
        jobs(f"every={typed}")


def test_the_label_is_the_methods_name_and_what_the_sweep_changed():
    def label(*overrides: str) -> str:
        return jobs(*overrides).jobs[0].method.label

    assert label() == "gain"
    assert label("method.gain=0.5", "method.log=/tmp/x") == "gain"
    assert label("method.gain=2", "method.label=mine") == "mine"
    words = ("method.gain=0.5,1", "method.log=/tmp/x,/elsewhere/y", "method.mode=fancy")
    swept = jobs(*words, multirun=True)
    assert [j.method.label for j in swept.jobs] == [
        "gain,gain=0.5,log=x", "gain,gain=0.5,log=y", "gain,gain=1.0,log=x", "gain,gain=1.0,log=y",
    ]  # fmt: skip


def test_a_label_of_ones_own_says_which_swept_value_it_has():
    sweep = jobs("method.gain=1,2", "method.label=my own", multirun=True)
    assert [job.method.label for job in sweep.jobs] == ["my own,gain=1.0", "my own,gain=2.0"]
    words = ("method.gain=1,2", "method.mode=plain,fancy", "method.label='gain {gain}'")
    own = jobs(*words, multirun=True)
    assert [job.method.label for job in own.jobs] == [
        f"gain {n}.0,mode={m}" for n in (1, 2) for m in ("plain", "fancy")
    ]
    with refused("gian", "gain"):
        jobs("method.label='gain {gian}'")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["method=gain,halved", "method.label=mine"], r"'toy / mine'; .*label="),
        (["method.gain=1,2", "method.label='a b','a_b'"], "label="),
        (["views=[v0.png],[v1.png]"], "'toy / gain'"),
        (["metrics=[psnr],[ssim]"], "'toy / gain'"),
    ],
)
def test_two_jobs_that_would_write_to_one_place_are_refused(words: list[str], fault: str):
    with pytest.raises(InputError, match=fault):
        jobs(*words, multirun=True)


def test_every_job_of_a_sweep_is_checked_before_any_runs():
    with pytest.raises(InputError, match=r"'fauty'.*'faulty'"):
        jobs("method=gain,fauty", multirun=True)
    for values in ("interval(0,1)", "range(0)"):
        with pytest.raises(InputError, match="range\\("):
            jobs(f"method.gain={values}", multirun=True)


def test_glob_means_all_that_need_nothing_and_names_the_others(
    capsys: pytest.CaptureFixture[str],
):
    with progress.live():
        sweep = jobs("method=glob([gray_world,ul*,onnx,command,f*],exclude=f*)", multirun=True)
    assert {job.method.label for job in sweep.jobs} == {"gray_world", "ulap"}
    said = capsys.readouterr().err
    assert "onnx.model" in said
    assert "command.run" in said
    assert "funie_gan" not in said


def test_plugins_of_a_word_and_of_an_experiment_can_be_chosen(
    tmp_path: Path,
):
    experiment = tmp_path / "mine.yaml"
    experiment.write_text(f"plugins: [{TOYS}]\ndefaults: [{{override /method: halved}}]\n")
    for words in ([f"plugins=[{TOYS}]", "method=glob(halve*)"], [str(experiment)]):
        with using(plugins.Registry()):
            (job,) = compose_jobs.jobs(["dataset=demo", *words], multirun=True).jobs
        assert job.method.label == "halved"


def test_views_come_as_names_or_as_a_list_in_a_file(tmp_path: Path):
    assert jobs("views=[v0.png,v2.png]").jobs[0].views == ("v0.png", "v2.png")
    assert jobs("views=v1.png").jobs[0].views == ("v1.png",)
    assert jobs("first=None").jobs[0].first is jobs("first=null").jobs[0].first is None
    with pytest.raises(InputError) as fault:
        jobs("views=[v0.png,dive ü (1).png]")
    (word,) = shlex.split(fault.value.remedy.removeprefix("write "))
    assert jobs(word).jobs[0].views == ("v0.png", "dive ü (1).png")
    listed = tmp_path / "views.txt"
    listed.write_text("v2.png\n\nv0.png\n")
    (tmp_path / "binary.txt").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match=r"binary\.txt: "):
        jobs(f"views={tmp_path / 'binary.txt'}")
    assert jobs(f"views={listed}").jobs[0].views == ("v2.png", "v0.png")


def test_the_seed_reaches_whatever_has_one_and_swept_seeds_have_labels_of_their_own():
    (job,) = compose_jobs.jobs(["dataset=demo", "method=gain", "seed=7"], multirun=False).jobs
    assert job.dataset.options["seed"] == 7
    assert job.dataset.label == "demo"
    replicates = compose_jobs.jobs(["dataset=demo", "method=gain", "seed=0,1"], multirun=True)
    assert [j.dataset.label for j in replicates.jobs] == ["demo,seed=0", "demo,seed=1"]


def test_a_datasets_option_without_a_dataset_is_refused():
    with pytest.raises(InputError, match=r"dataset=NAME.*dataset=colmap"):
        compose_jobs.jobs(["dataset.root=pool", "method=gain"], multirun=False)


def test_the_experiment_of_a_folder_repeats_its_jobs_with_all_settings(tmp_path: Path):
    settings = {"every": 2, "first": 1, "seed": 3, "bits": 16}
    settings |= {"save": "full", "colours": "stored"}
    words = [f"{name}={value}" for name, value in settings.items()]
    swept = ("method.gain=1,2", "dataset.views=2", "degrade.noise=0.1", "views=[v0.png]")
    made = jobs(*words, *swept, f"out={tmp_path}", multirun=True)
    record_experiment(made.jobs)
    again = compose_jobs.jobs([str(tmp_path / EXPERIMENT)], multirun=False)
    same = ("method", "dataset", "degrade", "views", *settings)
    for one, other in zip(made.jobs, again.jobs, strict=True):
        assert [getattr(other, name) for name in same] == [getattr(one, name) for name in same]
        assert {name: getattr(other, name) for name in settings} == settings


LETTERS = "\\'$ {}a1."
TEXTS = ["true", "Null", "nan", "inf", "5", ".5", ".5e-3", "1e-3"]
TEXTS += ["C:\\dive\\", "${out}", "a,b", "~/dive", "ünï", ""]


def test_any_text_is_read_back_as_the_same_text():
    parser = OverridesParser.create()
    short = (
        "".join(letters)
        for length in (1, 2, 3)
        for letters in itertools.product(LETTERS, repeat=length)
    )
    for text in [*TEXTS, *short]:
        read = parser.parse_override(f"key={quoted(text)}").value()
        assert isinstance(read, str), text
        assert OmegaConf.create({"key": str(read), "out": "other"}).key == text


@pytest.mark.parametrize(
    "value", [None, True, 5, 0.25, "null", ["a", "true", 1], {"a_b": [1, None]}]
)
def test_any_value_of_an_option_is_read_back(value: object):
    read = OverridesParser.create().parse_override(f"key={value_of(value)}").value()
    assert OmegaConf.to_container(OmegaConf.create({"key": read})) == {"key": value}


@pytest.mark.parametrize(
    "words",
    [
        ["run", "views=['34.png']"],
        ["views=['a b.png']", "out=my results"],
        ["views=['$HOME.png']", "views=['`ls`']", "views=['a\\b']", "views=['a\"b!']"],
        ["", "'", '"', "method=sucre"],
    ],
)
def test_a_shell_reads_the_words_back(words: list[str]):
    assert shlex.split(shell(words)) == words


def dataset_of(*words: str) -> tuple[str, str]:
    (job,) = compose_jobs.jobs([*words, "method=gray_world"], False).jobs
    return job.dataset.plugin.name, str(job.dataset.options["root"])


def test_a_folder_is_recognised_by_its_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)
    write_dive(tmp_path / "dive", ("a.png",))
    write_image(tmp_path / "photos" / "a.JPG", picture(1))
    for name, sign in {
        "metashape": "reef.psx",
        "nerfstudio": "transforms.json",
        "openmvs": "depth0000.dmap",
        "uieb": "raw-890/1_img_.png",
        "squid": "Katzaa/image_set_01/LFT.tif",
        "varos": "vehicle0/cam0/camM0.yaml",
        "flsea": "canyons/flatiron/flatiron/seaErra/1.tiff",
    }.items():
        (tmp_path / name / sign).parent.mkdir(parents=True)
        (tmp_path / name / sign).touch()
        assert recognised(Path(name)) == name
    assert recognised(Path("photos")) == "photos"
    assert dataset_of("dataset=./dive") == ("colmap", "dive")
    assert dataset_of(f"dataset={tmp_path / 'dive'}", "colmap.image_scale=0.5") == (
        "colmap",
        str(tmp_path / "dive"),
    )


def test_a_scene_with_poses_is_preferred_to_the_photographs_in_its_folder(tmp_path: Path):
    dive = write_dive(tmp_path / "dive", ("a.png",))
    write_image(dive / "sheet.png", picture(1))
    assert dataset_of(f"dataset={dive}")[0] == "colmap"


def test_two_folders_of_one_dataset_are_told_apart(tmp_path: Path):
    for name in ("a", "b"):
        write_dive(tmp_path / name, ("a.png",))
    sweep = compose_jobs.jobs([f"dataset={tmp_path}/a,{tmp_path}/b", "method=gray_world"], True)
    assert [job.dataset.label for job in sweep.jobs] == ["colmap,root=a", "colmap,root=b"]


def test_a_folder_that_fits_several_datasets_is_the_users_choice(tmp_path: Path):
    dive = write_dive(tmp_path / "dive", ("a.png",))
    (dive / "depth0000.dmap").touch()
    with pytest.raises(InputError, match=r"dataset=colmap.*dataset=openmvs"):
        dataset_of(f"dataset={dive}")


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("dataset=./empty", "sparse/cameras.*"),
        ("dataset=./above", "sparse/cameras.*"),
        ("dataset=./nowhere", "folder"),
        ("dataset=./file", "file"),
        ("dataset=empty", "dataset=./empty"),
    ],
)
def test_a_folder_that_fits_nothing_is_one_line(bench, tmp_path: Path, word: str, named: str):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    write_image(tmp_path / "above" / "photos" / "a.png", picture(1))
    for done in (
        bench("run", word, "method=gray_world"),
        bench("describe", word.partition("=")[2]),
    ):
        assert (done.returncode, len(done.errors)) == (2, 1)
        assert named in names(done.stderr)


def test_a_folder_with_the_name_of_a_dataset_is_given_as_a_path(bench, tmp_path: Path):
    """`photos` is both."""
    write_image(tmp_path / "photos" / "a.png", picture(1))
    assert "dataset.root" in bench("run", "dataset=photos", "method=gray_world").stderr
    assert bench("run", "dataset=./photos", "method=gray_world", "--cfg").returncode == 0


def test_a_primary_config_of_the_user_begins_with_ours(bench, tmp_path: Path):
    """As Hydra's users write it; with each form of --cfg that Hydra's own programs take."""
    for name, text in {
        "mine": "defaults: [config, {override method: gray_world}, _self_]\nevery: 8",
        "empty": "",
        "cut": "a: [",
        "unknown": "defaults: [config, _self_]\nevry: 8",
    }.items():
        (tmp_path / f"{name}.yaml").write_text(text)
    words = ("run", "-cd", ".", "--config-name")
    for cfg in (["--cfg", "job"], ["--cfg=job"], ["-c", "job"], ["--cfg"]):
        shown = yaml.safe_load(bench(*words, "mine", *cfg).stdout)
        assert (shown["method"]["name"], shown["every"]) == ("gray_world", 8)
    for name, told in (
        ("nowhere", "mine"),
        ("empty", "config"),
        ("cut", "YAML"),
        ("unknown", "every"),
    ):
        done = bench(*words, name, "dataset=demo", "--dry-run")
        assert (done.returncode, len(done.errors)) == (2, 1)
        assert told in names(done.stderr)


def test_two_presets_of_one_plugin_are_told_apart_by_labels(bench, tmp_path):
    (tmp_path / "method").mkdir()
    (tmp_path / "method/weak.yaml").write_text("defaults: [red_compensation]\nstrength: 0.1")
    words = ("run", "-cd", ".", "-m", "dataset=demo", "method=red_compensation,weak", "--cfg")
    done = bench(*words)
    assert done.returncode == 2
    assert "label" in done.errors[0]
    assert bench(*words, "weak.label=weak").returncode == 0
