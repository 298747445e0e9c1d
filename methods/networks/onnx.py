"""Any network exported as ONNX (Open Neural Network Exchange), run by onnxruntime.

The network takes one picture and gives one picture. What the model file declares is read from it; options say the rest.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.machine.cores import Device
from sucre_bench.methods.networks.run_onnx import Layout, OnnxNetwork, model_file, opened
from sucre_bench.methods.networks.sizes import resized, restored_at, tiled
from sucre_bench.plugins.ranges import check_ranges

Range = Literal["unit", "symmetric", "bytes", "imagenet"]

# ImageNet's mean and standard deviation of RGB in [0, 1]: networks pretrained on it expect (pixel - mean) / deviation.
_MEAN = np.array([0.485, 0.456, 0.406], dtype=np.float32)
_DEVIATION = np.array([0.229, 0.224, 0.225], dtype=np.float32)


@method(
    requires=("onnxruntime", "PIL"),
    encoding="gamma",
    reads=("model",),
    cites="the network's own authors",
    licence="the model's own",
)
@dataclass(frozen=True)
class Onnx:
    """Restore by any network exported as ONNX, with one picture in and one picture out."""

    model: Path
    """The .onnx file, or the folder that holds it. If weights lie in separate files beside it, give the folder: then
    views are restored again when any of them changes."""

    order: Literal["rgb", "bgr"] = "rgb"
    """Order of the channels, in and out."""

    layout: Layout = "auto"
    """nchw: channels before height and width; nhwc: after them; auto: read from the model."""

    range: Range = "unit"
    """Range of the input: unit [0, 1], symmetric [-1, 1], bytes [0, 255], imagenet (pixel - mean) / deviation with
    ImageNet's values for red, green and blue, whatever the order."""

    output_range: Literal["same", "unit", "symmetric", "bytes", "imagenet"] = "same"
    """Range of the output: one of these, or the same as the input's."""

    output: str = ""
    """Name of the output to take; needed if the model has several."""

    size: int | None = None
    """Side of the square that views are resized to, pixels; null = the model's declared size, else each view's."""

    multiple: int = 1
    """Height and width are mirrored up to a multiple of this."""

    tile: int | None = 1024
    """Longest side of a tile, pixels; null never cuts a view. Networks with attention, instance normalisation or
    global pooling look at the whole image and need null."""

    overlap: int = 128
    """Overlap of tiles, pixels. With four times the network's reach, the result shows no trace of tiles."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when onnxruntime can."""

    def __post_init__(self) -> None:
        model_file(self.model)
        check_ranges(self, size="[1, inf)", multiple="[1, inf)", tile="[1, inf)", overlap="[0, inf)")
        if self.tile is not None and self.tile < 2 * self.overlap:
            raise InputError(f"onnx.overlap: {self.overlap} must be between 0 and half of onnx.tile={self.tile}")

    def warm_up(self) -> None:
        """Open the model. Raises InputError when it cannot be used with these options."""
        self._network()

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]. info: device, worked_at (height and width)."""
        network = self._network()
        height, width = view.rgb.shape[:2]
        if network.fixed:
            at, tile, multiple = network.fixed, None, 1
        else:
            at, tile, multiple = (self.size or height, self.size or width), self.tile, self.multiple

        def run(rgb: Array) -> Array:
            return tiled([rgb], lambda x: self._run(network, x), tile, self.overlap, multiple)

        return restored_at(view, at, network.device, run)

    def _network(self) -> OnnxNetwork:
        network = opened(model_file(self.model), self.device, self.layout, self.output)
        if network.dtype == "uint8" and self.range != "bytes":
            raise InputError(f"{self.model}: takes whole numbers, not onnx.range={self.range}; give onnx.range=bytes")
        if network.fixed and self.size and network.fixed != (self.size, self.size):
            fixed = f"{network.fixed[0]}x{network.fixed[1]}"
            raise InputError(f"{self.model}: works at {fixed} only; leave out onnx.size={self.size}")
        return network

    def _run(self, network: OnnxNetwork, rgb: Array) -> Array:
        given, back = _to_range(rgb, self.range), -1 if self.order == "bgr" else 1
        restored = network(given[..., ::back])[..., ::back]
        returned = self.range if self.output_range == "same" else self.output_range
        return resized(_from_range(restored, returned), *rgb.shape[:2])


def _to_range(rgb: Array, wanted: Range) -> Array:
    """Bring RGB (H, W, 3) from [0, 1] to the range a network wants."""
    if wanted == "imagenet":
        return (rgb - _MEAN) / _DEVIATION
    return {"unit": rgb, "symmetric": 2 * rgb - 1, "bytes": 255 * rgb}[wanted]


def _from_range(rgb: Array, given: str) -> Array:
    """Bring RGB (H, W, 3) from the range a network gives to [0, 1]."""
    if given == "imagenet":
        return rgb * _DEVIATION + _MEAN
    return {"unit": rgb, "symmetric": (rgb + 1) / 2, "bytes": rgb / 255}[given]
