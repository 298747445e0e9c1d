"""The photograph itself, as a method: all other methods are compared with it."""

from dataclasses import dataclass

from sucre_bench import Restoration, Scene, View, method


@method(is_photograph=True, opinions={"SOTA (0 to 100)": 46.8})
@dataclass(frozen=True)
class Underwater:
    """The photograph as it was taken, without restoration."""

    def restore(self, scene: Scene, view: View) -> Restoration:
        """Return the view's own pixels."""
        return Restoration(view.rgb)
