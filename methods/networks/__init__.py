"""Methods that run a trained network from a file of weights that the user has. sucre_bench contains no weights.

`water_net`, `funie_gan` and `tacl` are the published architectures in PyTorch and read a state dict; `onnx` runs any
network exported as ONNX.
"""

from sucre_bench.methods.networks.funie_gan import FunieGan
from sucre_bench.methods.networks.onnx import Onnx
from sucre_bench.methods.networks.tacl import Tacl
from sucre_bench.methods.networks.water_net import WaterNet

__all__ = ["FunieGan", "Onnx", "Tacl", "WaterNet"]
