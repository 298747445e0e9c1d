"""Published networks: Water-Net, FUnIE-GAN and TACL, each with the weights that its authors give.

Water-Net: Li et al. 2020, An underwater image enhancement benchmark dataset and beyond, IEEE TIP 29. FUnIE-GAN: Islam,
Xia & Sattar 2020, Fast underwater image enhancement for improved visual perception, IEEE RA-L. TACL: Liu, Jiang, Yang &
Fan 2022, Twin adversarial contrastive learning, IEEE TIP 31.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.imaging.filters import equalised, stretched_by_weakness
from sucre_bench.machine.compute import Device
from sucre_bench.methods.networks.run_torch import (
    Architecture,
    TorchNetwork,
    check_file,
    loaded,
)
from sucre_bench.methods.networks.sizes import limited, restored_at, tiled
from sucre_bench.plugins.options import check_ranges


@dataclass(frozen=True)
class _Published:
    """What the published networks share."""

    architecture: ClassVar[Architecture]
    """A class of `architectures`."""

    weights: Path
    """File of the network's state dict, as PyTorch saves it."""

    device: Device = field(default="auto", kw_only=True)
    """Where to compute: auto takes a GPU when there is one."""

    trained_on: str = field(default="", kw_only=True)
    """What the network was trained on, for tables: "SET" or "DATASET less SET", with a set of `sucre-bench list sets`,
    or any other words. `compare` warns of test pictures that were among it."""

    def __post_init__(self) -> None:
        check_file(self.weights, "weights")

    def warm_up(self) -> TorchNetwork:
        """Load the weights. Raises InputError when the file does not hold them."""
        return loaded(self.architecture, self.weights, self.device)


@method(
    requires=("torch", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Liu, Jiang, Yang & Fan 2022, IEEE TIP",
    licence="network from the paper; the authors' weights come without a licence",
)
@dataclass(frozen=True)
class Tacl(_Published):
    """Restore by a residual network trained on unpaired images in both directions, with a contrastive loss (TACL).

    Each layer normalises by the mean and spread of the whole image, so views are not cut into tiles. The authors'
    weights are latest_net_G_A.pth, those of the forward generator.
    """

    architecture = "TaclGenerator"

    longest_side: int | None = 1280
    """Longest side that the network works at, pixels. Larger views are scaled down and the result up again. null = no
    scaling, which takes 1 GB of memory a megapixel."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, longest_side="[1, inf)")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image. info: device, worked_at (height and width)."""
        network = self.warm_up()

        def run(rgb: Array) -> Array:
            return tiled(
                [rgb], lambda x: (network(2 * x - 1) + 1) / 2, tile=None, multiple=4, least=8
            )

        return restored_at(view, limited(view.rgb, self.longest_side), network.device, run)


# Pixels: sides of tiles, and what neighbours share. A pixel sees 13 others to each side, fewer than a quarter of the
# overlap: tiles leave no trace.
WATER_NET_TILE = 512
WATER_NET_OVERLAP = 64


@method(
    requires=("torch", "cv2", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Li, Guo, Ren, Cong, Hou, Kwong & Tao 2020, IEEE TIP",
    licence="network from the paper; weights under their publishers' terms",
    opinions={"SOTA (0 to 100)": 53.4, "SAUD": 65},
)
@dataclass(frozen=True)
class WaterNet(_Published):
    """Mix a white-balanced, an equalised and a gamma-corrected version of the image by a network (Water-Net).

    The network refines each version and weights it at each pixel by a confidence map.
    """

    architecture = "WaterNet"

    clahe_clip: float = 3.56
    """Contrast limit of the equalised image, in multiples of a histogram's mean bin. 3.56 equals the authors' default
    of .01; a common PyTorch port is trained with 0.1."""

    longest_side: int | None = None
    """Longest side that the network works at, pixels. Larger views are scaled down and the result up again. null =
    no scaling."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_ranges(self, clahe_clip="(0, inf)", longest_side="[1, inf)")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image; values may exceed 1. info: device, worked_at (height and width)."""
        network = self.warm_up()

        def run(rgb: Array) -> Array:
            rgb = rgb.clip(0, 1)
            inputs = (
                rgb,
                stretched_by_weakness(rgb),
                equalised(rgb, self.clahe_clip, 8),
                rgb ** np.float32(0.7),
            )
            return tiled(inputs, network, WATER_NET_TILE, WATER_NET_OVERLAP)

        return restored_at(view, limited(view.rgb, self.longest_side), network.device, run)


# Pixels: sides of tiles, what neighbours share, and what sides are multiples of. A pixel sees 90 others to each side at
# most, fewer than a quarter of the overlap: tiles leave no trace.
FUNIE_TILE = 1024
FUNIE_OVERLAP = 384
FUNIE_MULTIPLE = 32


@method(
    requires=("torch", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Islam, Xia & Sattar 2020, IEEE RA-L",
    licence="network from the paper; the authors' weights MIT",
    opinions={"SOTA (0 to 100)": 53.0},
)
@dataclass(frozen=True)
class FunieGan(_Published):
    """Restore by a small U-Net that was trained against a discriminator, for use on robots (FUnIE-GAN).

    As published, the network works at 256 x 256 pixels. Its answer is enlarged to the view's size. The authors' weights
    are funie_generator.pth.
    """

    architecture = "FunieGenerator"

    size: int | None = 256
    """Side of the square that views are resized to, pixels, a multiple of 32; null = each view's own size."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.size is not None and (self.size < FUNIE_MULTIPLE or self.size % FUNIE_MULTIPLE):
            raise InputError(
                f"funie_gan.size: {self.size} must be a multiple of {FUNIE_MULTIPLE}, or null"
            )

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image. info: device, worked_at (height and width)."""
        network = self.warm_up()
        at = (self.size, self.size) if self.size else limited(view.rgb, None)

        def run(rgb: Array) -> Array:
            return tiled(
                [rgb],
                lambda x: (network(2 * x - 1) + 1) / 2,
                FUNIE_TILE,
                FUNIE_OVERLAP,
                FUNIE_MULTIPLE,
            )

        return restored_at(view, at, network.device, run)
