"""What people install: the wheel's content, and that the documented commands are those that exist."""

import email
import re
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest
from support.places import ROOT, blocks

from sucre_bench.datasets.demo import Demo
from sucre_bench.machine.provenance import requirements


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of the files under version control, as a stranger's checkout would build it."""
    checkout, built = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("wheel")
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
    ).stdout.split()
    subprocess.run(["cp", "--parents", "-P", *files, str(checkout)], cwd=ROOT, check=True)
    options = ["--disable-pip-version-check", "--no-deps", "--no-build-isolation", "-q", "-w"]
    build = [sys.executable, "-m", "pip", "wheel", *options, str(built), str(checkout)]
    done = subprocess.run(build, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return zipfile.ZipFile(next(built.glob("*.whl")))


def test_the_wheel_carries_plugins_and_configuration(wheel: zipfile.ZipFile):
    names = set(wheel.namelist())
    for needed in (
        "sucre_bench/methods/gray_world.py",
        "sucre_bench/methods/sucre/paper.py",
        "sucre_bench/datasets/colmap.py",
        "sucre_bench/datasets/demo/__init__.py",
        "sucre_bench/metrics/uiqm/__init__.py",
        "sucre_bench/conf/config.yaml",
        "sucre_bench/conf/experiment/demo.yaml",
        "sucre_bench/reports/page/page.html.j2",
        "sucre_bench/py.typed",
    ):
        assert needed in names


def test_the_wheel_installs_one_package_and_its_part_of_hydras_plugins(wheel: zipfile.ZipFile):
    """A top-level `datasets` would hide Hugging Face's."""
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {
        "sucre_bench",
        "hydra_plugins",
    }


def test_the_pins_name_no_host_and_cover_every_dependency():
    pins = (ROOT / "constraints.txt").read_text()
    assert "://" not in pins
    assert "@" not in pins
    pinned = {
        line.split("==")[0].lower().replace("_", "-")
        for line in pins.splitlines()
        if "==" in line
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]["all"][0]
    asked = {one.partition(">=")[0] for one in project["dependencies"]}
    asked |= {name for name, (_, extra) in requirements().items() if extra and extra in extras}
    assert asked > {"numpy", "torch", "open3d"}
    assert {name.lower().replace("_", "-") for name in asked} <= pinned


def test_the_description_of_the_package_leads_to_whole_addresses(wheel: zipfile.ZipFile):
    """Where README's own links are relative, and would lead nowhere from a package index."""
    (name,) = (name for name in wheel.namelist() if name.endswith(".dist-info/METADATA"))
    about = email.message_from_bytes(wheel.read(name))
    assert about["Author"] == "sucre_bench contributors"
    links = re.findall(r"\]\(([^)]+)\)", str(about.get_payload()))
    assert len(links) > 20
    assert {link for link in links if not link.startswith(("https://", "#"))} == set()
    version = about["Version"]
    assert any(link.endswith(f"/raw/v{version}/docs/pictures/demo.jpg") for link in links)
    assert f"\n## {version}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_the_documented_plugin_runs_as_it_stands(bench, tmp_path: Path, small_demo: list[str]):
    """Its file and its command word for word; the demo scene is a small one."""
    (plugin,) = (
        block for block in blocks("docs/plugins.md", "python") if "# halve_blue.py" in block
    )
    (tmp_path / "halve_blue.py").write_text(plugin)
    lines = [line for block in blocks("docs/plugins.md", "sh") for line in block.splitlines()]
    command = next(line for line in lines if "halve_blue" in line)
    done = bench(*command.split()[1:], *small_demo, "tracking.uri=off")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "outputs" / "restored" / "demo" / "halve_blue").is_dir()


def test_the_documented_python_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    Demo(root=tmp_path, views=2, width=96, height=72).folder().rename(tmp_path / "dive")
    monkeypatch.chdir(tmp_path)
    code = next(block for block in blocks("docs/api.md", "python") if "load_scene(" in block)
    names: dict[str, object] = {}
    exec(compile(code.replace("a.png", "view_001.png"), "api.md", "exec"), names)
    assert {"psi", "uciqe"} <= set(names["rows"]["metric"])
