"""SUCRe with what helped on colour charts and on made scenes."""

from __future__ import annotations

from dataclasses import dataclass

from sucre_bench import method
from sucre_bench.methods.sucre.paper import CITES
from sucre_bench.methods.sucre.sucre import Sucre

__all__ = ["SucrePlus"]


@method(
    needs={"depth", "poses"},
    requires=("numba", "torch"),
    display="white-99",
    cites=CITES,
    reads=("water", "water_from"),
)
@dataclass(frozen=True)
class SucrePlus(Sucre):
    """SUCRe whose colours are held above zero, freed of noise, and brought to white by a gain without an offset.

    An offset of all colours, taken up by the veil, leaves every residual as it is: it is the least known quantity of
    the model. So black is where the physics has it, J = 0, and not where a percentile of the image has it.
    """

    physical: bool = True
    prior: bool = True
