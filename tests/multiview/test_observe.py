"""What all views show of a target, against the matches it is made of and against colours worked out by hand."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from support.made_scene import Watched, make_camera, make_pose, make_scene

from sucre_bench import Arrays, InputError, NotApplicableError, SolveError, View
from sucre_bench.multiview import observe as module
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe
from sucre_bench.multiview.pairing import lift, match

SCENE = make_scene()
TARGET = SCENE["a.png"]

Seen = dict[int, list[tuple[int, float, tuple[float, ...]]]]


def by_pixel(observations: Observations) -> Seen:
    """Flat pixel -> its (view, distance, colour) from slot to slot."""
    found = defaultdict(list)
    for n, part in observations.slots():
        colours = observations.intensity(part).T
        for k, pixel in enumerate(observations.pixels[:n].tolist()):
            at = part.start + k
            found[pixel].append(
                (
                    int(observations.view[at]),
                    float(observations.distance[at]),
                    tuple(colours[k]),
                )
            )
    return dict(found)


def test_observations_are_every_pixel_itself_and_the_matches_with_the_colours_of_their_view() -> (
    None
):
    found = by_pixel(observe(TARGET, SCENE.views, with_view=True))
    assert sorted(found) == np.flatnonzero(TARGET.depth).tolist()
    itself = np.flatnonzero(TARGET.depth)
    for index, view in enumerate(SCENE.views):
        seen = {
            p: (z, c) for p, all_seen in found.items() for v, z, c in all_seen if v == index
        }
        if view is TARGET:
            expected = (itself, itself, TARGET.distance.ravel()[itself])
        else:
            matches = match(lift(TARGET), view)
            expected = (matches.pixels, matches.others, matches.distance)
        assert sorted(seen) == sorted(expected[0])
        colours = view.rgb.reshape(-1, 3)
        for pixel, other, z in zip(*expected, strict=True):
            assert seen[pixel][0] == pytest.approx(z, rel=1e-6)
            np.testing.assert_allclose(seen[pixel][1], colours[other], atol=1e-7)


def test_views_keep_their_order_and_eight_bit_colours_stay_so() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    assert observations.views == tuple(view.name for view in SCENE)
    assert (observations.colour.dtype, observations.distance.dtype) == (np.uint8, np.float32)
    assert min(observations.read_s, observations.pair_s) > 0


def test_views_without_pose_or_depth_are_left_out() -> None:
    lost = replace(SCENE["side.png"], name="lost.png", cam_from_world=None)
    flat = View(
        "flat.png",
        Arrays(SCENE["far.png"].rgb),
        SCENE["far.png"].camera,
        SCENE["far.png"].cam_from_world,
    )
    views = [lost, *SCENE.views, flat]
    assert observe(TARGET, views).views == tuple(view.name for view in SCENE)


def test_a_target_that_is_not_among_the_views_takes_part_all_the_same() -> None:
    others = [view for view in SCENE if view is not TARGET]
    observations = observe(TARGET, others)
    assert observations.views == ("a.png", *(view.name for view in others))
    assert len(observations) == len(observe(TARGET, SCENE.views))


def test_a_target_without_any_depth_is_an_error_that_says_so() -> None:
    arrays = Arrays(np.zeros((30, 40, 3)), np.zeros((30, 40)))
    blind = View("a.png", arrays, make_camera(40, 30, 40), np.eye(4))
    with pytest.raises(SolveError, match=r"^a\.png: .*depth;"):
        observe(blind, [blind])
    with pytest.raises(InputError, match=r"^b\.png: .*depth map"):
        observe(replace(blind, name="b.png", pixels=Arrays(arrays.rgb)), [blind])


def flat_view(
    name: str, paint: Callable[[np.ndarray, np.ndarray], np.ndarray], at: float
) -> View:
    """A camera at (at, 0, 0) before the plane Z = 2 that is painted with a colour for X and Y in metres."""
    camera = make_camera(32, 24, 20)
    u, v = np.meshgrid(np.arange(32) + 0.5, np.arange(24) + 0.5)
    K = camera.K
    rgb = paint((u - K[0, 2]) / K[0, 0] * 2 + at, (v - K[1, 2]) / K[1, 1] * 2)
    return View(name, Arrays(rgb, np.full((24, 32), 2.0)), camera, make_pose((at, 0, 0)))


def ramp(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
    """A colour that is linear in space, which bilinear interpolation reproduces exactly."""
    return np.stack([0.5 + 0.1 * X, 0.4 + 0.15 * Y, 0.5 - 0.05 * X + 0.1 * Y], axis=-1)


def test_rays_are_those_of_the_pixels_that_are_seen() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True, with_ray=True)
    matches = match(lift(TARGET), SCENE["far.png"])
    K = SCENE["far.png"].camera.K
    u, v = matches.others % 56 + 0.5, matches.others // 56 + 0.5
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1]], axis=1)[
        np.argsort(matches.pixels)
    ]
    target_pixels = np.concatenate([observations.pixels[:n] for n, _ in observations.slots()])
    far = observations.view == 3
    np.testing.assert_array_equal(np.sort(target_pixels[far]), np.sort(matches.pixels))
    np.testing.assert_allclose(
        observations.ray[:, far].T[np.argsort(target_pixels[far])], rays, atol=1e-6
    )


def test_linear_light_is_decoded_from_srgb_and_kept_in_sixteen_bits() -> None:
    codes = np.array([0, 10, 128, 255])  # IEC 61966-2-1: linear 0, .003035270, .215860500, 1
    target = flat_view(
        "a", lambda X, Y: np.broadcast_to(codes[[0, 1, 2]] / 255, (*X.shape, 3)), 0
    )
    bright = flat_view("b", lambda X, Y: np.broadcast_to([1.0, 1, 0], (*X.shape, 3)), 0.1)
    observations = observe(target, [target, bright], encoding="linear", with_view=True)
    assert observations.colour.dtype == np.uint16
    assert set(map(tuple, observations.colour[:, observations.view == 0].T.tolist())) == {
        (0, 199, 14146)
    }
    assert set(map(tuple, observations.colour[:, observations.view == 1].T.tolist())) == {
        (65535, 65535, 0)
    }


def test_colours_that_are_not_finite_are_no_observations() -> None:
    def holed(X: np.ndarray, Y: np.ndarray) -> np.ndarray:
        rgb = ramp(X, Y)
        rgb[5, 6, 1], rgb[9, 9] = np.nan, np.inf
        return rgb

    whole, same_place = flat_view("a", ramp, 0), flat_view("b", holed, 0)
    twice = observe(whole, [whole, same_place])
    assert np.isfinite(twice.colour).all()
    assert sorted(twice.pixels[twice.counts == 1]) == [5 * 32 + 6, 9 * 32 + 9]
    assert len(twice) == 2 * 24 * 32 - 2
    once = observe(same_place, [same_place])
    assert not np.isin([5 * 32 + 6, 9 * 32 + 9], once.pixels).any()
    blank = flat_view("a", lambda X, Y: np.full((*X.shape, 3), np.nan), 0)
    with pytest.raises(SolveError, match=r"^a: .*depth and colour;"):
        observe(blank, [blank])


def test_a_damaged_image_costs_its_own_observations_only_and_is_told() -> None:
    def damaged(name: str) -> list[View]:
        fault = f"{name}: damaged"
        return [
            replace(v, pixels=Watched(v.pixels, fault if v.name == name else "")) for v in SCENE
        ]

    observations = observe(TARGET, damaged("side.png"))
    assert observations.views == ("near.png", "a.png", "far.png")
    assert observations.unreadable == ("side.png: damaged",)
    views = damaged("a.png")
    with pytest.raises(InputError, match=r"^a\.png: damaged$"):
        observe(views[1], views)


def test_a_grey_photograph_among_those_with_colours_is_left_out_and_told() -> None:
    def grey(view: View) -> View:
        return replace(view, pixels=Arrays(np.repeat(view.rgb[..., :1], 3, -1), view.depth))

    views = [grey(view) if view.name == "side.png" else view for view in SCENE]
    observations = observe(TARGET, views)
    assert observations.views == ("near.png", "a.png", "far.png")
    assert observations.grey[0].startswith("side.png: is grey")
    assert not observations.unreadable
    with pytest.raises(NotApplicableError, match=r"^a\.png: is grey"):
        observe(grey(TARGET), [grey(v) if v.name == "a.png" else v for v in SCENE])
    observations = observe(grey(TARGET), [grey(view) for view in SCENE])
    assert len(observations.views) == 4
    assert not observations.unreadable


def test_no_file_is_read_of_a_view_that_looks_elsewhere_and_no_image_of_one_that_shows_nothing() -> (
    None
):
    away = Watched(Arrays(np.zeros((30, 40, 3)), np.ones((30, 40))))
    # something right before the lens
    hidden = Watched(Arrays(np.zeros((30, 40, 3)), np.full((30, 40), 0.1)))
    views = [
        TARGET,
        View("away.png", away, make_camera(40, 30, 40), make_pose((0, 0, 0), yaw=np.pi)),
        View("hidden.png", hidden, make_camera(40, 30, 40), make_pose((0.5, 0, 0))),
    ]
    assert observe(TARGET, views).views == ("a.png",)
    assert away.loaded == []
    assert hidden.loaded == ["depth"]


def test_the_result_does_not_depend_on_how_many_threads_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made = []
    for n in (1, 3):
        monkeypatch.setattr(module, "usable_cores", lambda n=n: n)
        made.append(observe(TARGET, SCENE.views, with_view=True))
    one, three = made
    assert one.views == three.views
    for field in ("pixels", "counts", "distance", "colour", "view"):
        assert np.array_equal(getattr(one, field), getattr(three, field))


def sixty() -> list[View]:
    """Views that all see the same."""
    return [replace(TARGET, name=f"{k}.png", pixels=Watched(TARGET.pixels)) for k in range(60)]


def test_too_little_memory_is_told_early_and_in_one_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    views = sixty()
    # bytes an observation x views x pixels: for half of them
    free = SimpleNamespace(available=18 * 30 * 2400)
    monkeypatch.setattr(module.psutil, "virtual_memory", lambda: free)
    monkeypatch.setattr(module, "usable_cores", lambda: 2)
    with pytest.raises(SolveError, match=r"^0\.png: .* 0\.0 GB .* smaller images") as told:
        observe(views[0], views)
    assert "\n" not in str(told.value)
    assert sum("rgb" in view.pixels.loaded for view in views) < 40
    assert len(observe(views[0], views[:8])) == 8 * (TARGET.depth > 0).sum()
    assert len(observe(views[0], views, folder=tmp_path)) == 60 * (TARGET.depth > 0).sum()

    monkeypatch.setattr(module, "usable_cores", lambda: 1)
    free.available = 1000  # not even for one view: no need to foretell anything
    views = sixty()
    with pytest.raises(SolveError, match=r"^0\.png: its observations"):
        observe(views[0], views)
    assert sum("rgb" in view.pixels.loaded for view in views) < 5


def test_wrong_options_are_told_with_what_there_is() -> None:
    with pytest.raises(InputError, match=r"^encoding=log: unknown; known: linear, view$"):
        observe(TARGET, SCENE.views, encoding="log")
