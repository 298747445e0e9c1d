"""Scores of several restored views of a scene: does a method give one point the same colour in all of them?

No reference is needed: without the water, a point looks alike from everywhere. `Consistency` is the difference between
the colours, `PointContrast` how much colours differ at all, `RangeSlope` whether colours follow the distance, `Matches`
how many more points can be matched between views.
"""

from sucre_bench.metrics.across_views.consistency import Consistency, PointContrast
from sucre_bench.metrics.across_views.matches import Matches
from sucre_bench.metrics.across_views.range_slope import RangeSlope, RangeSlopeError

__all__ = ["Consistency", "Matches", "PointContrast", "RangeSlope", "RangeSlopeError"]
