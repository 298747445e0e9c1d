"""How many observations of the view a method used, over all views."""

from collections.abc import Iterator
from dataclasses import dataclass

from sucre_bench.arrays import Array
from sucre_bench.plugins.decorators import metric
from sucre_bench.scene import Restoration, Score, View

_KEYS = {"all": "n_observations", "repeated": "n_repeated", "views": "n_views"}


@metric(
    role="observations",
    needs={"restoration"},
    unit="count",
    better="none",
    range=(0, float("inf")),
    variants={
        "all": "observations of the view's pixels, in all views",
        "repeated": "pixels that are seen more than once",
        "views": "views with an observation, the view itself among them",
    },
)
@dataclass(frozen=True)
class Observations:
    """Number of observations that a multi-view method used, from its info (n_observations and others)."""

    def score(self, restored: Restoration, shown: Array, view: View, variant: str) -> Iterator[Score]:
        """Yield one score; nothing where the method does not tell."""
        count = restored.info.get(_KEYS[variant])
        if count is not None:
            valid = restored.valid
            yield Score(float(count), n_pixels=int(valid.sum()), coverage=float(valid.mean()))
