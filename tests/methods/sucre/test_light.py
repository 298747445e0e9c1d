"""Light that differs between views, on made ground whose light is known."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support.made_ground import SLOPE, WATERS, errors_of_water, make_ground, with_pictures
from support.made_observations import record_of

from sucre_bench import InputError, Restoration, Scene, Water
from sucre_bench.methods.sucre import Sucre
from sucre_bench.methods.sucre.light import Light, Parts, Problem, Sample, fit_light
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.observed import Observed, sampled
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe

# One model at a time; the judge has tests of its own.
sucre = partial(Sucre, footprint=True, physical=False, robust=False)
AIR = Water(np.zeros(3), np.zeros(3), np.zeros(3))
GAINS = (0.75, 1.2, 0.9, 1.0, 1.3, 0.7, 1.1)


def error_of_beta(result: Restoration) -> float:
    """The largest of the channels, as a share."""
    return float(np.abs(errors_of_water(result, WATERS["green"])[1]).max())


def error_of_rates(result: Restoration) -> float:
    """The larger one of attenuation and backscatter."""
    return float(np.abs(errors_of_water(result, WATERS["green"])[1:]).max())


def parts(result: Restoration) -> list[str]:
    return result.info["light"]["parts"] if "light" in result.info else []


@pytest.fixture(scope="module")
def plain() -> Scene:
    return make_ground(WATERS["green"], **SLOPE)


@pytest.fixture(scope="module")
def exposed() -> Scene:
    return make_ground(WATERS["green"], gains=GAINS, **SLOPE)


@pytest.fixture(scope="module")
def by_itself(exposed: Scene) -> Restoration:
    return sucre().restore(exposed, exposed["3.png"])


def test_gains_are_found_with_the_water(exposed: Scene, by_itself: Restoration) -> None:
    even = sucre(light="even").restore(exposed, exposed["3.png"])
    assert error_of_rates(even) > 0.2
    assert parts(by_itself) == ["exposure", "lens"]
    assert error_of_rates(by_itself) < 0.03
    assert by_itself.info["gains"]["3.png"] == 1
    for name, gain in by_itself.info["gains"].items():
        assert gain == pytest.approx(GAINS[int(name[0])] / GAINS[3], rel=0.01)
    assert any("exposure differs" in limit for limit in by_itself.info["limits"])


def test_shared_water_has_the_light_of_all_views_and_one_exposure_of_pictures(
    exposed: Scene, plain: Scene
) -> None:
    shared = [sucre(water="shared").restore(exposed, exposed[f"{k}.png"]) for k in (2, 5)]
    first = GAINS[0]  # the first view's light counts as 1
    for result, name in zip(shared, ("2.png", "5.png"), strict=True):
        assert parts(result) == ["exposure", "lens"]
        assert error_of_rates(result) < 0.03
        assert np.nanmedian(result.image / plain[name].reference) == pytest.approx(
            first, rel=0.02
        )


def test_white_balance_is_found_with_the_water(plain: Scene) -> None:
    balance = np.exp(0.05 * np.random.default_rng(0).normal(size=(7, 1, 1, 3)))
    balance /= balance[3]
    scene = with_pictures(plain, lambda k, rgb: rgb * balance[k])
    result = sucre().restore(scene, scene["3.png"])
    assert parts(result) == ["white_balance", "lens"]
    even = sucre(light="even").restore(scene, scene["3.png"])
    error, error_in_even_light = (error_of_beta(one) for one in (result, even))
    assert error < 0.05 < error_in_even_light
    for name, gains in result.info["gains"].items():
        np.testing.assert_allclose(gains, balance[int(name[0]), 0, 0], rtol=0.05)


def test_vignetting_is_found_with_the_water(plain: Scene) -> None:
    y, x = np.mgrid[-1:1:120j, -1:1:160j]
    lens = 1 - 0.25 * (x * x + y * y)[..., None] / 2
    scene = with_pictures(plain, lambda _, rgb: rgb * lens)
    even, result = (
        sucre(light=light).restore(scene, scene["3.png"]) for light in ("even", "auto")
    )
    assert parts(result) == ["lens"]
    assert result.info["light"]["least"] == pytest.approx(
        1 - 0.125 * (0.7**2 + (0.7 / 0.75) ** 2), abs=0.02
    )
    wrong = [error_of_beta(one) for one in (even, result)]
    assert wrong[1] < 0.5 * wrong[0]
    truth = scene["3.png"].reference
    errors = [np.sqrt(np.nanmean((one.image - truth) ** 2)) for one in (even, result)]
    assert errors[1] < 0.7 * errors[0]


def test_light_that_does_not_differ_changes_no_water(plain: Scene) -> None:
    even, free = (
        sucre(light=light).restore(plain, plain["3.png"])
        for light in ("even", "white_balance+lens")
    )
    np.testing.assert_allclose(list(free.info["gains"].values()), 1, atol=2e-3)
    np.testing.assert_allclose(free.water.attenuation, even.water.attenuation, rtol=5e-3)


def test_photographs_in_air_whose_exposure_varies_get_no_water() -> None:
    scene = make_ground(AIR, gains=(0.8, 1.2, 0.95, 1.3, 0.85, 1.1), width=80, height=60)
    even, found = (
        one.restore(scene, scene["3.png"]) for one in (sucre(light="even"), Sucre(robust=False))
    )
    assert even.water.attenuation.max() > 0.05
    assert found.water.attenuation.max() < 5e-3  # 1/m, at a median distance of 3 m


def test_photographs_that_a_lamp_explains_alone_stay_as_they_are() -> None:
    y, x = np.mgrid[-1:1:60j, -1:1:80j]
    scene = make_ground(AIR, **{**SLOPE, "width": 80, "height": 60})
    lamp = 1 - 0.25 * (x * x + y * y)[..., None]
    lit = with_pictures(scene, lambda _, rgb: rgb * lamp)
    found = sucre().restore(lit, lit["3.png"])
    best = found.info["judged"][0]
    assert ("lens" in best["model"], best["held_out"] < 0.9) == (True, True)
    assert found.info["solver"] == "none"


# -- the fit -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def matched(exposed: Scene) -> Observations:
    found = Observed.of(sucre(), exposed, exposed["3.png"]).matched
    assert found is not None
    return found


@pytest.mark.parametrize("which", [Parts(1, lens=True), Parts(3), Parts(3, lens=True)])
def test_derivatives_are_those_of_finite_differences(
    matched: Observations, which: Parts
) -> None:
    problem = Problem(Sample.of(sampled(matched, 60, singles=False, seed=0), "3.png"), which)
    rng = np.random.default_rng(0)
    u = np.concatenate([np.tile([0.3, 0.2, 0.3], 3), rng.normal(0, 0.1, problem.size - 9)])
    system = problem.system(u)
    beside = [
        (problem.system(u - step), problem.system(u + step))
        for step in 1e-6 * np.eye(problem.size)
    ]
    slope = np.array([lower.cost[0] - higher.cost[0] for lower, higher in beside]) / 4e-6
    second = np.array([lower.g[0] - higher.g[0] for lower, higher in beside]) / 2e-6
    free = np.diag(system.H[0]) > 0
    assert free.sum() == problem.size - which.gains  # the target's gains are held
    np.testing.assert_allclose(system.g[0][free], slope[free], rtol=1e-4, atol=1e-6)
    both = np.ix_(free, free)
    np.testing.assert_allclose(system.K[0][both], second[both], rtol=1e-4, atol=1e-5)


def test_a_view_whose_light_is_not_known_takes_no_part(exposed: Scene) -> None:
    view = exposed["3.png"]
    seen = observe(view, exposed.views, with_view=True, with_ray=True)
    water = WaterParameters.of_channels(np.full((3, 3), 0.2))
    even = Light.of_gains({name: 1.0 for name in seen.views if name != "4.png"}, water).removed(
        seen
    )
    assert even.view is not None
    unknown = even.view == even.views.index("4.png")
    assert unknown.any()
    assert (even.weight[:, unknown] == 0).all()
    assert (even.weight[:, ~unknown] == 1).all()


# -- water that was fitted with light, used elsewhere --------------------------------------------------------


def test_water_that_was_fitted_with_gains_is_used_with_them(exposed: Scene, tmp_path: Path):
    by_itself = sucre(light="exposure").restore(exposed, exposed["3.png"])
    record = record_of(by_itself.water) | {
        name: by_itself.info[name] for name in ("gains", "light")
    }
    file = tmp_path / "3.json"
    file.write_text(json.dumps(record))
    for name in ("3.png", "1.png"):
        own = (
            by_itself
            if name == "3.png"
            else sucre(light="exposure").restore(exposed, exposed[name])
        )
        given = sucre(water=str(file)).restore(exposed, exposed[name])
        assert np.sqrt(np.nanmean((given.image - own.image) ** 2)) < 0.02
    file.write_text(json.dumps(record | {"gains": {"1.png": 1.0}}))
    with pytest.raises(InputError, match=r"3\.json.*3\.png"):
        sucre(water=str(file)).restore(exposed, exposed["3.png"])
    file.write_text(json.dumps(record | {"light": {"parts": ["lens"]}}))
    with pytest.raises(InputError, match="light"):
        sucre(water=str(file)).restore(exposed, exposed["3.png"])


@pytest.mark.parametrize("gain", [True, -1.0, "1", [1.0, 2.0], [1.0, 1.0, 0.0]])
def test_gains_of_views_that_are_no_positive_numbers_are_refused(
    plain: Scene, tmp_path: Path, gain: object
) -> None:
    record = record_of(WATERS["green"]) | {"gains": {"3.png": gain}}
    (tmp_path / "3.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"3\.json: gains"):
        sucre(water=str(tmp_path / "3.json")).restore(plain, plain["3.png"])


@pytest.mark.parametrize(
    "options",
    [
        {"light": "lens", "water": "truth"},
        {"light": "strobe"},
        {"light": "lamp"},
        {"light": "lens+"},
    ],
)
def test_options_that_do_not_go_with_light_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match="light"):
        Sucre(**options)


def test_an_error_at_one_place_of_all_images_makes_the_water_less_certain() -> None:
    """What a lens leaves unexplained is no noise: more pixels do not average it away."""
    rng = np.random.default_rng(0)
    z, J = rng.uniform(1, 4, (600, 8)), rng.uniform(0.2, 0.8, (3, 600, 1))
    ray = rng.uniform(-0.5, 0.5, (2, 600, 8))
    water = WaterParameters.of_channels(np.tile([0.2, 0.3, 0.4], (3, 1)))
    I = J * np.exp(-0.3 * z) + 0.2 * (1 - np.exp(-0.4 * z))
    of_place = 0.02 * np.sign(np.sin(12 * ray[0])) * np.ones_like(I)
    errors = [
        fit_light(
            Sample(
                z,
                I + noise,
                np.ones_like(I),
                ray,
                tuple("abcdefgh"),
                0,
                rng.integers(0, 6, (2, 600)),
            ),
            Parts(1, lens=True),
            Light.even(water, tuple("abcdefgh")),
        ).error
        for noise in (of_place, 0.02 * rng.standard_normal(I.shape))
    ]
    assert (errors[0] > 2 * errors[1])[:, 1].all()
