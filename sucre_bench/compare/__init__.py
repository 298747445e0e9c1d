"""Compares methods from the score table: which one is better, by how much, and is that more than chance?

A score's unit is an image, or a chart if the metric scores charts. Methods are compared on the units that all of them
have. A method without any restricts nobody, and notes say what is left out. A view counts once, with the mean over its
charts and its replicates. Intervals are 95 %, by a bootstrap over scenes (or views, if there is one scene). Two methods
tie if the interval of their paired difference includes 0. At most 5 % of columns have any false lead of the best.
"""

from sucre_bench.compare.choose_rows import Pixels, leaves_holes, load, on_pixels, refusals, refuse
from sucre_bench.compare.compare_rows import against, compare, only
from sucre_bench.compare.gate import Gate, Gated, gated
from sucre_bench.compare.model import Cell, Column, Comparison, Note
from sucre_bench.compare.words import verdicts
from sucre_bench.results.rows import COSTS, By

__all__ = [
    "COSTS",
    "By",
    "Cell",
    "Column",
    "Comparison",
    "Gate",
    "Gated",
    "Note",
    "Pixels",
    "against",
    "compare",
    "gated",
    "leaves_holes",
    "load",
    "on_pixels",
    "only",
    "refusals",
    "refuse",
    "verdicts",
]
