"""The method `sucre_plus`: `sucre` with the options that lowered errors on colour charts and made scenes."""

from __future__ import annotations

from dataclasses import dataclass

from sucre_bench import method
from sucre_bench.methods.sucre.sucre import Sucre
from sucre_bench.methods.sucre.sucre_paper import CITES


@method(
    needs={"depth", "poses"},
    requires=("numba", "torch"),
    display="black-0.5-white-99",
    cites=CITES,
    reads=("water", "water_from"),
)
@dataclass(frozen=True)
class SucrePlus(Sucre):
    """This project's method on SUCRe's model, for pictures: like `sucre`, with colours above zero and less noise.

    Dots are removed, edges follow the image, and all channels have one black. SUCRe's authors have not seen it. Pixels
    without depth have no colour, unless fill=true guesses them.

    The veil can absorb an offset of all colours without changing any residual, so an offset is the least known quantity
    of the model. A black of each channel would make up for it by turning hues; one black for all channels cannot. White
    is a gain of each channel.
    """

    physical: bool = True
    prior: bool = True
    edges: bool = True
    even: bool = True
