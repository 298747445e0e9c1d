"""What `describe` says of exposure: a survey with known gains of its views, in even light and in a strobe's."""

from dataclasses import replace

import numpy as np
import pytest
from support.made_ground import WATERS, make_survey

from sucre_bench import Arrays, Scene
from sucre_bench.programs.describe.exposure import Exposure, NoExposure, estimate_exposure
from sucre_bench.programs.describe.facts import look_at

GAINS = np.array([0.75, 1.2, 0.9, 1.0, 1.25, 0.7, 1.1, 0.85])


def exposure_of(scene: Scene, gains: np.ndarray | None = None) -> Exposure:
    views = list(scene)
    if gains is not None:
        views = [
            replace(view, pixels=Arrays(np.rint((view.rgb * gain).clip(0, 1) * 255) / 255, view.depth))
            for view, gain in zip(views, gains, strict=True)
        ]
    found = estimate_exposure([look_at(view, False) for view in views])
    assert isinstance(found, Exposure)
    return found


@pytest.mark.parametrize("water", ["coast", "green"])
def test_gains_of_views_are_found_without_a_water(water: str) -> None:
    scene = make_survey(WATERS[water], strobe=False, relief=0.1)
    found, even = exposure_of(scene, GAINS), exposure_of(scene)
    assert found.differs
    assert not found.falls_off
    assert found.gains == pytest.approx(GAINS / np.median(GAINS), rel=0.03)
    assert not even.differs
    assert even.gains == pytest.approx(np.ones(8), rel=0.02)


def test_the_falloff_of_a_strobe_is_no_difference_of_exposure() -> None:
    found = exposure_of(make_survey(WATERS["coast"]))
    assert found.falls_off
    assert not found.differs


def test_the_reason_why_an_exposure_is_not_known_is_data() -> None:
    first, second, *_ = make_survey(WATERS["coast"], strobe=False)
    elsewhere = first.cam_from_world.copy()
    elsewhere[0, 3] += 1000
    dark = [replace(view, pixels=Arrays(view.rgb * 0.01, view.depth)) for view in (first, second)]
    for views, why in (
        ([first], NoExposure.FEW_VIEWS),
        ([first, replace(second, cam_from_world=elsewhere)], NoExposure.NO_OVERLAP),
        (dark, NoExposure.UNLIKE),
    ):
        assert estimate_exposure([look_at(view, False) for view in views]) is why
