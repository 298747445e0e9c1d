"""FUnIE-GAN (Islam, Xia & Sattar 2020, Fast underwater image enhancement for improved visual perception, IEEE RA-L)."""

from dataclasses import dataclass
from pathlib import Path

from sucre_bench import InputError, Restoration, Scene, View, method
from sucre_bench.arrays import Array
from sucre_bench.machine.cores import Device
from sucre_bench.methods.networks.run_torch import loaded
from sucre_bench.methods.networks.sizes import restored_at, tiled
from sucre_bench.methods.networks.weights import check_file

# Pixels: sides of tiles, what neighbours share, and what sides are multiples of. A pixel sees 90 others to each side at
# most, fewer than a quarter of the overlap: tiles leave no trace.
TILE, OVERLAP, MULTIPLE = 1024, 384, 32


@method(
    requires=("torch", "PIL"),
    encoding="gamma",
    reads=("weights",),
    cites="Islam, Xia & Sattar 2020, IEEE RA-L",
    licence="network from the paper; the authors' weights MIT",
)
@dataclass(frozen=True)
class FunieGan:
    """Restore by a small U-Net that was trained against a discriminator, for use on robots (FUnIE-GAN).

    As published, the network works at 256 x 256 pixels. Its answer is enlarged to the view's size.
    """

    weights: Path
    """File of the generator's state dict, as PyTorch saves it: the authors' funie_generator.pth."""

    size: int | None = 256
    """Side of the square that views are resized to, pixels, a multiple of 32; null = each view's own size."""

    device: Device = "auto"
    """Where to compute: auto takes a GPU when there is one."""

    def __post_init__(self) -> None:
        check_file(self.weights, "weights")
        if self.size is not None and (self.size < MULTIPLE or self.size % MULTIPLE):
            raise InputError(f"funie_gan.size: {self.size} must be a multiple of {MULTIPLE}, or null")

    def warm_up(self) -> None:
        """Load the weights. Raises InputError when the file does not hold them."""
        loaded("FunieGenerator", self.weights, self.device)

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image. info: device, worked_at (height and width)."""
        network = loaded("FunieGenerator", self.weights, self.device)
        at = (self.size, self.size) if self.size else (view.rgb.shape[0], view.rgb.shape[1])

        def run(rgb: Array) -> Array:
            return tiled([rgb], lambda x: (network(2 * x - 1) + 1) / 2, TILE, OVERLAP, MULTIPLE)

        return restored_at(view, at, network.device, run)
