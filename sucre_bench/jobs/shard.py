"""A shard: one of several equal parts of the views, for one job of a cluster."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar

from sucre_bench.errors import InputError

T = TypeVar("T")


@dataclass
class Shard:
    """A part of the selected views: block `index` of `count` blocks of neighbouring views of almost equal size."""

    index: int = 0
    """Number of this block of views, from 0."""
    count: int = 1
    """Number of blocks that the views are split into; 1: all views in one block."""

    def __post_init__(self) -> None:
        if not 0 <= self.index < self.count:
            raise InputError(
                f"block {self.index} of {self.count}",
                "shard",
                "shard.index goes from 0 to shard.count - 1; "
                "run -m shard.count=8 'shard.index=range(8)' runs all blocks",
            )

    def of(self, items: Sequence[T]) -> Sequence[T]:
        """Return this block's items."""
        n = len(items)
        return items[n * self.index // self.count : n * (self.index + 1) // self.count]
