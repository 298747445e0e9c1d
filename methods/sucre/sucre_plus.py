"""SUCRe with the options that helped on colour charts and on made scenes."""

from __future__ import annotations

from dataclasses import dataclass

from sucre_bench import method
from sucre_bench.methods.sucre.sucre import Sucre
from sucre_bench.methods.sucre.sucre_paper import CITES

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
    """SUCRe with colours held above zero, less noise, and a white point set by a gain without an offset.

    The veil can absorb an offset of all colours without changing any residual, so an offset is the least known quantity
    of the model. Black is therefore J = 0, as the model has it, and not a percentile of the image.
    """

    physical: bool = True
    prior: bool = True
