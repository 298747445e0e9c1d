"""Which dataset a folder is."""

from pathlib import Path

import pytest
from support.colmap_folder import picture, write_dive, write_image
from support.messages import names

from sucre_bench import InputError, plugins
from sucre_bench.jobs import compose_jobs
from sucre_bench.plugins.plugin import Plugin


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
        assert dataset_of(f"dataset=./{name}") == (name, name)
    assert dataset_of("dataset=./dive") == ("colmap", "dive")
    assert dataset_of("dataset=./photos") == ("photos", "photos")
    assert dataset_of(f"dataset={tmp_path / 'dive'}", "colmap.image_scale=0.5") == ("colmap", str(tmp_path / "dive"))


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
    with pytest.raises(InputError) as fault:
        dataset_of(f"dataset={dive}")
    assert "dataset=colmap" in str(fault.value)
    assert "dataset=openmvs" in str(fault.value)


@pytest.mark.parametrize(
    ("word", "named"),
    [
        ("dataset=./empty", {"sparse/cameras.*", "colmap"}),
        ("dataset=./above", {"dataset=above/photos"}),
        ("dataset=./nowhere", {"folder", "path"}),
        ("dataset=./file", {"file", "folder"}),
        ("dataset=empty", {"dataset=./empty"}),
    ],
)
def test_a_folder_that_fits_nothing_is_one_line(bench, tmp_path: Path, word: str, named: set[str]):
    (tmp_path / "empty").mkdir()
    (tmp_path / "file").touch()
    write_image(tmp_path / "above" / "photos" / "a.png", picture(1))
    for done in (bench("run", word, "method=gray_world"), bench("describe", word.partition("=")[2])):
        assert (done.returncode, len(done.errors)) == (2, 1)
        assert named <= names(done.stderr)


def test_what_a_folder_is_is_said_in_a_line(bench, tmp_path: Path):
    write_dive(tmp_path / "dive", ("a.png", "b.png"))
    done = bench("describe", "./dive", "--no-sheet")
    assert done.returncode == 0
    assert "dataset=colmap dataset.root=dive" in done.stdout + done.stderr


def test_a_folder_with_the_name_of_a_dataset_is_read(bench, tmp_path: Path):
    """`photos` is both. Where nothing else names the data, the folder is meant."""
    write_image(tmp_path / "photos" / "a.png", picture(1))
    for words in (["describe", "photos", "--no-sheet"], ["run", "dataset=photos", "method=gray_world", "--cfg"]):
        assert bench(*words).returncode == 0
    refused = bench("run", "photos", "method=gray_world").stderr
    assert "write sucre-bench run dataset=photos method=gray_world" in refused
    assert "dataset.root=FOLDER" in bench("describe", "uieb").stderr


def test_every_dataset_of_files_can_be_recognised():
    known = [plugin for plugin in plugins.discover("dataset").values() if isinstance(plugin, Plugin)]
    assert {plugin.name for plugin in known if not plugin.signs} == {"demo"}
