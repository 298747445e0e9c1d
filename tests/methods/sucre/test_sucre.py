"""The restorer `sucre` as a user meets it: its options, its errors, and what it returns."""

import json
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.made_observations import ONE_MODEL, parameters, record_of, table
from support.made_scene import WATER, make_camera, make_pose, make_scene, make_view
from support.messages import names, refused

from sucre_bench import Arrays, InputError, Restoration, SolveError, Water
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.sucre import Sucre, SucrePlus
from sucre_bench.methods.sucre.observed import Dive
from sucre_bench.methods.sucre.refine_noise import prior_of, specks_of
from sucre_bench.plugins import find
from sucre_bench.plugins.options import Choice, create

sucre = partial(Sucre, **ONE_MODEL)
SCENE = make_scene()
TARGET = SCENE["a.png"]
TRUTH = table(parameters(WATER))
RECORD = record_of(WATER)


def rows_of(water: Water) -> np.ndarray:
    return table(parameters(water))


@pytest.fixture(scope="module")
def plain() -> Restoration:
    return sucre().restore(SCENE, TARGET)


def test_the_image_is_the_scene_without_water_where_there_is_depth() -> None:
    dry = make_scene_without_water()
    result = sucre().restore(SCENE, TARGET)
    assert np.array_equal(result.valid, TARGET.depth > 0)
    error = (result.image - dry)[result.valid]
    assert np.sqrt(np.mean(error**2)) < 0.03
    assert np.array_equal(np.isfinite(result.confidence), result.valid)


def make_scene_without_water() -> np.ndarray:
    return make_view("a.png", make_camera(60, 44, 56), make_pose((0, 0, 0)), water=None).rgb


# -- water from elsewhere ----------------------------------------------------------------------------------


def test_the_true_water_is_taken_as_it_is() -> None:
    result = Sucre(water="truth").restore(SCENE, TARGET)
    np.testing.assert_array_equal(rows_of(result.water), TRUTH)
    nowhere = replace(SCENE, water=None)
    with pytest.raises(InputError, match=r"water=truth: .*'made'"):
        Sucre(water="truth").restore(nowhere, TARGET)


def test_the_true_water_is_not_taken_for_that_of_linear_light() -> None:
    with pytest.raises(InputError, match=r"water=truth: .*gamma.* linear"):
        Sucre(water="truth", encoding="linear").restore(SCENE, TARGET)


def test_water_comes_from_a_file_or_from_a_folder_of_them(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text(json.dumps(RECORD))
    np.savez(tmp_path / "one.npz", **RECORD)
    true = Sucre(water="truth").restore(SCENE, TARGET)
    dotted = replace(TARGET, name="left/a.0001.png")
    (tmp_path / "left").mkdir()
    (tmp_path / "left" / "a.0001.json").write_text(json.dumps(RECORD))
    # another image's
    (tmp_path / "left" / "a.json").write_text(json.dumps(RECORD | {"B": [0, 0, 0]}))
    scene = replace(
        SCENE, views=[dotted, *(view for view in SCENE.views if view is not TARGET)]
    )
    np.testing.assert_array_equal(
        Sucre(water=str(tmp_path)).restore(scene, dotted).water.veiling_light, TRUTH[0]
    )
    for source in (tmp_path / "a.json", tmp_path / "one.npz", tmp_path):
        np.testing.assert_array_equal(
            Sucre(water=str(source)).restore(SCENE, TARGET).image, true.image
        )


@pytest.mark.parametrize("source", ["", "reef", "reef/a.json"])
def test_water_comes_from_the_records_of_a_run(tmp_path: Path, source: str) -> None:
    """Of all views, of a scene's, and of one view."""
    folder, scene = tmp_path / "restored" / "sea" / "other", replace(SCENE, name="reef")
    (folder / "reef").mkdir(parents=True)
    record = folder / "reef" / "a.json"
    record.write_text(json.dumps(RECORD))
    options = {"water": str(folder / source)}
    restored = create(find("method", "sucre"), options).restore(scene, TARGET)
    np.testing.assert_array_equal(rows_of(restored.water), TRUTH)
    _, files = Choice(find("method", "sucre"), "sucre", options).rests_on
    assert record in {inside for file in files for inside in (file, *file.rglob("*"))}
    with pytest.raises(InputError, match=r"b\.json: no such file"):
        create(find("method", "sucre"), {"water": str(folder / "reef" / "b.json")})


@pytest.mark.parametrize(
    ("name", "content", "named"),
    [
        (
            "huge.json",
            '{"B": [1e300, 0, 0], "beta": [1, 1, 1], "gamma": [1, 1, 1]}',
            {"B", "intensity"},
        ),
        (
            "rate.json",
            '{"B": [0, 0, 0], "beta": [1000, 1, 1], "gamma": [1, 1, 1]}',
            {"B", "intensity"},
        ),
        (
            "grows.json",
            '{"B": [0, 0, 0], "beta": [-5, 1, 1], "gamma": [1, 1, 1]}',
            {"beta", "rates"},
        ),
        (
            "linear.json",
            '{"B": [0, 0, 0], "beta": [1, 1, 1], "gamma": [1, 1, 1], "encoding": "linear"}',
            {"linear", "gamma", "method.encoding=linear"},
        ),
        ("absent.json", None, {"own", "shared", "truth"}),
        ("cut.json", '{"B": [1, 2', {"B", "beta", "gamma", "three"}),
        (
            "two.json",
            '{"B": [1, 2, 3], "beta": [1, 2, 3]}',
            {"B", "beta", "gamma", "finite", "three"},
        ),
        ("short.json", '{"B": [1], "beta": [1], "gamma": [1]}', {"B", "three"}),
        (
            "nan.json",
            '{"B": [1, 2, NaN], "beta": [1, 2, 3], "gamma": [1, 2, 3]}',
            {"B", "finite", "three"},
        ),
        (
            "words.json",
            '{"B": "blue", "beta": [1, 2, 3], "gamma": [1, 2, 3]}',
            {"B", "three"},
        ),
        ("junk.npz", "no archive", {"B", "beta", "gamma", "three"}),
    ],
)
def test_a_file_without_water_is_named_with_its_fault(
    tmp_path: Path, name: str, content: str | None, named: set[str]
):
    if content is not None:
        (tmp_path / name).write_text(content)
    with refused(str(tmp_path / name), *named):
        Sucre(water=str(tmp_path / name)).restore(SCENE, TARGET)


def test_water_comes_from_another_method_and_colours_from_all_views() -> None:
    """The ablation's middle row: one method's water, SUCRe's colours."""
    theirs = Sucre().restore(SCENE, TARGET)
    plus = Sucre(water="sucre_plus").restore(SCENE, TARGET)
    np.testing.assert_array_equal(rows_of(plus.water), rows_of(theirs.water))
    # the paper's steps stop a little before the colours of their water
    np.testing.assert_allclose(plus.image, theirs.image, atol=0.01)


@pytest.mark.parametrize(
    ("name", "named"),
    [
        ("gray_world", {"method.water=gray_world", "B", "beta", "gamma"}),
        ("haze_lines", {"method.water=haze_lines", "beta", "gamma"}),
        ("precomputed", {"method.water=precomputed", "options", "method.water=FOLDER"}),
        ("grey_world", {"method", "grey_world", "'gray_world'"}),
    ],
)
def test_a_method_that_has_no_water_to_give_is_refused(name: str, named: set[str]) -> None:
    with pytest.raises(InputError) as fault:
        Sucre(water=name).restore(SCENE, TARGET)
    assert named <= names(fault.value)
    assert name != "haze_lines" or "B" not in names(fault.value)  # which it estimates


def test_single_view_colours_are_the_model_inverted_on_the_images_own_intensities(
    plain: Restoration,
) -> None:
    """J = (I - B (1 - exp(-gamma z))) exp(beta z), with the water of all views: the paper's eq. 3 on one image."""
    single = sucre(colours="single_view").restore(SCENE, TARGET)
    water = rows_of(plain.water)
    np.testing.assert_array_equal(rows_of(single.water), water)
    z = TARGET.distance[..., None]
    J = (TARGET.rgb - water[0] * (1 - np.exp(-water[2] * z))) * np.exp(water[1] * z)
    seen = TARGET.depth > 0
    np.testing.assert_allclose(single.image[seen], J[seen], atol=2e-5)
    assert np.isnan(single.image[~seen]).all()
    # one observation tells less than several
    assert np.nanmean(single.confidence) > 1.2 * np.nanmean(plain.confidence)


def test_shared_water_is_fitted_once_and_the_same_for_every_view(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    calls = []
    whole = Dive.spread
    monkeypatch.setattr(Dive, "spread", lambda *a: calls.append(1) or whole(*a))
    scene = replace(SCENE)
    waters = [rows_of(sucre(water="shared").restore(scene, view).water) for view in scene.views]
    assert len(calls) == 1
    assert all(np.array_equal(water, waters[0]) for water in waters)
    assert not np.array_equal(rows_of(sucre().restore(scene, TARGET).water), waters[0])


# -- encoding ----------------------------------------------------------------------------------------------


def test_linear_encoding_finds_water_that_acts_on_linear_light(plain: Restoration) -> None:
    """The made scene's intensities are light here, and stored gamma-encoded as a camera's are."""
    views = [
        replace(v, pixels=Arrays(np.rint(srgb_encode(v.rgb) * 65535) / 65535, v.depth))
        for v in SCENE.views
    ]
    scene = replace(SCENE, views=views)
    linear, as_stored = (
        sucre(encoding=e).restore(scene, scene["a.png"]) for e in ("linear", "view")
    )
    dry = make_scene_without_water()
    errors = [
        np.sqrt(np.mean((srgb_decode(r.image) - dry)[r.valid] ** 2))
        for r in (linear, as_stored)
    ]
    assert errors[0] < 0.6 * errors[1]
    np.testing.assert_allclose(rows_of(linear.water), rows_of(plain.water), rtol=0.05)
    np.testing.assert_allclose(
        srgb_decode(linear.image)[linear.valid], plain.image[plain.valid], atol=0.02
    )


def test_views_that_are_linear_already_are_not_decoded_again() -> None:
    scene = replace(SCENE, views=[replace(v, encoding="linear") for v in SCENE.views])
    once, never = (sucre(encoding=e).restore(scene, scene["a.png"]) for e in ("linear", "view"))
    np.testing.assert_array_equal(once.image, never.image)


# -- colours -----------------------------------------------------------------------------------------------


def coloured_surfaces(rng: np.random.Generator, n: int) -> np.ndarray:
    """Reflectances (3, n) that spread by a quarter around one colour, each at a brightness of its own."""
    brightness = rng.normal(0.5, 0.15, n).clip(0.02)
    return np.array([1.1, 1.0, 0.9])[
        :, None
    ] * brightness + 0.25 * brightness * rng.standard_normal((3, n))


def shrunk_to_the_mean(J: np.ndarray, deviation: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    J, deviation = J.astype(np.float32), deviation.astype(np.float32)
    prior = prior_of(J, deviation)
    return prior.posterior(J, deviation)


def test_the_prior_halves_the_error_of_noisy_colours_and_says_how_much_is_left() -> None:
    rng = np.random.default_rng(0)
    truth = coloured_surfaces(rng, 40_000)
    deviation = (
        np.where(rng.random(truth.shape[1]) < 0.5, 0.003, 0.3)
        * np.array([1.5, 1.0, 1.0])[:, None]
    )
    J = truth + deviation * rng.standard_normal(truth.shape)
    shrunk, left = shrunk_to_the_mean(J, deviation)
    sure = deviation[0] < 0.01
    assert np.abs(shrunk - J)[:, sure].max() < 0.01
    error = shrunk - truth
    assert error[:, ~sure].std() < 0.5 * (J - truth)[:, ~sure].std()
    np.testing.assert_allclose(
        left[:, ~sure].mean(axis=1), error[:, ~sure].std(axis=1), rtol=0.15
    )


def test_a_speck_before_far_ground_takes_the_mean_colour_and_bright_things_stay() -> None:
    J = coloured_surfaces(np.random.default_rng(0), 10_000)
    # snow at 12 m in coastal water; a white shell
    J[:, 0], J[:, 1] = (
        (60, 2.9, 2.3),
        (1.5, 1.4, 1.3),
    )
    deviation = np.full(J.shape, 0.01)
    deviation[0, 2], J[0, 2] = 1.0, 4.0  # noise
    is_speck = specks_of(J, deviation)
    assert np.flatnonzero(is_speck).tolist() == [0]
    dark = J[:, 2:] / 10
    dark[:, 0] = 0.9, 0.9, 0.9  # a white chart before dark ground
    assert not specks_of(dark, np.full(dark.shape, 0.01)).any()
    known = np.where(is_speck, np.inf, deviation)
    shrunk, left = prior_of(J, known).posterior(J, known)
    assert np.abs(shrunk[:, 0] - 0.5).max() < 0.1
    assert (left[:, 0] > 0.1).all()


def test_filled_specks_have_the_colours_around_them() -> None:
    row, column = np.unravel_index(TARGET.distance.argmax(), TARGET.distance.shape)
    rgb = TARGET.rgb.copy()
    rgb[row, column] = 0.9
    snow = replace(TARGET, pixels=Arrays(rgb, TARGET.depth))
    result = Sucre(water="truth", colours="single_view", fill=True).restore(SCENE, snow)
    around = result.image[max(0, row - 4) : row + 5, max(0, column - 4) : column + 5]
    assert np.isnan(result.image[row, column]).all()
    np.testing.assert_allclose(
        result.filled[row, column], np.nanmean(around, axis=(0, 1)), rtol=1e-4
    )


# -- bad input ---------------------------------------------------------------------------------------------


def test_one_view_alone_fails_with_what_to_do_and_is_restored_in_a_given_water_without_a_known_noise() -> (
    None
):
    alone = replace(SCENE, views=[TARGET])
    with pytest.raises(SolveError, match="two views"):
        sucre().restore(alone, TARGET)
    for method in (Sucre(water="truth"), SucrePlus(water="truth")):
        result = method.restore(alone, TARGET)
        assert np.array_equal(result.valid, TARGET.depth > 0)
        assert np.isnan(result.confidence).all()
        assert any("noise" in limit for limit in result.info["limits"])
        json.dumps(result.info, allow_nan=False)


@pytest.mark.parametrize(
    ("options", "named"),
    [
        ({"physical": "always"}, {"method.physical", "'always'", "auto"}),
        ({"water": ""}, {"method.water", "empty"}),
        ({"water": "seathr"}, {"method.water=seathr", "'seathru'"}),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    options: dict[str, Any], named: set[str]
) -> None:
    with refused(*named):
        Sucre(**options)
