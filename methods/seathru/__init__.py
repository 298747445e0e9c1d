"""Sea-thru*: estimates the water of one view from its darkest pixels and its local illuminant."""

from sucre_bench.methods.seathru.seathru import Seathru

__all__ = ["Seathru"]
