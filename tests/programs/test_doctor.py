"""What runs on this machine: what is missing, what is broken, and what only some need."""

import json
import re
import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from support.command_line import hide

from sucre_bench.machine import provenance
from sucre_bench.programs import doctor


def states(found: doctor.Examined) -> dict[str, doctor.Feature]:
    return {feature.name: feature for feature in found.features}


def mended(feature: doctor.Feature) -> tuple[str, str]:
    """A feature's state, and what to tell Python."""
    return feature.state, feature.remedy.split("-m ")[1]


def other_pythons_end(monkeypatch: pytest.MonkeyPatch, code: int, stderr: str = "") -> None:
    """Let each process that doctor starts end at once."""
    ended = subprocess.CompletedProcess([], code, "", stderr)
    monkeypatch.setattr(
        doctor, "subprocess", SimpleNamespace(run=lambda *words, **options: ended)
    )


def test_doctor_tells_programs_what_people_read(bench, monkeypatch: pytest.MonkeyPatch):
    hide(monkeypatch)
    done = bench("doctor", "--json")
    told = json.loads(done.stdout)
    assert done.returncode == (1 if told["faults"] else 0)
    assert set(told["machine"]) >= {"cores", "memory", "disk", "gpu"}
    for feature in told["features"]:
        assert feature["said"]
        assert feature["state"] in ("ready", "missing", "broken", "absent")
        if feature["state"] == "missing":
            assert re.search(
                r"pip install \S+|apt-get install \S+|make setup", feature["remedy"]
            )


def test_doctor_counts_a_missing_dependency_but_no_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    hide(monkeypatch, "pycolmap", "torch", "pyarrow")
    monkeypatch.setattr(doctor.shutil, "which", lambda program: None)
    other_pythons_end(monkeypatch, 0)
    found = doctor.examine(tmp_path / "not" / "there")
    assert found.faults == 1
    of = states(found)
    lacking, broken = of["prepare: photos to a scene"], of["results, configuration"]
    assert mended(lacking) == ("missing", "pip install 'sucre-bench[prepare]'")
    assert mended(broken) == ("broken", "pip install 'pyarrow>=17'")
    assert of["tests in a browser"].state == "missing"
    assert of["a cluster, by SLURM"].state == "absent"


def test_doctor_on_a_cluster_names_the_extra_that_starts_jobs_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    hide(monkeypatch, "hydra_plugins.hydra_submitit_launcher")
    monkeypatch.setattr(doctor.shutil, "which", lambda program: f"/usr/bin/{program}")
    other_pythons_end(monkeypatch, 0)
    cluster = states(doctor.examine(tmp_path))["a cluster, by SLURM"]
    assert mended(cluster) == ("missing", "pip install 'sucre-bench[slurm]'")


def test_doctor_goes_on_after_an_import_that_does_not_end(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    hide(monkeypatch)

    def run(words: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        if "numba" in words[-1]:
            raise subprocess.TimeoutExpired(words, options["timeout"])
        return subprocess.CompletedProcess(words, 0, "", "")

    monkeypatch.setattr(doctor.subprocess, "run", run)
    found = states(doctor.examine(tmp_path))
    sucre = found["SUCRe on the CPU"]
    assert (sucre.state, found["results, configuration"].state) == ("broken", "ready")
    assert "numba does not import: no end after 60 s" in sucre.said


def test_doctor_sees_a_torch_that_cannot_use_the_gpu(monkeypatch: pytest.MonkeyPatch):
    version_of = provenance.version_of
    monkeypatch.setattr(provenance, "gpu", lambda: "NVIDIA H100")
    other_pythons_end(monkeypatch, 1, "Traceback\nRuntimeError: driver too old")
    for torch, said in (("2.6.0+cpu", "CPUs"), ("2.6.0+cu124", "NVIDIA H100: RuntimeError")):
        for module in (doctor, provenance):
            monkeypatch.setattr(
                module, "version_of", lambda n, t=torch: t if n == "torch" else version_of(n)
            )
        feature = states(doctor.examine())["SUCRe on the GPU"]
        assert feature.state == "broken"
        assert said in feature.said
