"""The scenes that plugins are checked on, and what they find changed in the process."""

import itertools

import pytest
from support.forward_model import seen_through

from sucre_bench.programs.contract.made_scenes import WATER, charted


def test_the_water_of_the_contract_is_that_of_the_model() -> None:
    """Methods are checked on these scenes: a wrong sign here would let the same wrong sign there pass."""
    view = charted()["far.png"]
    B, beta, gamma = (WATER.veiling_light, WATER.attenuation, WATER.backscatter)
    for y, x, c in itertools.product((0, 20, 60, 95), (0, 30, 70, 127), range(3)):
        expected = seen_through(float(view.reference[y, x, c]), 3.0, B[c], beta[c], gamma[c])
        assert view.rgb[y, x, c] == pytest.approx(expected, abs=1e-6)
