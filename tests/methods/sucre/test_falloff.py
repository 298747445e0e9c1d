"""A survey of flat ground in the light of a strobe on the vehicle, against the same survey in even light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.made_ground import WATERS, make_ground, make_survey

from sucre_bench import Arrays, Restoration, Scene, Water
from sucre_bench.imaging.display import display
from sucre_bench.methods.sucre import Sucre, SucrePlus
from sucre_bench.plugins.call_method import shown_with

CORNER, MIDDLE = np.s_[2:10, 2:14], np.s_[16:32, 22:42]
SIZE = {"width": 64, "height": 48}


@pytest.fixture(scope="module")
def strobe_lit() -> Scene:
    return make_survey(WATERS["coast"], **SIZE)


@pytest.fixture(scope="module")
def evenly_lit() -> Scene:
    """Ground so flat that no distances tell the veil."""
    return make_survey(WATERS["coast"], strobe=False, relief=0.005, **SIZE)


def shown_error(image: np.ndarray, scene: Scene, how: str = "stretch-1-99") -> float:
    """Root mean square error of the displayed picture of view 4."""
    return float(np.sqrt(np.nanmean((display(image, how) - scene["4.png"].reference) ** 2)))


def light_in_the_corner(image: np.ndarray) -> float:
    """Brightness of a corner, where the strobe leaves half of its light, over that of the middle."""
    return float(np.mean(image[CORNER]) / np.mean(image[MIDDLE]))


def limits(result: Restoration) -> str:
    return "; ".join(result.info["limits"])


def test_without_a_lamp_the_water_of_a_strobe_lit_survey_is_said_to_be_wrong(strobe_lit: Scene) -> None:
    result = Sucre(lamp=False).restore(strobe_lit, strobe_lit["4.png"])
    assert "lamp=auto" in limits(result)
    assert "exposure=per_view" not in limits(result)
    found = result.info["falloff"]
    assert 0.2 < found["least"] < 0.6  # the lobe and the square of the way leave .37 in the corners
    assert found["noise"] < 0.3 * found["noise_without"]
    assert found["removed_by"] == "none"


@pytest.mark.parametrize(("daylight", "waters"), [(0.3, "coast"), (0.0, "red tide")])
def test_the_light_of_a_strobe_is_removed_from_the_picture(daylight: float, waters: str) -> None:
    scene = make_survey(WATERS[waters], daylight=daylight, **SIZE)
    view = scene["4.png"]  # of "red tide" a third is overexposed
    result = SucrePlus().restore(scene, view)
    assert result.info["falloff"]["removed_by"] in ("lamp", "place")
    assert ("too high" in limits(result)) is (result.info["falloff"]["removed_by"] == "lamp")
    assert result.valid.mean() > 0.99
    assert shown_error(result.image, scene, "black-0.5-white-99") < 0.7 * shown_error(view.rgb, scene)


def test_the_light_is_removed_with_other_options_of_the_fit(strobe_lit: Scene) -> None:
    view = strobe_lit["4.png"]
    result = Sucre(robust=True, exposure="per_view").restore(strobe_lit, view)
    assert result.info["falloff"]["removed_by"] in ("lamp", "place")
    assert shown_error(result.image, strobe_lit) < 0.7 * shown_error(view.rgb, strobe_lit)


@pytest.mark.parametrize("strobe", [True, False])
def test_a_fit_to_single_pixels_says_that_the_light_falls_off(
    strobe_lit: Scene, evenly_lit: Scene, strobe: bool
) -> None:
    scene = strobe_lit if strobe else evenly_lit
    result = Sucre(footprint=False).restore(scene, scene["4.png"])
    assert ("footprint=true" in limits(result)) is strobe
    assert ("falloff" in result.info) is strobe


def test_pixels_without_depth_are_filled_in_the_same_light(strobe_lit: Scene) -> None:
    view = strobe_lit["4.png"]
    depth = view.depth.copy()
    depth[:11, :16] = 0
    holes = replace(view, pixels=Arrays(view.rgb, depth))
    scene = replace(strobe_lit, views=[holes if one.name == view.name else one for one in strobe_lit.views])
    result = Sucre(fill=True).restore(scene, holes)
    assert result.info["falloff"]["removed_by"] == "place"
    assert result.filled is not None
    found = light_in_the_corner(np.where(result.valid[..., None], result.image, result.filled))
    with_depth = Sucre().restore(strobe_lit, view).image
    assert found == pytest.approx(light_in_the_corner(with_depth), rel=0.1)
    assert found == pytest.approx(light_in_the_corner(view.reference), rel=0.25)  # 0.34 in the light of the strobe


@pytest.mark.parametrize("gains", [None, (0.8, 1.2, 0.95, 1.3, 0.85, 1.1)])
def test_even_light_has_no_falloff_whatever_the_exposure(gains: tuple[float, ...] | None) -> None:
    scene = make_ground(WATERS["green"], gains=gains, width=80, height=60)
    result = Sucre(exposure="constant").restore(scene, scene["3.png"])
    assert "falloff" not in result.info
    assert "falls off" not in limits(result)


@pytest.fixture(scope="module")
def in_the_light_of_a_lamp(strobe_lit: Scene) -> Restoration:
    return SucrePlus(lamp=True).restore(strobe_lit, strobe_lit["4.png"])


def test_the_light_of_a_strobe_is_removed_as_that_of_a_chosen_lamp(strobe_lit: Scene) -> None:
    view = strobe_lit["4.png"]
    result = Sucre(lamp=True).restore(strobe_lit, view)
    assert result.info["lamp"]["found"] is True
    assert "too high" in limits(result)
    assert shown_error(result.image, strobe_lit) < 0.7 * shown_error(view.rgb, strobe_lit)
    shown = display(result.image, "stretch-1-99")
    assert light_in_the_corner(shown) > 0.65 * light_in_the_corner(view.reference)  # 0.15 in the photograph


def test_a_lamp_over_flat_ground_says_what_distances_leave_open(
    strobe_lit: Scene, in_the_light_of_a_lamp: Restoration
) -> None:
    assert "too high" in limits(in_the_light_of_a_lamp)
    assert in_the_light_of_a_lamp.water is not None
    excess = in_the_light_of_a_lamp.water.attenuation - WATERS["coast"].attenuation
    assert (excess < 1.2 / np.median(strobe_lit["4.png"].distance)).all()
    assert excess.max() > 0.1  # so it has to be said


def test_a_veil_that_the_light_hides_is_no_part_of_the_picture(
    strobe_lit: Scene, in_the_light_of_a_lamp: Restoration
) -> None:
    result, photograph = in_the_light_of_a_lamp, strobe_lit["4.png"].rgb
    assert "darkest" in limits(result)
    assert result.water is not None
    assert np.isnan(result.water.veiling_light).all()
    assert shown_error(result.image, strobe_lit, "black-0.5-white-99") < 0.7 * shown_error(photograph, strobe_lit)


def test_even_light_is_left_as_it_is_and_a_veil_in_the_colours_is_said_where_one_black_would_show_it(
    evenly_lit: Scene,
) -> None:
    found = SucrePlus().restore(evenly_lit, evenly_lit["4.png"])
    assert "falloff" not in found.info
    named = "stretch-1-99"
    assert named in limits(found)
    with shown_with(named):
        as_it_is = SucrePlus(lamp=False).restore(evenly_lit, evenly_lit["4.png"])
    assert "display" not in limits(as_it_is)
    np.testing.assert_array_equal(as_it_is.image, found.image)


def test_in_air_no_veil_stays_in_the_colours() -> None:
    scene = make_ground(Water(np.zeros(3), np.zeros(3), np.zeros(3)), width=80, height=60)
    assert "stretch-1-99" not in limits(SucrePlus().restore(scene, scene["3.png"]))
