"""Runs a PyTorch network on pixels: loaded once, float32, no gradients, equal results every time."""

from __future__ import annotations

import functools
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import InputError
from sucre_bench.machine.cores import Device
from sucre_bench.methods.networks.weights import fill

if TYPE_CHECKING:
    import torch

Architecture = Literal["WaterNet", "FunieGenerator", "TaclGenerator"]


@dataclass(frozen=True, slots=True, eq=False)
class TorchNetwork:
    """A network with its weights. device: where it is, "cpu" or "cuda"."""

    module: torch.nn.Module
    device: str

    def __call__(self, pixels: Array) -> Array:
        """Return what the network makes of pixels (H, W, C), in the range it takes: (H, W, 3) float32."""
        import torch

        # By default cuDNN rounds to 10 bits, and picks an algorithm by a race.
        exact = torch.backends.cudnn.flags(enabled=True, benchmark=False, deterministic=True, allow_tf32=False)
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
        raise InputError("method.device: there is no GPU that torch can use; give cpu or auto")
    place = "cuda" if device != "cpu" and torch.cuda.is_available() else "cpu"
    state = weights.stat()
    return _loaded(architecture, weights, state.st_mtime_ns, state.st_size, place)


@functools.lru_cache(maxsize=2)
def _loaded(architecture: Architecture, weights: Path, changed: int, size: int, place: str) -> TorchNetwork:
    import torch

    from sucre_bench.methods.networks import architectures

    with torch.device("meta"):  # first values would be drawn from the global random state
        network: torch.nn.Module = getattr(architectures, architecture)()
    network.to_empty(device="cpu")
    fill(network, weights, architecture)
    return TorchNetwork(network.eval().to(place), place)
