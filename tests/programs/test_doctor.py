"""What runs on this machine: what is missing, what is broken, and what only some need."""

import json
import re
from pathlib import Path

import pytest
from support.command_line import hide

from sucre_bench.machine import provenance
from sucre_bench.programs import doctor


def states(found: doctor.Examined) -> dict[str, doctor.Feature]:
    return {feature.name: feature for feature in found.features}


def mended(feature: doctor.Feature) -> tuple[str, str]:
    """A feature's state, and what to tell Python."""
    return feature.state, feature.remedy.split("-m ")[1]


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
            assert re.search(r"pip install \S+", feature["remedy"])


def test_doctor_counts_a_missing_dependency_but_no_extra(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    hide(monkeypatch, "pycolmap", "torch", "pyarrow", "hydra_plugins.hydra_submitit_launcher")
    found = doctor.examine(tmp_path / "not" / "there")
    assert found.faults == 1
    of = states(found)
    lacking, broken = of["prepare: photos to a scene"], of["results, configuration"]
    assert mended(lacking) == ("missing", "pip install 'sucre-bench[prepare]'")
    assert mended(broken) == ("broken", "pip install 'pyarrow>=17'")
    cluster = of["jobs of a cluster, by SLURM"]
    assert mended(cluster) == ("missing", "pip install 'sucre-bench[slurm]'")


def test_doctor_sees_a_torch_that_cannot_use_the_gpu(monkeypatch: pytest.MonkeyPatch):
    torch = pytest.importorskip("torch")
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    version_of = provenance.version_of
    monkeypatch.setattr(provenance, "gpu", lambda: "NVIDIA H100")
    for version, said in (("2.6.0+cpu", "CPUs"), ("2.6.0+cu124", "NVIDIA H100")):
        for module in (doctor, provenance):
            monkeypatch.setattr(
                module,
                "version_of",
                lambda name, v=version: v if name == "torch" else version_of(name),
            )
        feature = states(doctor.examine())["SUCRe on the GPU"]
        assert feature.state == "broken"
        assert said in feature.said
