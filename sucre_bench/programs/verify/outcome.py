"""What the check of a bundle found."""

from collections.abc import Mapping
from dataclasses import dataclass

from sucre_bench.compare import Pixels


@dataclass(frozen=True)
class DifferingScore:
    """A score that another value comes out for."""

    dataset: str
    method: str
    scene: str
    view: str
    metric: str
    variant: str
    region: str
    pixels: Pixels
    stored: float
    computed: float


@dataclass(frozen=True)
class Outcome:
    """What became of a bundle's check.

    id, by: see `Bundle`; n_files: number of checked hashes; faults: faults of files, data, pictures or units, one line
    each; differing: scores that differ; n_agree: number of scores that were computed again and agree; n_common: how
    many of these are on common pixels; unchecked: scores that were not computed again, by reason; needs_data: whether
    some of them need the data; other_versions: metrics whose code here is not the code that made the scores.
    """

    id: str
    by: str
    n_files: int
    faults: tuple[str, ...]
    differing: tuple[DifferingScore, ...]
    n_agree: int
    n_common: int
    unchecked: Mapping[str, int]
    needs_data: bool
    other_versions: tuple[str, ...]

    @property
    def n_scores(self) -> int:
        """How many scores the bundle has; seconds and memory are none."""
        return self.n_agree + len(self.differing) + sum(self.unchecked.values())

    @property
    def is_whole(self) -> bool:
        """Whether every score was computed again and agrees."""
        return 0 < self.n_agree == self.n_scores

    @property
    def holds(self) -> bool:
        """Whether nothing differs."""
        return not self.faults and not self.differing
