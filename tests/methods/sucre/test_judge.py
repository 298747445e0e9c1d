"""The model of a dive, chosen by what it predicts in unseen views: on made ground whose water and light are known."""

from collections.abc import Callable
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.made_ground import SLOPE, WATERS, errors_of_water, make_ground, with_pictures
from support.made_observations import ONE_MODEL

from sucre_bench import Scene, load_scene
from sucre_bench.methods.sucre import Sucre, SucrePlus, judge
from sucre_bench.methods.sucre.judge import Court, Verdict, chosen_model, is_admissible, judging
from sucre_bench.methods.sucre.light import Parts
from sucre_bench.methods.sucre.model import WaterParameters
from sucre_bench.methods.sucre.models import Fit, Model
from sucre_bench.methods.sucre.observed import Dive
from sucre_bench.methods.sucre.solution import Judged
from sucre_bench.plugins.call_method import shown_with

# As few candidates as a question needs: each takes three fits.
even = partial(Sucre, **ONE_MODEL)


def verdict(scene: Scene, options: Sucre) -> Verdict:
    return chosen_model(scene, judging(options))


def error_of_beta(scene: Scene, options: Sucre) -> float:
    """The largest of the channels, as a share."""
    found = options.restore(scene, scene["3.png"])
    return float(np.abs(errors_of_water(found, scene.water)[1]).max())


@pytest.fixture(scope="module")
def plain() -> Scene:
    return make_ground(WATERS["green"], **SLOPE)


def test_footprints_in_even_light_are_kept_where_nothing_else_is_needed(plain: Scene) -> None:
    found = verdict(plain, Sucre())
    assert found.model == Model(Fit.FOOTPRINTS, is_robust=True)
    assert not found.is_unjudged
    assert found.judged[0].held_out < 0.95
    assert error_of_beta(plain, Sucre()) < 0.03


def test_fish_in_two_views_get_no_weight(plain: Scene) -> None:
    def with_fish(k: int, rgb: np.ndarray) -> np.ndarray:
        if k in (1, 4):
            rgb[30:60, 40:80] = 0.55, 0.5, 0.35
        return rgb

    scene = with_pictures(plain, with_fish)
    assert verdict(scene, even(robust="auto")).model.is_robust
    without, error = (error_of_beta(scene, even(robust=one)) for one in (False, "auto"))
    assert error < 0.03 < without


def test_pictures_that_no_water_explains_stay_photographs(plain: Scene) -> None:
    """Each view shows noise of its own."""
    rng = np.random.default_rng(0)
    scene = with_pictures(plain, lambda _, rgb: rng.uniform(0.2, 0.8, rgb.shape))
    result = even(physical="auto").restore(scene, scene["3.png"])
    assert result.info["solver"] == "none"
    np.testing.assert_array_equal(result.image[result.valid], scene["3.png"].rgb[result.valid])


@pytest.mark.parametrize(
    ("negative", "drift", "is_right"),
    [
        ((0.01, 0.0, 0.04), 3.0, True),
        ((0.0, 0.0, 0.33), 3.0, False),
        ((0.0, 0.0, 0.0), 8.0, False),
    ],
)
def test_a_model_that_ruins_a_channel_or_far_ground_is_refused(
    negative: tuple[float, ...], drift: float, is_right: bool
) -> None:
    model = Judged(
        model="", held_out=0.1, negative=negative, drift=drift, drift_of_photograph=5.0
    )
    assert is_admissible(model, 5.0) == is_right
    assert is_admissible(model, np.inf) == (is_right or drift > 5)


@pytest.mark.parametrize(
    ("held_out", "of_start", "grey", "drift", "below", "chosen"),
    [
        ((0.40, 0.45), 1.0, 1.0, 3, 0.0, Fit.FOOTPRINTS),
        ((0.45, 0.45), 1.0, 1.0, 3, 0.0, Fit.EARLY),
        ((0.50, 0.45), 0.46, 1.0, 3, 0.0, Fit.FOOTPRINTS),
        ((0.40, 0.45), 1.0, 1.0, 10, 0.0, Fit.EARLY),
        ((0.40, 0.45), 1.0, 1.0, 9, 0.0, Fit.FOOTPRINTS),
        ((0.40, 0.45), 0.46, 1.0, 7, 0.0, Fit.NOTHING),
        ((0.40, 0.97), 1.1, 1.0, 7, 0.0, Fit.NOTHING),
        ((0.97, 0.98), 1.1, 1.0, 3, 0.0, Fit.NOTHING),
        ((0.40, 0.45), 1.0, 0.40, 3, 0.0, Fit.NOTHING),
        ((0.40, 0.45), 1.0, 1.0, 9, 0.3, Fit.NOTHING),
    ],
)
def test_a_model_must_predict_better_than_the_papers_steps_these_than_their_start_and_all_than_a_lamp(
    plain: Scene,
    monkeypatch: pytest.MonkeyPatch,
    held_out: tuple[float, float],
    of_start: float,
    grey: float,
    drift: float,
    below: float,
    chosen: Fit,
) -> None:
    """A model and the steps have these errors, in other waters too; it drifts so, photographs by 5, the steps by 8.

    below: the share of a channel that the steps make darker than black.
    """
    errors = dict(zip((Fit.FOOTPRINTS, Fit.EARLY), held_out, strict=True))
    drifts = {Fit.FOOTPRINTS: drift, Fit.EARLY: 8.0}

    def judged(court: Any, model: Model) -> Judged:
        return Judged(
            model=model.words,
            held_out=errors[model.fit],
            negative=(0.0, 0.0, below if model.fit is Fit.EARLY else 0.0),
            drift=drifts[model.fit],
            drift_of_photograph=5.0,
        )

    monkeypatch.setattr(Court, "judged", judged)

    def in_water(court: Any, model: Model, other: Callable[[Any], WaterParameters]) -> float:
        water = other(WaterParameters.of_channels(np.ones((3, 3))))
        if water.B.any():
            return of_start
        return grey if water.beta.any() else 1.0

    monkeypatch.setattr(Court, "in_water", in_water)
    monkeypatch.setattr("sucre_bench.methods.sucre.judge.is_in_air", lambda *_: False)
    monkeypatch.setattr(Court, "disagreement", lambda *_: None)
    court = Court([], [Dive.spread(Sucre(), plain, 2)], [])
    model, early = Model(Fit.FOOTPRINTS), Model(Fit.EARLY)
    court.fitted[model] = [None]  # type: ignore[list-item]
    found = court.verdict([model], [early])
    assert found is not None
    assert found.model.fit is chosen


@pytest.mark.parametrize(
    ("views", "elsewhere"), [((2, 4), ()), ((0, 1, 2, 3), (1, 3)), ((2, 6, 4), (6,))]
)
def test_views_without_two_halves_that_overlap_are_not_judged_and_take_the_papers_steps(
    plain: Scene, views: tuple[int, ...], elsewhere: tuple[int, ...]
) -> None:
    """Two views, also beside one of another place; or four, of which each half is of another place."""
    away = np.eye(4)
    away[0, 3] = 1000.0
    chosen = [plain.views[k] for k in views]
    for k in elsewhere:
        lost = plain.views[k]
        chosen[views.index(k)] = replace(lost, cam_from_world=lost.cam_from_world @ away)
    scene = replace(plain, views=chosen)
    found = verdict(scene, Sucre())
    assert (found.is_unjudged, found.model.fit, found.judged) == (True, Fit.EARLY, ())
    result = Sucre().restore(scene, chosen[0])
    assert (result.info["solver"], result.info["steps"]) == ("adam", 200)
    assert any("judge" in limit for limit in result.info["limits"])


def test_two_views_from_one_height_move_no_steps_so_they_stay_photographs() -> None:
    flat = {**SLOPE, "heights_m": (2.0, 2.05), "tilt_deg": 0.0}
    found = verdict(make_ground(WATERS["green"], **flat), Sucre())
    assert (found.is_unjudged, found.model.fit) == (True, Fit.NOTHING)


def test_a_dive_is_judged_once_for_the_methods_of_a_run() -> None:
    assert judging(SucrePlus(fill=True, water="shared")) == judging(Sucre())


def test_a_view_that_does_not_determine_its_water_takes_that_of_the_dive() -> None:
    """Over flat ground each view sees few distances: by themselves these two have beta of red .34 and .40."""
    scene = load_scene(
        "nature",
        condition="plain",
        water="deep",
        path="survey",
        seed=64,
        width=96,
        height=72,
        views=6,
    )
    first, last = (Sucre().restore(scene, view) for view in (scene.views[0], scene.views[-1]))
    np.testing.assert_array_equal(first.water.attenuation, last.water.attenuation)
    for result, view in ((first, scene.views[0]), (last, scene.views[-1])):
        assert any("common water" in limit for limit in result.info["limits"])
        error = (result.image - view.reference)[result.valid]
        assert np.sqrt(np.mean(error**2)) < 0.013


def test_one_model_needs_no_judge(plain: Scene) -> None:
    result = even().restore(replace(plain, views=plain.views[2:4]), plain.views[2])
    assert result.info["solver"] == "exact"
    assert not any("judge" in limit for limit in result.info["limits"])


def test_a_run_keeps_its_verdict_for_other_processes(
    plain: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A process is what begins with an empty memory, and `judged` counts those that judge the dive themselves."""
    model = Model(Fit.PIXELS, is_robust=True, light=Parts(1, lens=True))
    judged_once = Judged(
        model=model.words,
        held_out=0.4,
        negative=[0.0, 0.01, 0.02],
        drift=3.0,
        drift_of_photograph=5.0,
    )
    found = Verdict(model, (judged_once,))
    judged: list[str] = []

    def judge_dive(scene: Scene, *_: object) -> Verdict:
        judged.append(scene.data_id)
        return found

    def process(scene: Scene, options: Sucre, *, in_run: bool = True) -> Verdict:
        chosen_model.cache_clear()
        with shown_with("", in_run=in_run):
            return verdict(scene, options)

    monkeypatch.setattr(judge, "user_cache", lambda: tmp_path)
    monkeypatch.setattr(judge, "_judged", judge_dive)
    reef, wreck = replace(plain, data_id="reef"), replace(plain, data_id="wreck")
    first, second = process(reef, Sucre()), process(reef, SucrePlus())
    assert (second.model, len(second.judged)) == (first.model, 1)
    assert asdict(second.judged[0]) == asdict(judged_once)
    assert judged == ["reef"]
    process(wreck, Sucre())
    process(reef, Sucre(robust=False))
    assert judged == ["reef", "wreck", "reef"]
    # A program may have changed a scene, and left its data_id.
    process(reef, Sucre(), in_run=False)
    assert len(judged) == 4
    for file in tmp_path.rglob("*.json"):
        file.write_text("{")
    process(reef, Sucre())
    process(reef, Sucre())
    assert len(judged) == 5
    chosen_model.cache_clear()


def test_without_a_place_for_it_a_verdict_is_found_again(
    plain: Scene, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setattr(judge, "user_cache", lambda: tmp_path / "file")
    monkeypatch.setattr(judge, "_judged", lambda *_: Verdict(Model(Fit.EARLY)))
    chosen_model.cache_clear()
    with shown_with("", in_run=True):
        assert verdict(replace(plain, data_id="reef"), Sucre()).model.fit is Fit.EARLY
    chosen_model.cache_clear()


@pytest.mark.parametrize("n_views", [6, 3])
def test_errors_of_a_water_count_what_halves_and_models_that_predict_as_well_disagree_on(
    n_views: int,
) -> None:
    """Poses are 2 px off in drifts: beta is off by 30 % at far ground, and residuals alone say 7 %."""
    sea = {"condition": "pose_2", "water": "clear", "path": "forward", "seed": 611}
    scene = load_scene("nature", **sea, width=96, height=72, views=n_views)
    view = scene.views[n_views // 2]
    found = Sucre().restore(scene, view)
    assert found.water is not None
    assert scene.water is not None
    wrong = np.abs(found.water.attenuation - scene.water.attenuation)
    said = np.array(found.info["standard_error"]["beta"])
    assert (wrong < 2 * said).all()
    assert any(
        "colours of far ground may be wrong by" in limit for limit in found.info["limits"]
    )
