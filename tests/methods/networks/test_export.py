"""Networks of others: the tensors of files that hold more, and the export to ONNX."""

import argparse
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import Trap

from sucre_bench.errors import InputError
from sucre_bench.methods.networks.export import _main, tensors

CODE = """
import torch

class Phase(torch.nn.Conv2d):
    # of complex numbers, which ONNX does not have
    def forward(self, x):
        return torch.fft.ifft2(1j * torch.fft.fft2(super().forward(x)).angle()).real

class Halved(Phase):
    def forward(self, x):
        return x[..., :16, :16].reshape(1, 3, 16, x.shape[-1] // 16) + x

class Brighter(torch.nn.Module):
    def __init__(self, layers):
        super().__init__()
        self.body = torch.nn.Sequential(*(torch.nn.Conv2d(3, 3, 3, padding=1) for _ in range(layers)))

    def forward(self, x):
        return x + self.body(x)
"""


@pytest.mark.parametrize("kind", ["options", "whole module", "trap"])
def test_the_tensors_of_a_file_are_taken_and_nothing_of_it_runs(
    kind: str, tmp_path: Path
) -> None:
    layer = torch.nn.Sequential(torch.nn.Conv2d(3, 4, 3), torch.nn.BatchNorm2d(4))
    state = layer.state_dict()
    content = {
        "options": {"model_state_dict": state, "opt": argparse.Namespace(rate=0.1)},
        "whole module": layer,
        "trap": {"state_dict": state, "further": Trap(tmp_path / "sprung")},
    }
    torch.save(content[kind], tmp_path / "net.pt")
    found = tensors(tmp_path / "net.pt")
    assert list(found) == list(state)
    assert all(torch.equal(found[key], state[key]) for key in state)
    assert not (tmp_path / "sprung").exists()


def test_a_file_without_a_network_is_refused(tmp_path: Path) -> None:
    torch.save({"opt": argparse.Namespace(rate=0.1)}, tmp_path / "net.pt")
    with pytest.raises(InputError):
        tensors(tmp_path / "net.pt")


def test_the_exported_network_computes_what_torch_computes(tmp_path: Path) -> None:
    runtime = pytest.importorskip("onnxruntime")
    pytest.importorskip("onnx")
    (tmp_path / "net.py").write_text(CODE, encoding="utf-8")
    space: dict[str, Any] = {}
    exec(CODE, space)
    network = space["Brighter"](2)
    torch.save(
        {"model": network.state_dict(), "opt": argparse.Namespace()}, tmp_path / "net.pt"
    )
    command = [
        sys.executable,
        "-m",
        "sucre_bench.methods.networks.export",
        "net.pt",
        "net.onnx",
        "net:Brighter",
    ]
    subprocess.run([*command, "layers=2"], cwd=tmp_path, check=True, capture_output=True)
    picture = np.random.default_rng(0).random((1, 3, 40, 56), dtype=np.float32)
    restored = runtime.InferenceSession(str(tmp_path / "net.onnx")).run(
        None, {"image": picture}
    )[0]
    with torch.no_grad():
        assert restored == pytest.approx(network(torch.from_numpy(picture)).numpy(), abs=1e-5)


@pytest.mark.parametrize(
    ("command", "named"),
    [
        ("net.pt net.pt", "net.pt: is there; "),
        ("nowhere.pt new.pt", "nowhere.pt: no such file; "),
        ("net.py new.pt", "net.py: is no PyTorch file .*; "),
        ("net.pt new.onnx nowhere:Brighter", "nowhere:Brighter: cannot be made, .*; "),
        ("net.pt new.onnx net:Brighter layers=a", "layers=a: is no option; .*OPTION=NUMBER"),
        ("net.pt new.onnx net:Brighter depth=2", "net:Brighter: cannot be made, .*depth.*; "),
        (
            "net.pt new.onnx net:Phase in_channels=3 out_channels=3 kernel_size=3",
            "net:Phase: cannot be exported, .*; .*at=.*method=command",
        ),
        (
            "net.pt new.onnx net:Halved in_channels=3 out_channels=3 kernel_size=3",
            "net:Halved: cannot be exported, .*; give a size .*at=",
        ),
        ("net.pt new.onnx net:Brighter layers=2 at=9", "at=9: is no option; .*at="),
    ],
)
def test_what_cannot_be_exported_is_one_line_and_nothing_is_written(
    command: str,
    named: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.delitem(sys.modules, "net", raising=False)
    (tmp_path / "net.py").write_text(CODE, encoding="utf-8")
    torch.save({"model": torch.nn.Conv2d(3, 3, 3).state_dict()}, "net.pt")
    there = Path("net.pt").read_bytes()
    with pytest.raises(SystemExit) as end:
        _main(command.split())
    (line,) = capsys.readouterr().err.splitlines()
    assert (end.value.code, bool(re.search(named, line))) == (2, True), line
    assert Path("net.pt").read_bytes() == there
    assert not list(tmp_path.glob("new.*"))
