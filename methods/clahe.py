"""CLAHE on lightness (Zuiderveld 1994, Contrast limited adaptive histogram equalization, Graphics Gems IV)."""

from dataclasses import dataclass

from sucre_bench import Restoration, Scene, View, method
from sucre_bench.imaging.filters import equalised
from sucre_bench.plugins.options import check_ranges


@method(requires=("cv2",), cites="Zuiderveld 1994", encoding="gamma")
@dataclass(frozen=True)
class Clahe:
    """Equalise the histogram of lightness in tiles, with limited contrast; hue and chroma are kept.

    Many pipelines for underwater images begin with this step. It raises contrast and corrects no cast.
    """

    clip: float = 2.0
    """Limit of the contrast, in multiples of a histogram's mean bin; 256 switches the limit off."""

    tiles: int = 4
    """Tiles along each side of the image."""

    def __post_init__(self) -> None:
        check_ranges(self, clip="(0, 256]", tiles="[1, 256]")

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the whole image, equalised, in [0, 1]."""
        return Restoration(equalised(view.rgb, self.clip, self.tiles))
