"""TACL, twin adversarial contrastive learning (Liu, Jiang, Yang & Fan 2022, IEEE TIP 31)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.methods.networks.on_torch import Device, loaded
from sucre_bench.methods.networks.sizes import limited, resized, tiled
from sucre_bench.methods.networks.weights import check_file

__all__ = ["Tacl"]


@method(
    requires=("torch", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Liu, Jiang, Yang & Fan 2022, IEEE TIP",
    licence="network from the paper; the authors' weights come without a licence",
)
@dataclass(frozen=True)
class Tacl:
    """A residual network trained on unpaired images, there and back, with contrast to the input (TACL).

    Its normalisation takes the mean and the spread of the whole image in every layer, so that no view is cut in tiles.
    """

    weights: Path
    """File of the forward generator's state dict, as PyTorch saves it: the authors' latest_net_G_A.pth."""

    longest_side: int | None = 1280
    """Longest side that the network works at, pixels; larger views are scaled down and the result up again; None
    scales nothing and takes 1 GB of memory a megapixel."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when there is one."""

    def __post_init__(self) -> None:
        check_file(self.weights, "weights")
        if self.longest_side is not None and self.longest_side < 1:
            raise InputError(f"tacl.longest_side: {self.longest_side} must be positive")

    def warm_up(self) -> None:
        """Load the weights. Raises InputError when the file does not hold them."""
        loaded("TaclGenerator", self.weights, self.device)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, restored. info: device, worked_at (height and width)."""
        network = loaded("TaclGenerator", self.weights, self.device)
        height, width = view.rgb.shape[:2]
        at = limited(height, width, self.longest_side)
        rgb = resized(view.rgb, *at)
        restored = tiled([rgb], lambda x: (network(2 * x - 1) + 1) / 2, tile=None, multiple=4, least=8)
        return Restoration(
            resized(restored, height, width), info={"device": network.device, "worked_at": f"{at[0]}x{at[1]}"}
        )
