"""A results folder from somebody else: no command runs its code, or publishes what its links lead to."""

import json
import shutil
from pathlib import Path

import pytest
import yaml
from support.colmap_folder import write_dive
from support.command_line import run_here

from sucre_bench import results
from sucre_bench.errors import InputError
from sucre_bench.jobs import compose_jobs
from sucre_bench.loading.lens import read_kalibr
from sucre_bench.machine.text_formats import read_yaml
from sucre_bench.results.bundle_format import write_bundle

EVIL = """
from dataclasses import dataclass
from pathlib import Path
from sucre_bench import Restoration, method

(Path(__file__).parent / "ran").touch()

@method()
@dataclass(frozen=True)
class Evil:
    def restore(self, scene, view):
        return Restoration(view.rgb)
"""
COMMANDS = {
    "bundle": "bundle theirs out.zip",
    "compare": "compare theirs mine",
    "report": "report theirs",
    "study": "study theirs --methods evil,clahe --out out.html",
    "track": "track theirs --uri sqlite:///mlflow.db",
}

# 10 levels of merge keys or aliases, each twice the one before: 400 bytes that stand for a thousand values, and with 30
# levels for more than fits into any machine.
BOMB = "a: &a {x: 1}\n" + "".join(
    f"{'abcdefghij'[n]}: &{'abcdefghij'[n]} {{<<: [{', '.join(['*' + 'abcdefghij'[n - 1]] * 9)}]}}\n"
    for n in range(1, 10)
)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two results folders of one dive: theirs is of a plugin file, and fills other pixels."""
    place = tmp_path_factory.mktemp("made")
    write_dive(place / "dive")
    (place / "evil.py").write_text(EVIL)
    words = [
        "dataset=colmap",
        "dataset.root=dive",
        "metrics=[uciqe]",
        "tracking.uri=off",
        "report=false",
    ]
    theirs = (*words, "method=evil,clahe", "out=theirs")
    assert run_here(place, "run", "-m", "--plugin", "evil.py", *theirs).returncode == 0
    assert run_here(place, "run", *words, "method=gray_world", "out=mine").returncode == 0
    return place


@pytest.fixture
def place(made: Path, tmp_path: Path) -> Path:
    """The folders where another user gets them; config.yaml names the plugin file there."""
    folder = tmp_path / "here"
    shutil.copytree(made, folder)
    for name in ("config.yaml", "experiment.yaml"):
        file = folder / "theirs" / name
        file.write_text(file.read_text().replace(str(made), str(folder)))
    (folder / "ran").unlink()
    return folder


@pytest.mark.parametrize("name", COMMANDS)
def test_code_that_a_results_folder_names_does_not_run(place: Path, name: str):
    done = run_here(place, *COMMANDS[name].split())
    assert not (place / "ran").exists()
    if name.startswith("bundle"):  # the others need no code
        assert "evil.py" in done.stderr


def test_the_option_plugin_loads_it(place: Path):
    done = run_here(place, *COMMANDS["compare"].split(), "--plugin", "evil.py")
    assert done.returncode == 0, done.stderr
    assert "--plugin" not in done.stderr


@pytest.mark.parametrize(
    "name",
    ["restored/colmap/clahe/a.png", "views/colmap/a.jpg", "environment.json", "config.yaml"],
)
def test_a_bundle_publishes_nothing_that_a_link_leads_to(place: Path, name: str):
    (place / "secret").write_text("a secret")
    link = place / "theirs" / name
    link.unlink()
    link.symlink_to(place / "secret")
    done = run_here(place, "bundle", "theirs", "out.zip", "--pictures", "all")
    assert done.returncode == 2
    assert f"{name}: leads out of the folder; " in done.stderr
    assert not (place / "out.zip").exists()


@pytest.mark.parametrize("name", ["report", "study", "track"])
def test_no_page_log_or_picture_shows_what_a_link_leads_to(place: Path, name: str):
    (place / "theirs/restored/colmap/clahe/a.png").unlink()
    (place / "theirs/restored/colmap/clahe/a.png").symlink_to(
        place / "mine/restored/colmap/gray_world/a.png"
    )
    done = run_here(place, *COMMANDS[name].split())
    assert done.returncode == 2
    assert "a.png: leads out of the folder; " in done.stderr


def test_yaml_that_stands_for_more_than_it_is_long_is_refused_by_each_reader(place: Path):
    assert len(BOMB) < 600
    with pytest.raises(yaml.YAMLError, match="alias"):
        read_yaml(BOMB)
    (place / "bomb.yaml").write_text(BOMB)
    with pytest.raises(InputError, match=r"bomb\.yaml: .*alias"):
        compose_jobs.jobs([str(place / "bomb.yaml")], True)
    with pytest.raises(InputError, match=r"bomb\.yaml: .*alias"):
        read_kalibr(place / "bomb.yaml", (64, 48))
    (place / "mine/config.yaml").write_text(BOMB)
    (place / "mine/experiment.yaml").write_text(BOMB)
    done = run_here(place, "bundle", "mine", "out.zip")
    assert done.returncode == 0
    assert "experiment.yaml" in done.stderr
    assert run_here(place, "report", "mine").returncode == 0


def test_a_bundle_without_a_score_is_one_line(place: Path):
    rows = results.read(place / "mine")
    write_bundle(place / "empty.zip", rows[:0], {}, {}, "", "")
    done = run_here(place, "compare", "empty.zip")
    assert done.returncode == 2
    assert "empty.zip: no score there; " in done.stderr


@pytest.mark.parametrize(
    "changed", [{"git_dirty": "x"}, {"git_commit": 5}, {"machine": {}}, {"command": ["\udc80"]}]
)
def test_an_environment_of_another_form_is_no_part_of_the_page(
    place: Path, changed: dict[str, object]
):
    path = place / "mine/environment.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **changed}))
    done = run_here(place, "report", "mine")
    assert (done.returncode, done.stderr) == (0, "")
    assert "uncommitted changes" not in (place / "mine/report/index.html").read_text()
