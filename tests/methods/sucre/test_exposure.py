"""One gain a view, on ground of white noise photographed with known exposures."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.command_line import registry
from support.made_ground import WATERS, make_ground
from support.made_observations import made

from sucre_bench import InputError, Restoration, Scene, Water
from sucre_bench.methods.sucre import Sucre, SucrePlus
from sucre_bench.methods.sucre.apply_gains import AtOneExposure
from sucre_bench.methods.sucre.exposure import estimate
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.multiview.observations import Observations, Seen, arrange
from sucre_bench.multiview.observe import observe
from sucre_bench.plugins.registry import using

GAINS = (0.75, 1.2, 0.9, 1.0, 1.3, 0.7, 1.1)
GROUND = {"width": 160, "height": 120, "heights_m": (1.5, 2.0, 2.7, 3.6, 4.8, 6.4, 8.5), "tilt_deg": 30.0, "seed": 3}


def rates(result: Restoration, truth: Water) -> np.ndarray:
    """Relative errors of beta and gamma, (2, 3)."""
    assert result.water is not None
    found = result.water
    return np.array([found.attenuation / truth.attenuation, found.backscatter / truth.backscatter]) - 1


@pytest.fixture(scope="module")
def scene() -> Scene:
    return make_ground(WATERS["green"], gains=GAINS, **GROUND)


@pytest.fixture(scope="module")
def per_view(scene: Scene) -> Restoration:
    return Sucre(exposure="per_view", robust=False).restore(scene, scene["3.png"])


@pytest.fixture(scope="module")
def by_itself(scene: Scene) -> Restoration:
    return Sucre().restore(scene, scene["3.png"])


def test_gains_are_found_with_the_water(scene: Scene, per_view: Restoration) -> None:
    constant, truth = Sucre(exposure="constant").restore(scene, scene["3.png"]), WATERS["green"]
    assert np.abs(rates(constant, truth)).max() > 0.2
    assert np.abs(rates(per_view, truth)).max() < 0.03
    gains = per_view.info["gains"]
    expected = {f"{k}.png": gain / GAINS[3] for k, gain in enumerate(GAINS)}
    assert gains["3.png"] == 1
    for name, gain in gains.items():
        assert gain == pytest.approx(expected[name], rel=0.01)


def test_gains_are_fitted_by_themselves_also_for_colours_of_a_single_view(scene: Scene, by_itself: Restoration) -> None:
    for result in (by_itself, Sucre(colours="single_view").restore(scene, scene["3.png"])):
        assert np.abs(rates(result, WATERS["green"])).max() < 0.03


def test_gains_of_a_camera_that_exposes_dark_views_longer_are_fitted_by_themselves() -> None:
    """Such gains hide attenuation, where others add to it."""
    longer = make_ground(WATERS["coast"], gains=(0.85, 0.9, 0.95, 1.0, 1.1, 1.2, 1.3), **GROUND)
    constant, auto = (Sucre(exposure=e).restore(longer, longer["3.png"]) for e in ("constant", "auto"))  # type: ignore[arg-type]
    assert rates(constant, WATERS["coast"])[0].mean() < -0.1  # beta is too low
    assert np.abs(rates(auto, WATERS["coast"])).max() < 0.08
    assert min(auto.info["gains"].values()) == pytest.approx(0.85, rel=0.02)


def test_differing_exposures_are_reported_and_equal_ones_are_not(by_itself: Restoration) -> None:
    even = make_ground(WATERS["green"], **GROUND)
    of_even = Sucre().restore(even, even["3.png"])
    said = [any("exposure" in limit for limit in result.info["limits"]) for result in (by_itself, of_even)]
    assert said == [True, False]


def test_views_of_one_distance_each_cannot_tell_gains_from_attenuation() -> None:
    """The same pixels, each view all at one distance: a gain and exp(-beta z) act alike."""
    rng = np.random.default_rng(0)
    J, pixels = rng.uniform(0.1, 0.9, (800, 3)), np.arange(800)
    seen = []
    for k, z in enumerate((2.0, 3.0, 4.5, 6.0)):
        I = J * np.exp(-0.2 * z) + 0.3 * (1 - np.exp(-0.2 * z)) + 0.004 * rng.standard_normal(J.shape)  # noqa: E741
        seen.append(Seen(f"{k}", pixels, np.full(800, z, np.float32), I.astype(np.float32)))
    start = WaterParameters.of_channels(np.full((3, 3), 0.2))
    found = estimate(arrange((1, 800), seen, with_view=True), "0", start)
    assert not found.is_separable
    wide, _ = made(800, noise=0.004)
    assert estimate(with_views(wide), "0.png", start).is_separable


def test_more_views_than_a_sample_has_all_take_part() -> None:
    """The sample of matched footprints reads 32 views; the others have gains all the same."""
    gains = tuple(np.random.default_rng(0).uniform(0.7, 1.3, 35).tolist())
    heights = tuple(np.linspace(2.0, 6.0, 35).tolist())
    many = make_ground(WATERS["green"], gains=gains, heights_m=heights, tilt_deg=15.0, width=36, height=27)
    target = many["34.png"]
    result = Sucre(exposure="per_view").restore(many, target)
    found = result.info["gains"]
    assert len(found) == 35
    for name, gain in found.items():
        assert gain == pytest.approx(gains[int(name[:-4])] / gains[34], rel=0.05)
    assert result.info["n_observations"] == len(observe(target, many.views))


def test_a_view_without_a_common_pixel_is_named() -> None:
    apart = [Seen("far.png", np.arange(200, 260), np.full(60, 3, np.float32), np.full((60, 3), 0.4, np.float32))]
    J, pixels, seen = np.random.default_rng(0).uniform(0.1, 0.9, (200, 3)), np.arange(200), []
    for name, gain in (("a.png", 1.0), ("b.png", 0.8), ("c.png", 1.3)):
        seen.append(Seen(name, pixels, np.full(200, 2, np.float32), (gain * J).astype(np.float32)))
    observations = arrange((1, 260), [*seen, *apart], with_view=True)
    air = WaterParameters.of_channels(np.zeros((3, 3)))
    even = AtOneExposure.of(observations, {"a.png": 1.0, "b.png": 0.8}, air, "a.png")
    assert even.gains["c.png"] == pytest.approx(1.3, rel=1e-3)
    assert even.unknown == ("far.png",)
    assert "far.png" in even.limits[0]


def test_water_that_was_fitted_with_gains_is_used_with_them(
    scene: Scene, per_view: Restoration, tmp_path: Path
) -> None:
    record = {name: per_view.info[name] for name in ("gains", "gains_separable")}
    water = per_view.water
    assert water is not None
    record |= {
        "B": water.veiling_light.tolist(),
        "beta": water.attenuation.tolist(),
        "gamma": water.backscatter.tolist(),
    }
    file = tmp_path / "3.json"
    file.write_text(json.dumps(record))
    for name in ("3.png", next(name for name in per_view.info["gains"] if name != "3.png")):
        own = per_view if name == "3.png" else Sucre(exposure="per_view", robust=False).restore(scene, scene[name])
        given = Sucre(water=str(file)).restore(scene, scene[name])
        assert np.sqrt(np.nanmean((given.image - own.image) ** 2)) < 0.01
    by_name = Sucre(water="sucre_plus").restore(scene, scene["3.png"])
    assert np.abs(rates(by_name, WATERS["green"])).max() < 0.03
    assert np.sqrt(np.nanmean((by_name.image - per_view.image) ** 2)) < 0.01
    file.write_text(json.dumps(record | {"gains": {"1.png": 1.0}}))
    with pytest.raises(InputError, match=r"3\.json.*3\.png"):
        Sucre(water=str(file)).restore(scene, scene["3.png"])
    file.write_text(json.dumps(record | {"lamp": {"found": True}}))
    with pytest.raises(InputError, match="lamp"):
        Sucre(water=str(file)).restore(scene, scene["3.png"])


FOREIGN = """
from dataclasses import dataclass
import numpy as np
import sucre_bench as sb

@sb.method()
@dataclass(frozen=True)
class Foreign:
    def restore(self, scene, view):
        return sb.Restoration(view.rgb, scene.water, info={"gains": GAINS})
"""


@pytest.mark.parametrize("gains", ["[1.2, 1.0, 0.8]", "{'red': 1.2}", "np.ones(3)"])
def test_water_of_a_method_that_calls_something_else_gains_is_used(scene: Scene, tmp_path: Path, gains: str) -> None:
    told = Sucre(water="truth").restore(scene, scene["3.png"])
    np.testing.assert_array_equal(by_foreign(scene, tmp_path, gains).image, told.image)


def test_gains_may_be_numbers_of_numpy(scene: Scene, tmp_path: Path) -> None:
    known, usual = (by_foreign(scene, tmp_path, f"{{'3.png': {one}}}") for one in ("np.float32(1)", "1.0"))
    np.testing.assert_array_equal(known.image, usual.image)


def by_foreign(scene: Scene, folder: Path, gains: str) -> Restoration:
    file = folder / f"foreign_{len(list(folder.iterdir()))}.py"
    file.write_text(FOREIGN.replace("GAINS", gains))
    with using(registry(file)):
        return Sucre(water="foreign").restore(scene, scene["3.png"])


@pytest.mark.parametrize("gain", [True, 0.0, -1.0, "1"])
def test_gains_of_views_that_are_no_positive_numbers_are_refused(scene: Scene, tmp_path: Path, gain: object) -> None:
    record = {"B": [0.1, 0.2, 0.3], "beta": [0.3] * 3, "gamma": [0.3] * 3, "gains": {"3.png": gain}}
    (tmp_path / "3.json").write_text(json.dumps(record))
    with pytest.raises(InputError, match=r"3\.json: gains"):
        Sucre(water=str(tmp_path / "3.json")).restore(scene, scene["3.png"])


def with_views(observations: Observations) -> Observations:
    """The observations as if each slot were a view."""
    view = np.concatenate([np.full(n, k) for k, (n, _) in enumerate(observations.slots())]).astype(np.uint16)
    return replace(observations, view=view)


@pytest.mark.parametrize(
    "options", [{"lamp": True}, {"solver": "adam"}, {"water": "truth"}, {"colours": "single_view"}]
)
def test_options_that_explain_the_same_are_refused(options: dict[str, object]) -> None:
    with pytest.raises(InputError, match="exposure"):
        Sucre(exposure="per_view", **options)  # type: ignore[arg-type]


def test_photographs_in_air_whose_exposure_varies_get_no_water() -> None:
    air = Water(np.zeros(3), np.zeros(3), np.zeros(3))
    scene = make_ground(air, gains=(0.8, 1.2, 0.95, 1.3, 0.85, 1.1), width=80, height=60)
    constant, found = (Sucre(exposure=exposure).restore(scene, scene["3.png"]) for exposure in ("constant", "auto"))
    assert constant.water.attenuation.max() > 0.05
    assert found.water.attenuation.max() < 3e-3  # 1/m, at a median distance of 3 m
    assert found.info["gains_separable"]


def test_two_waters_over_flat_ground_leave_the_photograph_as_it_is() -> None:
    heights = (2.95, 3.02, 3.08, 2.93, 3.05, 2.98)
    coast, green = (make_ground(WATERS[name], heights_m=heights, width=80, height=60) for name in ("coast", "green"))
    views = [(coast if k < 3 else green).views[k] for k in range(6)]
    scene = replace(coast, views=views, water=None)
    for method in (Sucre(), SucrePlus()):
        restored = method.restore(scene, scene["3.png"])
        assert restored.info["solver"] == "none"
        assert restored.info["limits"]
        np.testing.assert_array_equal(restored.image[restored.valid], scene["3.png"].rgb[restored.valid])
