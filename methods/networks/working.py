"""Options that all networks here share: the size at which they work."""

from __future__ import annotations

from collections.abc import Callable

from sucre_bench.arrays import Array
from sucre_bench.methods.networks.sizes import resized
from sucre_bench.scene import Restoration, View


def restored_at(view: View, at: tuple[int, int], device: str, run: Callable[[Array], Array]) -> Restoration:
    """Return the whole image of a view, restored by `run` at another size and brought back to the view's.

    at: height and width that `run` is given, (H, W, 3) to (H, W, 3); device: where it runs. info: device, worked_at
    (height and width).
    """
    height, width = view.rgb.shape[:2]
    restored = run(resized(view.rgb, *at))
    return Restoration(resized(restored, height, width), info={"device": device, "worked_at": f"{at[0]}x{at[1]}"})
