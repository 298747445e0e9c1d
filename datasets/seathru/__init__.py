"""Sea-thru D1 to D5: reefs in natural light, linear images with depth maps and, in D5, four colour charts."""

from sucre_bench.datasets.seathru.seathru import Seathru

__all__ = ["Seathru"]
