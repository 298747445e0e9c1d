"""A package that is missing, too old or broken is one line with the command that mends it, before any work."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.colmap_folder import write_image
from support.command_line import hide

from sucre_bench.errors import InputError
from sucre_bench.machine import provenance


@pytest.mark.parametrize(
    ("words", "hidden", "place", "extra"),
    [
        (
            ["run", "method=tacl", "method.weights=photos/a.jpg"],
            "torch",
            "method 'tacl'",
            "torch",
        ),
        (["run", "method=sucre", "method.backend=jax"], "jax", "method.backend=jax", "jax"),
        (
            ["run", "method=sucre_plus", "method.backend=torch"],
            "torch",
            "method.backend=torch",
            "torch",
        ),
        (
            ["run", "method=gray_world", "tracking.uri=sqlite:///elsewhere.db"],
            "mlflow",
            "tracking.uri",
            "mlflow",
        ),
        (["track", "."], "mlflow", "track", "mlflow"),
        (["prepare", "photos", "dive"], "pycolmap", "prepare", "prepare"),
        (["prepare", "photos", "dive"], "open3d", "prepare", "surfaces"),
        (["restore", "photos", "out"], "pycolmap", "restore", "prepare"),
    ],
)
def test_what_is_missing_is_said_before_any_work(
    bench,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    small_demo,
    words: list[str],
    hidden: str,
    place,
    extra: str,
):
    hide(monkeypatch, hidden)
    write_image(tmp_path / "photos/a.jpg", np.full((30, 40, 3), 90, np.uint8))
    done = bench(*words, *(small_demo if words[0] == "run" else []))
    assert done.returncode == 2
    (line,) = done.stderr.strip().splitlines()
    assert f"{place}: {hidden} is not installed; pip install 'sucre-bench[{extra}]'" in line
    assert not list(tmp_path.rglob("*.png"))


def test_a_run_without_mlflow_and_torch_is_silent_about_them(
    bench, monkeypatch: pytest.MonkeyPatch, small_demo
):
    hide(monkeypatch)
    done = bench("run", "method=gray_world", *small_demo, "workers=0", "first=1")
    assert done.returncode == 0, done.stderr
    assert "mlflow" not in done.stdout + done.stderr
    listed = json.loads(bench("list", "methods", "--json").stdout)
    installed = {one["name"]: one["installed"] for one in listed if "installed" in one}
    assert not any(installed[name] for name in ("tacl", "onnx", "water_net"))
    assert all(installed[name] for name in ("sucre", "sucre_paper", "gray_world"))


def test_a_package_that_is_too_old_or_does_not_import_is_named(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    version_of = provenance.version_of
    monkeypatch.setattr(
        provenance, "version_of", lambda name: "3.9" if name == "pycolmap" else version_of(name)
    )
    with pytest.raises(
        InputError, match=r"prepare: pycolmap is 3\.9, not >=4\.0; pip install .*prepare"
    ):
        provenance.require("prepare", "pycolmap")
    (tmp_path / "broken_library_xyz.py").write_text(
        "raise OSError('libGL.so.1: cannot open')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(
        InputError,
        match=r"texture: broken_library_xyz does not import, .*libGL\.so\.1.*pip install",
    ):
        provenance.load("texture", "broken_library_xyz")


def test_a_run_says_that_a_package_of_the_core_is_too_old(
    bench, monkeypatch: pytest.MonkeyPatch, small_demo
):
    version_of = provenance.version_of
    monkeypatch.setattr(
        provenance, "version_of", lambda name: "1.0" if name == "numpy" else version_of(name)
    )
    done = bench("run", *small_demo, "method=underwater", "--dry-run")
    assert done.returncode == 0, done.stderr
    assert re.search(r"packages: numpy is 1\.0, not >=.*; pip install 'numpy>=", done.stderr)


def test_a_library_of_the_core_that_is_there_but_broken_is_named(program, tmp_path: Path):
    (tmp_path / "pandas.py").write_text("raise ImportError('numpy has another ABI')\n")
    refused = program("score", str(tmp_path), PYTHONPATH=str(tmp_path))
    assert refused.returncode == 1
    (line,) = refused.stderr.strip().splitlines()
    assert "numpy has another ABI; install that package again" in line
