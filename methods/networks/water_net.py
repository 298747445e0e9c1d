"""Water-Net (Li et al. 2020, An underwater image enhancement benchmark dataset and beyond, IEEE TIP 29)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters import equalised, stretched_by_weakness
from sucre_bench.machine.cores import Device
from sucre_bench.methods.networks.run_torch import loaded
from sucre_bench.methods.networks.sizes import limited, restored_at, tiled
from sucre_bench.methods.networks.weights import check_file
from sucre_bench.plugins.ranges import check_ranges

# Pixels: sides of tiles, and what neighbours share. A pixel sees 13 others to each side, fewer than a quarter of the
# overlap: tiles leave no trace.
TILE, OVERLAP = 512, 64


@method(
    requires=("torch", "cv2", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Li, Guo, Ren, Cong, Hou, Kwong & Tao 2020, IEEE TIP",
    licence="network from the paper; weights under their publishers' terms",
)
@dataclass(frozen=True)
class WaterNet:
    """Mix a white-balanced, an equalised and a gamma-corrected version of the image by a network (Water-Net).

    The network refines each version and weights it at each pixel by a confidence map.
    """

    weights: Path
    """File of the network's state dict, as PyTorch saves it."""

    clahe_clip: float = 3.56
    """Contrast limit of the equalised image, in multiples of a histogram's mean bin. 3.56 equals the authors' default
    of .01; a common PyTorch port is trained with 0.1."""

    longest_side: int | None = None
    """Longest side that the network works at, pixels. Larger views are scaled down and the result up again. null =
    no scaling."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when there is one."""

    def __post_init__(self) -> None:
        check_file(self.weights, "weights")
        check_ranges(self, clahe_clip="(0, inf)", longest_side="[1, inf)")

    def warm_up(self) -> None:
        """Load the weights. Raises InputError when the file does not hold them."""
        loaded("WaterNet", self.weights, self.device)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may exceed 1. info: device, worked_at (height and width)."""
        network = loaded("WaterNet", self.weights, self.device)

        def run(rgb: Array) -> Array:
            rgb = rgb.clip(0, 1)
            inputs = (rgb, stretched_by_weakness(rgb), equalised(rgb, self.clahe_clip, 8), rgb ** np.float32(0.7))
            return tiled(inputs, network, TILE, OVERLAP)

        height, width = view.rgb.shape[:2]
        return restored_at(view, limited(height, width, self.longest_side), network.device, run)
