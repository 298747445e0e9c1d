"""Counts the photos that COLMAP has placed, for the line of progress."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(slots=True)
class PlacedPhotos:
    """Counts the photos of the largest model so far. COLMAP may begin again with other photos, or place one twice.

    step: is called once for each; most: number of photos; in_model: of the model that grows; shown: calls of `step`.
    """

    step: Callable[[], None]
    most: int
    in_model: int = 0
    shown: int = 0

    def first_two(self) -> None:
        """A model begins with two photos."""
        self._show(2)

    def another(self) -> None:
        """The model has one photo more."""
        self._show(self.in_model + 1)

    def _show(self, in_model: int) -> None:
        self.in_model = in_model
        while self.shown < min(in_model, self.most):
            self.step()
            self.shown += 1
