"""A survey of flat ground in the light of a strobe on the vehicle, against the same survey in even light."""

from __future__ import annotations

import numpy as np
import pytest
from support.made_ground import WATERS, make_ground
from support.made_survey import make_survey

from sucre_bench import Restoration, Scene
from sucre_bench.imaging.display import display
from sucre_bench.methods.sucre import Sucre, SucrePlus
from sucre_bench.plugins.calling import shown_with


@pytest.fixture(scope="module")
def strobe_lit() -> Scene:
    return make_survey(WATERS["coast"])


def shown_error(image: np.ndarray, scene: Scene) -> float:
    """Root mean square error of the displayed picture of view 4."""
    return float(np.sqrt(np.nanmean((display(image, "stretch-1-99") - scene["4.png"].reference) ** 2)))


def limits(result: Restoration) -> str:
    return "; ".join(result.info["limits"])


def test_a_strobe_is_found_and_the_water_is_said_to_be_wrong(strobe_lit: Scene) -> None:
    result = Sucre().restore(strobe_lit, strobe_lit["4.png"])
    assert "lamp=true" in limits(result)
    assert "exposure=per_view" not in limits(result)
    found = result.info["falloff"]
    assert 0.2 < found["least"] < 0.6  # the lobe and the square of the way leave .37 in the corners
    assert found["noise"] < 0.3 * found["noise_without"]


@pytest.mark.parametrize("gains", [None, (0.8, 1.2, 0.95, 1.3, 0.85, 1.1)])
def test_even_light_has_no_falloff_whatever_the_exposure(gains: tuple[float, ...] | None) -> None:
    scene = make_ground(WATERS["green"], gains=gains)
    result = Sucre(exposure="constant").restore(scene, scene["3.png"])
    assert "falloff" not in result.info
    assert "falls off" not in limits(result)


def test_a_lamp_over_flat_ground_says_what_distances_leave_open(strobe_lit: Scene) -> None:
    view, truth = strobe_lit["4.png"], WATERS["coast"].attenuation
    result = Sucre(lamp=True).restore(strobe_lit, view)
    assert "too high" in limits(result)
    assert result.water is not None
    excess = result.water.attenuation - truth
    assert (excess < 1.2 / np.median(view.distance)).all()
    assert excess.max() > 0.1  # so it has to be said
    assert shown_error(result.image, strobe_lit) < 0.7 * shown_error(view.rgb, strobe_lit)


def test_a_veil_that_stays_in_the_colours_is_said_where_one_black_would_show_it(strobe_lit: Scene) -> None:
    view = strobe_lit["4.png"]
    result = SucrePlus(lamp=True).restore(strobe_lit, view)
    named = "stretch-1-99"
    assert named in limits(result)
    default = np.nanmean((display(result.image, "black-0.5-white-99") - view.reference) ** 2)
    assert np.nanmean((display(result.image, named) - view.reference) ** 2) < 0.5 * default
    with shown_with(named):
        assert "veil" not in limits(SucrePlus(lamp=True).restore(strobe_lit, view))
