"""Makes any dataset worse in a known way: fewer views, worse depth, poses and images, added water."""

from sucre_bench.degrade.degraded_scene import around, degraded, degraded_whole
from sucre_bench.degrade.options import Degradation

__all__ = ["Degradation", "around", "degraded", "degraded_whole"]
