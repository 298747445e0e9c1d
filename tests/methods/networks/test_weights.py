"""Files of weights: as they are saved, and those that cannot be used."""

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import (
    ARCHITECTURES,
    NOISE,
    empty_network,
    random_state,
    restored,
    saved,
)
from support.messages import refused

from sucre_bench.errors import MissingFileError
from sucre_bench.methods.networks.run_torch import read_state


@pytest.mark.parametrize(
    "wrap", ["bare", "state_dict", "model", "params", "netG", "both", "module.", "legacy"]
)
def test_state_dicts_are_read_as_they_are_saved(wrap: str, tmp_path: Path):
    state = random_state("WaterNet")
    content: dict[str, Any] = {wrap: state, "epoch": 95, "optimizer": {"lr": 1e-4}}
    if wrap == "module.":
        content = {f"module.{key}": value for key, value in state.items()}
    elif wrap == "both":
        content = {
            "epoch": 95,
            "net": {"state_dict": {f"module.{key}": value for key, value in state.items()}},
        }
    elif wrap in ("bare", "legacy"):
        content = state
    path = tmp_path / "w.pth"
    torch.save(content, path, _use_new_zipfile_serialization=wrap != "legacy")
    found = read_state(path)
    assert list(found) == list(state)
    assert all(torch.equal(found[key], state[key]) for key in state)


def test_weights_without_counters_of_batches_or_in_half_precision_do_as_well(
    tmp_path: Path, files: dict[str, Path]
):
    state = {
        key: value.half()
        for key, value in read_state(files["funie_gan"]).items()
        if "num_batches" not in key
    }
    image = restored("funie_gan", NOISE, weights=saved(tmp_path / "w.pth", state), size=None)
    full = restored("funie_gan", NOISE, weights=files["funie_gan"], size=None)
    np.testing.assert_allclose(image, full, atol=0.02)


class Trap:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def bad_file(kind: str, path: Path) -> None:
    state = random_state("WaterNet")
    whole = path.with_name("whole.pth")
    torch.save(state, whole)
    first = "cmg.conv1.weight"
    if kind in ("web page", "empty", "text", "cut", "pickle"):
        trap = pickle.dumps({"state_dict": Trap(path.with_name("sprung"))})
        content = {
            "web page": b"\n<!DOCTYPE html><html>",
            "empty": b"",
            "text": b"hello\n" * 99,
            "pickle": trap,
        }
        path.write_bytes(content.get(kind, whole.read_bytes()[:100_000]))
    elif kind == "folder":
        path.mkdir()
    elif kind == "module":
        torch.save(empty_network("WaterNet"), path)
    elif kind == "trap":
        torch.save({"state_dict": state, "further": Trap(path.with_name("sprung"))}, path)
    elif kind == "list":
        torch.save([1, 2], path)
    elif kind == "no tensors":
        torch.save({"epoch": 3}, path)
    elif kind == "script":
        torch.jit.trace(torch.nn.ReLU(), torch.ones(1)).save(str(path))
    elif kind == "other network":
        torch.save(random_state("FunieGenerator"), path)
    elif kind == "further":
        torch.save({**state, "cmg.conv9.bias": torch.ones(3)}, path)
    elif kind == "shape":
        torch.save({**state, first: torch.ones(128, 9, 7, 7)}, path)
    else:
        torch.save({**state, first: torch.full_like(state[first], float("nan"))}, path)


@pytest.mark.filterwarnings("ignore:`torch.jit")
@pytest.mark.parametrize(
    ("kind", "named"),
    {
        "folder": {"folder"},
        "web page": {"web"},
        "empty": {"empty"},
        "text": {"PyTorch", "cut"},
        "cut": {"PyTorch", "cut"},
        "pickle": {"PyTorch"},
        "module": {
            "Python",
            "sucre_bench.methods.networks.architectures.WaterNet",
            "sucre_bench.methods.networks.export",
        },
        "trap": {"Python", "sucre_bench.methods.networks.export"},
        "list": {"state", "list"},
        "no tensors": {"state", "dict"},
        "script": {"TorchScript", "method=onnx"},
        "other network": {"WaterNet", "'cmg.conv1.weight'", "128x12x7x7"},
        "further": {"WaterNet", "'cmg.conv9.bias'"},
        "shape": {"'cmg.conv1.weight'", "128x9x7x7", "128x12x7x7"},
        "not finite": {"'cmg.conv1.weight'", "finite"},
    }.items(),
)
def test_a_file_that_cannot_be_used_is_named_with_its_fault_and_runs_nothing(
    kind: str, named: set[str], tmp_path: Path
):
    path = tmp_path / "given.pth"
    bad_file(kind, path)
    with refused(str(path), *named):
        restored("water_net", NOISE, weights=path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("method", ARCHITECTURES)
def test_weights_that_are_not_there_are_a_missing_file(method: str, tmp_path: Path):
    path = tmp_path / "given.pth"
    with refused(str(path), "method.weights", error=MissingFileError):
        restored(method, NOISE, weights=path)
