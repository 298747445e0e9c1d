"""Files of weights: as they are saved, and those that cannot be used."""

from __future__ import annotations  # types do not import torch

import os
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import (
    ARCHITECTURES,
    NOISE,
    Trap,
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


def sprung(path: Path) -> Trap:
    return Trap(path.with_name("sprung"))


def water_net(path: Path, **changed: torch.Tensor) -> Path:
    return saved(path, {**random_state("WaterNet"), **changed})


FIRST = "cmg.conv1.weight"
NAN = float("nan")
BAD: dict[str, tuple[Callable[[Path], object], set[str]]] = {
    "folder": (Path.mkdir, {"folder"}),
    "web page": (lambda path: path.write_bytes(b"\n<!DOCTYPE html><html>"), {"PyTorch"}),
    "empty": (Path.touch, {"PyTorch"}),
    "text": (lambda path: path.write_bytes(b"hello\n" * 99), {"PyTorch", "cut"}),
    "cut": (lambda path: os.truncate(water_net(path), 100_000), {"PyTorch", "cut"}),
    "pickle": (
        lambda path: path.write_bytes(pickle.dumps({"state_dict": sprung(path)})),
        {"PyTorch"},
    ),
    "module": (
        lambda path: torch.save(empty_network("WaterNet"), path),
        {
            "Python",
            "sucre_bench.methods.networks.architectures.WaterNet",
            "sucre_bench.methods.networks.export",
        },
    ),
    "trap": (
        lambda path: water_net(path, further=sprung(path)),
        {"Python", "sucre_bench.methods.networks.export"},
    ),
    "list": (lambda path: torch.save([1, 2], path), {"state", "list"}),
    "no tensors": (lambda path: saved(path, {"epoch": 3}), {"state", "dict"}),
    "script": (
        lambda path: torch.jit.trace(torch.nn.ReLU(), torch.ones(1)).save(str(path)),
        {"PyTorch"},
    ),
    "other network": (
        lambda path: saved(path, random_state("FunieGenerator")),
        {"WaterNet", FIRST},
    ),
    "further": (
        lambda path: water_net(path, **{"cmg.conv9.bias": torch.ones(3)}),
        {"WaterNet", "cmg.conv9.bias"},
    ),
    "shape": (
        lambda path: water_net(path, **{FIRST: torch.ones(128, 9, 7, 7)}),
        {FIRST, "9", "12"},
    ),
    "not finite": (
        lambda path: water_net(path, **{FIRST: torch.full((128, 12, 7, 7), NAN)}),
        {f"'{FIRST}'", "finite"},
    ),
}


@pytest.mark.filterwarnings("ignore:`torch.jit")
@pytest.mark.parametrize(("write", "named"), BAD.values(), ids=BAD)
def test_a_file_that_cannot_be_used_is_named_with_its_fault_and_runs_nothing(
    write: Callable[[Path], object], named: set[str], tmp_path: Path
):
    path = tmp_path / "given.pth"
    write(path)
    with refused(str(path), *named):
        restored("water_net", NOISE, weights=path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("method", ARCHITECTURES)
def test_weights_that_are_not_there_are_a_missing_file(method: str, tmp_path: Path):
    path = tmp_path / "given.pth"
    with refused(str(path), "method.weights", error=MissingFileError):
        restored(method, NOISE, weights=path)
