"""Methods that run a trained network from a file of weights that the user has. sucre_bench contains no weights.

`water_net`, `funie_gan` and `tacl` are the published architectures in PyTorch and read a state dict; `onnx` runs any
network exported as ONNX.
"""

from sucre_bench.methods.networks.onnx import Onnx
from sucre_bench.methods.networks.published import FunieGan, Tacl, WaterNet

__all__ = ["FunieGan", "Onnx", "Tacl", "WaterNet"]
