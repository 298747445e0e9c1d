"""Compares methods from the score table: which one is better, by how much, and is that more than chance?

A score's unit is an image, or a chart if the metric scores charts. Methods are compared on the units that all of them
have. A method without any restricts nobody, and notes say what is left out. A view counts once, with the mean over its
charts and its replicates. Intervals are 95 %, by a bootstrap over scenes (or views, if there is one scene). Two methods
tie if the interval of their paired difference includes 0. At most 5 % of columns have any false lead of the best.
"""

from sucre_bench.compare.choose_rows import (
    Pixels as Pixels,
    leaves_holes as leaves_holes,
    load as load,
    on_pixels as on_pixels,
    refuse as refuse,
)
from sucre_bench.compare.compare_rows import (
    against as against,
    compare as compare,
    only as only,
)
from sucre_bench.compare.gate import (
    Gate as Gate,
    Gated as Gated,
    gated as gated,
)
from sucre_bench.compare.model import (
    Cell as Cell,
    Column as Column,
    Comparison as Comparison,
    Note as Note,
)
from sucre_bench.compare.words import (
    verdicts as verdicts,
)
from sucre_bench.results.rows import (
    COSTS as COSTS,
    By as By,
)
