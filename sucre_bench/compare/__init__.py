"""From the long table to an answer: which method is better, by how much, and whether that is more than chance.

A score's unit is an image, or a chart where the metric scores charts. Methods are compared on the units that all of
them have (a method without any restricts nobody; what that leaves out is said). A view counts once, with the mean over
its charts and over its repetitions. Intervals are 95 %, by a hierarchical bootstrap over scenes, views and charts. Two
methods tie when the interval of their paired difference holds 0.
"""

from sucre_bench.compare.model import Cell, Column, Comparison
from sucre_bench.compare.refusals import load, refuse
from sucre_bench.compare.tables import against, compare, is_fresh, only, without_replicates
from sucre_bench.results.rows import COSTS, By

__all__ = [
    "COSTS",
    "By",
    "Cell",
    "Column",
    "Comparison",
    "against",
    "compare",
    "is_fresh",
    "load",
    "only",
    "refuse",
    "without_replicates",
]
