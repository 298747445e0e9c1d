"""Any network exported as ONNX (Open Neural Network Exchange), run by onnxruntime.

The network takes one picture and gives one picture. What the model file declares is read from it; options say the rest.
"""

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.errors import InputError, did_you_mean, one_line
from sucre_bench.machine.compute import Device, usable_cores
from sucre_bench.methods.networks.run_torch import check_file
from sucre_bench.methods.networks.sizes import resized, restored_at, tiled
from sucre_bench.plugins.options import check_ranges

# Opens an ONNX model, reads the sizes and types that it declares, and runs it on pixels.

Layout = Literal["auto", "nchw", "nhwc"]

_TYPES = {
    "tensor(float)": "float32",
    "tensor(float16)": "float16",
    "tensor(double)": "float64",
    "tensor(uint8)": "uint8",
}
_CUDA = "CUDAExecutionProvider"


@dataclass(frozen=True, slots=True, eq=False)
class OnnxNetwork:
    """An opened model."""

    session: Any
    path: Path
    output: str

    dtype: str
    """Of its input."""

    channels_first: bool

    fixed: tuple[int, int] | None
    """The height and width it works at; None where it leaves them open."""

    device: str

    def __call__(self, pixels: Array) -> Array:
        """Return what the network makes of pixels (H, W, 3), in the order and range it takes: (h, w, 3) float32.

        Raises InputError, naming the file, when it fails or returns no picture of the same proportions.
        """
        batch = (pixels.round().clip(0, 255) if self.dtype == "uint8" else pixels)[None]
        batch = batch.transpose(0, 3, 1, 2) if self.channels_first else batch
        feed = {
            self.session.get_inputs()[0].name: np.ascontiguousarray(batch, dtype=self.dtype)
        }
        height, width = pixels.shape[:2]
        try:
            restored = np.asarray(self.session.run([self.output], feed)[0])
        except Exception as fault:  # onnxruntime's errors have no common base but this
            raise InputError(
                f"{self.path}: fails on {height}x{width} pixels, {_brief(fault)}; give method.multiple or method.size"
            ) from fault
        returned = restored.shape
        if restored.ndim == 4 and returned[0] == 1:
            restored = restored[0]
        if restored.ndim == 3 and self.channels_first:
            restored = restored.transpose(1, 2, 0)
        if restored.ndim != 3 or restored.shape[2] != 3:
            raise InputError(
                f"{self.path}: output '{self.output}' is {returned}, no picture; give another method.output"
            )
        if restored.shape[0] * width != restored.shape[1] * height:
            raise InputError(
                f"{self.path}: makes {restored.shape[0]}x{restored.shape[1]} of {height}x{width} pixels, other "
                "proportions; give method.multiple, or a model that keeps them"
            )
        return restored.astype(np.float32)


def model_file(path: Path) -> Path:
    """Return the model that a path names: a file, or the one in a folder. InputError when there is none, or several."""
    found = sorted(path.glob("*.onnx")) if path.is_dir() else [path]
    if len(found) != 1:
        names = ", ".join(file.name for file in found) or "none"
        raise InputError(
            f"{path}: is a folder, of .onnx files it holds {names}; give the file in method.model"
        )
    check_file(found[0], "model")
    return found[0]


def opened(path: Path, device: Device, layout: Layout, output: str) -> OnnxNetwork:
    """Open a model, kept for the next view while no file of its folder changes: its weights may lie beside it.

    Raises InputError, naming the file, for one that is no model or does not take one picture of three channels. Also
    for a device that is not there.
    """
    files = sorted((file.name, file.stat()) for file in path.parent.iterdir() if file.is_file())
    stamps = tuple((name, state.st_mtime_ns, state.st_size) for name, state in files)
    return _opened(path, stamps, device, layout, output)


@functools.lru_cache(maxsize=2)
def _opened(
    path: Path,
    stamps: tuple[tuple[str, int, int], ...],
    device: Device,
    layout: Layout,
    output: str,
) -> OnnxNetwork:
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = usable_cores()
    options.use_deterministic_compute = True
    options.log_severity_level = 4  # faults are raised; anything else is advice on the export
    providers = [
        name
        for name in (_CUDA,)
        if device != "cpu" and name in onnxruntime.get_available_providers()
    ]
    try:
        session = onnxruntime.InferenceSession(
            str(path), options, providers=[*providers, "CPUExecutionProvider"]
        )
    except Exception as fault:  # onnxruntime's errors have no common base but this
        remedy = "give a whole .onnx file, with the files of its weights beside it"
        raise InputError(
            f"{path}: onnxruntime does not open it, {_brief(fault)}; {remedy}"
        ) from fault
    if device == "cuda" and session.get_providers()[0] != _CUDA:
        # not there, or it did not start
        raise InputError(
            "method.device: onnxruntime has no GPU here; install onnxruntime-gpu, or give cpu or auto"
        )
    given, *others = session.get_inputs()
    if others:
        names = ", ".join(f"'{i.name}'" for i in (given, *others))
        raise InputError(f"{path}: takes {names}; a model of one input is needed, the picture")
    if given.type not in _TYPES:
        raise InputError(
            f"{path}: takes {given.type}, no picture; a model of float or uint8 input is needed"
        )
    outputs = [o.name for o in session.get_outputs()]
    if output and output not in outputs:
        raise InputError(f"{path}: has no output '{output}'; {did_you_mean(output, outputs)}")
    if not output and len(outputs) > 1:
        raise InputError(
            f"{path}: has outputs {', '.join(outputs)}; choose with method.output={outputs[0]}"
        )
    channels_first, fixed = _read_shape(path, given.shape, layout)
    where = "cuda" if session.get_providers()[0] == _CUDA else "cpu"
    return OnnxNetwork(
        session, path, output or outputs[0], _TYPES[given.type], channels_first, fixed, where
    )


def _read_shape(
    path: Path, shape: list[Any], layout: Layout
) -> tuple[bool, tuple[int, int] | None]:
    """Whether channels come first, and the declared height and width; sizes left open are names, None or 0."""
    sizes = [n if isinstance(n, int) and n > 0 else None for n in shape]
    shown = "x".join("?" if n is None else str(n) for n in sizes)
    if len(sizes) != 4 or sizes[0] not in (1, None):
        raise InputError(
            f"{path}: takes {shown or 'any shape'}; a model of one picture, 1x3xHxW or 1xHxWx3, is needed"
        )
    places = [name for name, at in (("nchw", 1), ("nhwc", 3)) if sizes[at] in (3, None)]
    chosen = ""
    if layout != "auto":
        chosen = layout
    elif sizes[1] == 3:
        chosen = "nchw"
    elif sizes[3] == 3:
        chosen = "nhwc"
    if not chosen and len(places) == 2:
        raise InputError(
            f"{path}: does not say where its channels are; give method.layout=nchw or method.layout=nhwc"
        )
    if chosen not in places:
        raise InputError(
            f"{path}: takes {shown}, not 3 channels in {layout}; a model of RGB pictures is needed"
        )
    height, width = sizes[2:] if chosen == "nchw" else sizes[1:3]
    if (height is None) != (width is None):
        raise InputError(
            f"{path}: takes {shown}, with one side open; export it with both open or both fixed"
        )
    return chosen == "nchw", None if height is None or width is None else (height, width)


def _brief(fault: Exception) -> str:
    """The fault without onnxruntime's prefix of codes, short enough for a line."""
    return one_line(fault).rsplit("] : ", 1)[-1].split(" : ", 2)[-1][:200]


# What a network is given and gives, (RGB - mean) / deviation for RGB in [0, 1]. "imagenet" has the mean and standard
# deviation of ImageNet's red, green and blue, which networks pretrained on it expect.
_RANGES: dict[str, tuple[Any, Any]] = {
    "unit": (0, 1),
    "symmetric": (0.5, 0.5),
    "bytes": (0, 1 / 255),
    "imagenet": (
        np.array([0.485, 0.456, 0.406], np.float32),
        np.array([0.229, 0.224, 0.225], np.float32),
    ),
}


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

    range: Literal["unit", "symmetric", "bytes", "imagenet"] = "unit"
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

    trained_on: str = ""
    """What the network was trained on, for tables: "SET" or "DATASET less SET", with a set of `sucre-bench list sets`,
    or any other words. `compare` warns of test pictures that were among it."""

    def __post_init__(self) -> None:
        model_file(self.model)
        check_ranges(
            self, size="[1, inf)", multiple="[1, inf)", tile="[1, inf)", overlap="[0, inf)"
        )
        if self.tile is not None and self.tile < 2 * self.overlap:
            raise InputError(
                f"onnx.overlap: {self.overlap} must be between 0 and half of onnx.tile={self.tile}"
            )

    def warm_up(self) -> OnnxNetwork:
        """Open the model. Raises InputError when it cannot be used with these options."""
        network = opened(model_file(self.model), self.device, self.layout, self.output)
        if network.dtype == "uint8" and self.range != "bytes":
            raise InputError(
                f"{self.model}: takes whole numbers, not onnx.range={self.range}; give onnx.range=bytes"
            )
        if network.fixed and self.size and network.fixed != (self.size, self.size):
            fixed = f"{network.fixed[0]}x{network.fixed[1]}"
            raise InputError(
                f"{self.model}: works at {fixed} only; leave out method.size={self.size}"
            )
        return network

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may leave [0, 1]. info: device, worked_at (height and width)."""
        network = self.warm_up()
        height, width = view.rgb.shape[:2]
        at = network.fixed or (self.size or height, self.size or width)
        tile = None if network.fixed else self.tile
        multiple = 1 if network.fixed else self.multiple
        mean, deviation = _RANGES[self.range]
        mean_out, deviation_out = _RANGES[
            self.range if self.output_range == "same" else self.output_range
        ]
        turn = -1 if self.order == "bgr" else 1

        def run(rgb: Array) -> Array:
            restored = network(((rgb - mean) / deviation)[..., ::turn])[..., ::turn]
            return resized(restored * deviation_out + mean_out, *rgb.shape[:2])

        return restored_at(
            view,
            at,
            network.device,
            lambda rgb: tiled([rgb], run, tile, self.overlap, multiple),
        )
