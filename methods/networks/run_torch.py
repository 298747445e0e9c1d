"""Runs a PyTorch network on pixels: loaded once, float32, no gradients, equal results every time."""

from __future__ import annotations

import functools
import re
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import FileError, InputError, one_line
from sucre_bench.machine.compute import Device
from sucre_bench.machine.files import regular

if TYPE_CHECKING:
    import torch


_WRAPPERS = (
    "state_dict",
    "model_state_dict",
    "params",
    "model",
    "net",
    "network",
    "generator",
    "netG",
    "netG_A",
    "G",
)

UNSAFE = (
    r"Unsupported global: GLOBAL (\S+)"  # in what torch says of an object that is no tensor
)

UNREADABLE = "is no PyTorch file with a state dict, or cut short"
UNREADABLE_REMEDY = "fetch it again, or save the network's state_dict()"

_COUNTER = "num_batches_tracked"


def check_file(path: Path, option: str) -> None:
    """Raise MissingFileError if nothing is there, FileError for anything but a file. option: the one that names it."""
    remedy = f"give the network's file in method.{option}, none is shipped"
    try:
        regular(path, remedy)
    except FileError as fault:
        raise type(fault)(fault.fault, path, remedy) from fault


def read_state(path: Path) -> dict[str, torch.Tensor]:
    """Return the tensors of a state dict by key. Raises InputError, naming the file, when it holds no state dict.

    State dicts are read bare, under the names that training scripts wrap them in, and with "module." before each key,
    as data-parallel training saves them. Only tensors are read: nothing of an untrusted file is unpickled.
    """
    import torch

    try:
        return bare(torch.load(path, map_location="cpu", weights_only=True), path)
    except InputError:
        raise
    except Exception as fault:  # pickle, zip and torch each have their own
        if unsafe := re.search(UNSAFE, str(fault)):
            raise InputError(
                f"{path}: holds a Python object, {unsafe[1]}, which is not loaded since it may run code; to save its "
                f"tensors alone: python -m sucre_bench.methods.networks.export {path} {path.stem}-safe.pt"
            ) from fault
        raise InputError(UNREADABLE, path, UNREADABLE_REMEDY) from fault


def bare(content: object, path: Path) -> dict[str, torch.Tensor]:
    """Return the state dict in what a file holds, without wrappers. Raises InputError if there is none."""
    import torch

    state = content
    while isinstance(state, Mapping):
        wrapped = (state[name] for name in _WRAPPERS if isinstance(state.get(name), Mapping))
        inner = next(wrapped, None)
        if inner is None:
            break
        state = inner
    if not (
        isinstance(state, Mapping)
        and state
        and all(isinstance(value, torch.Tensor) for value in state.values())
    ):
        raise InputError(
            f"{path}: holds no state dict but {type(content).__name__}; save the network's state_dict()"
        )
    is_parallel = all(str(key).startswith("module.") for key in state)
    return {
        str(key).removeprefix("module." if is_parallel else ""): value
        for key, value in state.items()
    }


Architecture = Literal["WaterNet", "FunieGenerator", "TaclGenerator"]


@dataclass(frozen=True, slots=True, eq=False)
class TorchNetwork:
    """A network with its weights."""

    module: torch.nn.Module

    device: str
    """Where it is, "cpu" or "cuda"."""

    def __call__(self, pixels: Array) -> Array:
        """Return what the network makes of pixels (H, W, C), in the range it takes: (H, W, 3) float32."""
        import torch

        # By default cuDNN rounds to 10 bits, and picks an algorithm by a race.
        exact = torch.backends.cudnn.flags(
            enabled=True, benchmark=False, deterministic=True, allow_tf32=False
        )
        planes = np.ascontiguousarray(pixels.transpose(2, 0, 1)[None], dtype=np.float32)
        with torch.inference_mode(), exact if self.device == "cuda" else nullcontext():
            restored = self.module(torch.from_numpy(planes).to(self.device))
        return np.asarray(restored[0].cpu().numpy().transpose(1, 2, 0))


def loaded(architecture: Architecture, weights: Path, device: Device) -> TorchNetwork:
    """Return a network with weights from a file, kept for the next view while the file does not change.

    Raises InputError for a file that does not hold them, and for a device that is not there.
    """
    import torch

    if device == "cuda" and not torch.cuda.is_available():
        raise InputError(
            "there is no GPU that torch can use", "method.device", "give cpu or auto"
        )
    place = "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"
    state = weights.stat()
    return _loaded(architecture, weights, state.st_mtime_ns, state.st_size, place)


@functools.lru_cache(maxsize=2)
def _loaded(
    architecture: Architecture, weights: Path, changed: int, size: int, place: str
) -> TorchNetwork:
    import torch

    from sucre_bench.methods.networks import architectures

    with torch.device("meta"):  # first values would be drawn from the global random state
        network: torch.nn.Module = getattr(architectures, architecture)()
    network.to_empty(device="cpu")
    expected = network.state_dict()
    found = read_state(weights)
    for key, value in found.items():
        if not torch.isfinite(value).all():
            fault = f"'{key}' holds numbers that are not finite"
            raise InputError(fault, weights, "take another checkpoint")
    # Batches seen in training: files from before PyTorch 0.4.1 lack them, and nothing here depends on them.
    counters = {key: value for key, value in expected.items() if key.endswith(_COUNTER)}
    given = {key: value for key, value in found.items() if not key.endswith(_COUNTER)}
    try:
        network.load_state_dict({**given, **counters})
    except RuntimeError as fault:
        remedy = "give weights of that architecture, or export the network and use method=onnx"
        why = f"not the weights of {architecture}, {one_line(fault)[:300]}"
        raise InputError(why, weights, remedy) from fault
    return TorchNetwork(network.eval().to(place), place)
