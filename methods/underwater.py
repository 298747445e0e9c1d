"""The input itself: what every restorer is compared with."""

from __future__ import annotations

from dataclasses import dataclass

from sucre_bench import Restoration, Scene, View, method


@method()
@dataclass(frozen=True)
class Underwater:
    """The image as it was taken, unrestored."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the view's own pixels."""
        return Restoration(view.rgb)
