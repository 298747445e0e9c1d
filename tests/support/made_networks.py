"""Files of networks for the tests: state dicts with seeded random weights, and small ONNX models."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sucre_bench import Arrays, Scene, View, restore

if TYPE_CHECKING:
    import torch

# Method -> its architecture, and the option that names the file.
ARCHITECTURES = {
    "water_net": "WaterNet",
    "funie_gan": "FunieGenerator",
    "tacl": "TaclGenerator",
}


def empty_network(architecture: str) -> torch.nn.Module:
    """A network without memory for its weights."""
    import torch

    from sucre_bench.methods.networks import architectures

    with torch.device("meta"):
        made: torch.nn.Module = getattr(architectures, architecture)()
    return made


def random_state(architecture: str, seed: int = 0) -> dict[str, Any]:
    """A state dict with weights that neither fade nor grow from layer to layer."""
    import torch

    draw = torch.Generator().manual_seed(seed)
    shapes = {
        key: value.shape for key, value in empty_network(architecture).state_dict().items()
    }
    state = {}
    for key, shape in shapes.items():
        noise = torch.randn(shape, generator=draw)
        if key.endswith("num_batches_tracked"):
            state[key] = torch.tensor(7)
        elif len(shape) == 4:
            state[key] = noise * (2 / (shape[1] * shape[2] * shape[3])) ** 0.5
        elif key.endswith("running_var"):
            state[key] = 0.5 + noise.abs()
        else:  # biases about 0, the gains of a normalisation about 1
            state[key] = 0.1 * noise + float(key.endswith("weight"))
    return state


def weights_file(method: str, folder: Path) -> Path:
    """A file of random weights that a method of this package reads."""
    return saved(folder / f"{method}.pth", random_state(ARCHITECTURES[method]))


def onnx_file(
    path: Path,
    nodes: Sequence[Any],
    constants: dict[str, np.ndarray] | None = None,
    shape: Sequence[Any] = (1, 3, "h", "w"),
    dtype: str = "FLOAT",
    outputs: Sequence[str] = ("y",),
    inputs: Sequence[str] = ("x",),
    output_dtype: str = "FLOAT",
) -> Path:
    """Save a model of these nodes, from inputs "x" to outputs "y"."""
    import onnx
    from onnx import helper

    graph = helper.make_graph(
        list(nodes),
        "made",
        [
            helper.make_tensor_value_info(name, getattr(onnx.TensorProto, dtype), shape)
            for name in inputs
        ],
        [
            helper.make_tensor_value_info(name, getattr(onnx.TensorProto, output_dtype), None)
            for name in outputs
        ],
        [
            onnx.numpy_helper.from_array(value, name)
            for name, value in (constants or {}).items()
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)
    onnx.save(model, path)
    return path


def network_options(method: str, folder: Path) -> dict[str, Any]:
    """Options that make a network restore small images soon: a file of its own, made in `folder`."""
    if method in ARCHITECTURES:
        quick = {"size": 64} if method == "funie_gan" else {}
        return {"weights": weights_file(method, folder), **quick}
    from onnx.helper import make_node

    return {"model": onnx_file(folder / "model.onnx", [make_node("Relu", ["x"], ["y"])])}


NOISE = np.random.default_rng(0).random((20, 24, 3), dtype=np.float32)


def restored(method: str, rgb: np.ndarray, **options: Any) -> np.ndarray:
    view = View("a.png", Arrays(rgb))
    return restore(method, Scene("s", [view], frozenset()), view, **options).image


def spring(path: Path) -> None:
    path.touch()


class Trap:
    """Writes a file when it is unpickled."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return spring, (self.path,)


def saved(path: Path, state: dict[str, Any]) -> Path:
    import torch

    torch.save(state, path)
    return path


def planes(rgb: np.ndarray) -> torch.Tensor:
    import torch

    return torch.from_numpy(rgb.astype(np.float64).transpose(2, 0, 1)[None].copy())


def picture(x: torch.Tensor) -> np.ndarray:
    return x[0].numpy().transpose(1, 2, 0)
