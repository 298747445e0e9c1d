"""TACL, twin adversarial contrastive learning (Liu, Jiang, Yang & Fan 2022, IEEE TIP 31)."""

from dataclasses import dataclass
from pathlib import Path

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.machine.cores import Device
from sucre_bench.methods.networks.run_torch import loaded
from sucre_bench.methods.networks.sizes import limited, restored_at, tiled
from sucre_bench.methods.networks.weights import check_file
from sucre_bench.plugins.ranges import check_ranges


@method(
    requires=("torch", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Liu, Jiang, Yang & Fan 2022, IEEE TIP",
    licence="network from the paper; the authors' weights come without a licence",
)
@dataclass(frozen=True)
class Tacl:
    """Restore by a residual network trained on unpaired images in both directions, with a contrastive loss (TACL).

    Each layer normalises by the mean and spread of the whole image, so views are not cut into tiles.
    """

    weights: Path
    """File of the forward generator's state dict, as PyTorch saves it: the authors' latest_net_G_A.pth."""

    longest_side: int | None = 1280
    """Longest side that the network works at, pixels. Larger views are scaled down and the result up again. null = no
    scaling, which takes 1 GB of memory a megapixel."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when there is one."""

    def __post_init__(self) -> None:
        check_file(self.weights, "weights")
        check_ranges(self, longest_side="[1, inf)")

    def warm_up(self) -> None:
        """Load the weights. Raises InputError when the file does not hold them."""
        loaded("TaclGenerator", self.weights, self.device)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image. info: device, worked_at (height and width)."""
        network = loaded("TaclGenerator", self.weights, self.device)

        def run(rgb: Array) -> Array:
            return tiled([rgb], lambda x: (network(2 * x - 1) + 1) / 2, tile=None, multiple=4, least=8)

        height, width = view.rgb.shape[:2]
        return restored_at(view, limited(height, width, self.longest_side), network.device, run)
