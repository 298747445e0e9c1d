"""What people install: the wheel's content, and that the documented commands are those that exist."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest
from support.places import ROOT

from sucre_bench.datasets.demo import Demo


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> zipfile.ZipFile:
    """The wheel of the files under version control, as a stranger's checkout would build it."""
    checkout, built = tmp_path_factory.mktemp("checkout"), tmp_path_factory.mktemp("wheel")
    files = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"], cwd=ROOT, capture_output=True, text=True
    ).stdout.split()
    subprocess.run(["cp", "--parents", "-P", *files, str(checkout)], cwd=ROOT, check=True)
    build = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--disable-pip-version-check",
        "--no-deps",
        "--no-build-isolation",
        "-q",
        "-w",
        str(built),
    ]
    done = subprocess.run([*build, str(checkout)], capture_output=True, text=True, check=False)
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


def test_the_wheel_installs_one_top_level_package(wheel: zipfile.ZipFile):
    """A top-level `datasets` would hide Hugging Face's."""
    tops = {name.split("/")[0] for name in wheel.namelist()}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"sucre_bench"}


def test_the_pins_name_no_host_and_cover_every_dependency():
    pins = (ROOT / "constraints.txt").read_text()
    assert "://" not in pins
    assert "@" not in pins
    pinned = {line.split("==")[0].lower().replace("_", "-") for line in pins.splitlines() if "==" in line}
    asked = re.findall(r'^  "([A-Za-z0-9_.-]+)>=', (ROOT / "pyproject.toml").read_text(), flags=re.MULTILINE)
    assert asked
    assert {name.lower().replace("_", "-") for name in asked} <= pinned


def blocks(page: str, language: str) -> list[str]:
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.MULTILINE | re.DOTALL)


def halve_blue() -> str:
    """The plugin file of docs/plugins.md."""
    return next(block for block in blocks("docs/plugins.md", "python") if block.startswith("# halve_blue.py"))


def test_the_documented_plugin_runs_as_it_stands(bench, tmp_path: Path, small_demo: list[str]):
    """Its file and its command word for word; the demo scene is a small one."""
    (tmp_path / "halve_blue.py").write_text(halve_blue())
    lines = [line for block in blocks("docs/plugins.md", "sh") for line in block.splitlines()]
    command = next(line for line in lines if "halve_blue" in line)
    done = bench(*command.split()[1:], *small_demo, "tracking.uri=off")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "outputs" / "restored" / "demo" / "halve_blue").is_dir()


def test_the_documented_python_runs_as_it_stands(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    Demo(root=tmp_path, views=2, width=96, height=72).folder().rename(tmp_path / "dive")
    monkeypatch.chdir(tmp_path)
    code = next(block for block in blocks("docs/api.md", "python") if "load_scenes" in block)
    names: dict[str, object] = {}
    exec(compile(code.replace("a.png", "view_001.png"), "api.md", "exec"), names)
    assert {"psi", "uciqe"} <= set(names["rows"]["metric"])  # type: ignore[index]


def test_the_readmes_run_commands_are_valid(bench):
    """Every `run` line composes, every option of it exists: --cfg reads all of it and runs nothing."""
    lines = [line for block in blocks("README.md", "sh") for line in block.splitlines()]
    runs = [line for line in lines if line.startswith("sucre-bench run")]
    assert runs
    for line in runs:
        done = bench(*line.split()[1:], "--cfg")
        assert done.returncode == 0, f"{line}: {done.stderr}"
