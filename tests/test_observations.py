"""The observation store, against the matches it is made of."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from made_scene import make_camera, make_pose, make_scene

from sucre_bench import Arrays, InputError, SolveError, View
from sucre_bench.multiview import observe as module
from sucre_bench.multiview.observations import Observations, Seen, arrange
from sucre_bench.multiview.observe import observe
from sucre_bench.multiview.pairing import lift, match
from sucre_bench.progress import watched_by

SCENE = make_scene()
TARGET = SCENE["a.png"]
OWN = 1  # its place in the scene
REAL = Path(__file__).resolve().parents[2] / "shared" / "data" / "seathru_d5_charts"


def by_pixel(observations: Observations) -> dict[int, list[tuple[int, float, tuple[float, ...]]]]:
    """Flat pixel -> its (view, distance, colour) from slot to slot."""
    found = defaultdict(list)
    for n, part in observations.slots():
        colours = observations.intensity(part).T
        for k, pixel in enumerate(observations.pixels[:n].tolist()):
            at = part.start + k
            found[pixel].append((int(observations.view[at]), float(observations.distance[at]), tuple(colours[k])))
    return dict(found)


def test_every_pixel_with_depth_has_its_own_observation_once() -> None:
    found = by_pixel(observe(TARGET, SCENE.views, with_view=True))
    assert sorted(found) == np.flatnonzero(TARGET.depth).tolist()
    rgb, distance = TARGET.rgb.reshape(-1, 3), TARGET.distance.ravel()
    for pixel, seen in found.items():
        own = [(z, colour) for view, z, colour in seen if view == OWN]
        assert len(own) == 1
        assert own[0][0] == pytest.approx(distance[pixel], rel=1e-6)
        np.testing.assert_allclose(own[0][1], rgb[pixel], atol=1e-7)


def test_other_observations_are_the_matches_with_the_other_views_colours() -> None:
    found = by_pixel(observe(TARGET, SCENE.views, with_view=True))
    for index, view in enumerate(SCENE.views):
        if index == OWN:
            continue
        matches = match(lift(TARGET), view)
        seen = {p: (z, c) for p, all_seen in found.items() for v, z, c in all_seen if v == index}
        assert sorted(seen) == sorted(matches.pixels)
        colours = view.rgb.reshape(-1, 3)
        for pixel, other, z in zip(matches.pixels, matches.others, matches.distance, strict=True):
            assert seen[pixel][0] == z
            np.testing.assert_allclose(seen[pixel][1], colours[other], atol=1e-7)


def test_pixels_are_sorted_by_falling_count_and_slots_are_prefixes() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    assert (np.diff(observations.counts) <= 0).all()
    order = np.lexsort((observations.pixels, -observations.counts))
    assert (order == np.arange(len(order))).all()  # equal counts by rising index
    sizes = [n for n, _ in observations.slots()]
    assert sizes == [int((observations.counts > k).sum()) for k in range(observations.counts.max())]
    assert sum(sizes) == len(observations) == observations.counts.sum()
    assert len(sizes) > 2  # the scene is worth it


def test_a_pixels_slots_follow_the_order_of_the_views() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    assert observations.views == tuple(view.name for view in SCENE)
    assert all(views == sorted(views) for views in ([s[0] for s in seen] for seen in by_pixel(observations).values()))


def test_blocks_of_pixels_cover_the_slots() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    whole = [np.arange(part.start, part.stop) for _, part in observations.slots()]
    size = 97
    pieces = [np.empty(0, int)] * len(whole)
    for start in range(0, len(observations.pixels), size):
        for k, (n, part) in enumerate(observations.slots(start, start + size)):
            assert n == part.stop - part.start <= size
            pieces[k] = np.concatenate([pieces[k], np.arange(part.start, part.stop)])
    assert all((a == b).all() for a, b in zip(whole, pieces, strict=True))


def test_eight_bit_colours_are_kept_as_eight_bit() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    assert observations.colour.dtype == np.uint8
    assert observations.distance.dtype == np.float32


def test_finer_colours_are_kept_as_they_are_beside_eight_bit_ones() -> None:
    fine = np.float32([[0.1234567, 0.5, 0.7654321]])
    coarse = np.uint8([[51, 102, 255], [0, 1, 2]])
    one, two = np.array([1]), np.array([0, 1])
    observations = arrange(
        (1, 2), [Seen("b", one, np.float32([2]), fine), Seen("a", two, np.float32([1, 3]), coarse)], with_view=True
    )
    assert observations.colour.dtype == np.float32
    assert by_pixel(observations) == {
        1: [(0, 2.0, tuple(fine[0])), (1, 3.0, tuple(np.float32([0, 1, 2]) / np.float32(255)))],
        0: [(1, 1.0, tuple(np.float32([51, 102, 255]) / np.float32(255)))],
    }


def test_colours_go_back_to_their_pixels() -> None:
    observations = observe(TARGET, SCENE.views, with_view=True)
    image = observations.image(TARGET.rgb.reshape(-1, 3)[observations.pixels].T)
    assert np.array_equal(np.isnan(image).any(axis=-1), TARGET.depth == 0)
    assert np.array_equal(image[TARGET.valid], TARGET.rgb[TARGET.valid])


def test_views_without_pose_or_depth_are_left_out() -> None:
    lost = replace(SCENE["side.png"], name="lost.png", cam_from_world=None)
    flat = View("flat.png", Arrays(SCENE["far.png"].rgb), SCENE["far.png"].camera, SCENE["far.png"].cam_from_world)
    views = [lost, *SCENE.views, flat]
    assert observe(TARGET, views).views == tuple(view.name for view in SCENE)


def test_a_target_that_is_not_among_the_views_takes_part_all_the_same() -> None:
    others = [view for view in SCENE if view is not TARGET]
    observations = observe(TARGET, others)
    assert observations.views == ("a.png", *(view.name for view in others))
    assert len(observations) == len(observe(TARGET, SCENE.views))


def test_a_targets_own_observations_do_not_hang_on_rounding() -> None:
    pose = make_pose(
        (1e15, 3e14, -1e14), 0.3, 0.2, 0.1
    )  # so far out that float64 cannot even take the camera to itself
    remote = replace(TARGET, cam_from_world=pose)
    by_arithmetic = match(lift(remote), remote)
    assert by_arithmetic is None or len(by_arithmetic.pixels) < (TARGET.depth > 0).sum()
    assert (observe(remote, [remote]).counts == 1).sum() == (TARGET.depth > 0).sum()


def test_views_that_show_next_to_nothing_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    shares = {v.name: len(match(lift(TARGET), v).pixels) / TARGET.depth.size for v in SCENE if v is not TARGET}
    least = min(shares, key=shares.__getitem__)
    monkeypatch.setattr(module, "MIN_SHARE", shares[least])
    assert set(observe(TARGET, SCENE.views).views) == {view.name for view in SCENE} - {least}


def test_a_target_without_any_depth_is_an_error_that_says_so() -> None:
    arrays = Arrays(np.zeros((30, 40, 3)), np.zeros((30, 40)))
    blind = View("a.png", arrays, make_camera(40, 30, 40), np.eye(4))
    with pytest.raises(SolveError, match=r"^a\.png: no pixel has depth;"):
        observe(blind, [blind])
    with pytest.raises(InputError, match=r"^b\.png: the view has no depth map"):
        observe(replace(blind, name="b.png", pixels=Arrays(arrays.rgb)), [blind])


def test_pairing_reports_its_progress_view_by_view() -> None:
    class Watcher:
        told: list[tuple[str, int | None]] = []
        steps = 0

        def started(self, what: str, total: int | None) -> int:
            self.told.append((what, total))
            return 0

        def advanced(self, line: int) -> None:
            self.steps += 1

        def finished(self, line: int) -> None:
            pass

    watcher = Watcher()
    with watched_by(watcher):
        observe(TARGET, SCENE.views)
    assert watcher.told == [("pairing", 4)]
    assert watcher.steps == 4


@pytest.mark.skipif(not REAL.is_dir(), reason=f"{REAL} is absent")
@pytest.mark.parametrize(("name", "published"), [("LFT_3411.png", 2_173_610), ("D5_fig01_LFT_3374.png", 3_145_256)])
def test_real_images_give_as_many_observations_as_the_two_map_form(name: str, published: int) -> None:
    import sucre_bench as sb

    scene = next(iter(sb.load_scenes("colmap", root=str(REAL))))
    assert len(observe(scene[name], scene.views)) == pytest.approx(published, rel=1e-4)
