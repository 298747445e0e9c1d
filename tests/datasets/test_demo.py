"""The made scene is what it says: its files, its geometry, its water and its charts, each recomputed from outside."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.forward_model import in_water
from support.made_ground import WATERS
from support.two_views import carried

from sucre_bench.datasets.demo import Demo
from sucre_bench.datasets.demo.made_scene import MadeScene, make, make_once
from sucre_bench.datasets.demo.render import LAMP, RayCaster, lamp_light
from sucre_bench.datasets.demo.seabed import SITES, Grid, Terrain, place_board
from sucre_bench.imaging.chart_patches import measure
from sucre_bench.scene import Scene

SMALL: dict[str, Any] = {"width": 160, "height": 120, "views": 4}
BRIEF: dict[str, Any] = {**SMALL, "views": 2}
LEVEL = 1 / 255


@pytest.fixture(scope="module")
def small() -> MadeScene:
    return make(**SMALL)


@pytest.fixture(scope="module")
def deep() -> MadeScene:
    return make(**SMALL, water="deep_sea", noise=0)


@pytest.fixture(scope="module")
def survey(tmp_path_factory: pytest.TempPathFactory) -> Scene:
    """Large enough for charts in several views; read back from its files."""
    demo = Demo(width=480, height=360, views=5, root=tmp_path_factory.mktemp("demo"))
    return next(iter(demo.scenes()))


# -- made once, the same for everybody -----------------------------------------------------------------------


def test_equal_seeds_give_equal_bytes_and_another_seed_gives_other_ones(
    tmp_path: Path, small: MadeScene
) -> None:
    def content(folder: Path) -> dict[str, bytes]:
        return {
            str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()
        }

    one = content(make_once(tmp_path / "small", lambda: small))
    # keeps the last seabed
    other, same = (content(Demo(**SMALL, seed=n, root=tmp_path).folder()) for n in (1, 0))
    assert one == same
    assert one.keys() == other.keys()
    differing = {name for name in one if one[name] != other[name]}
    assert differing == {
        name for name in one if not name.endswith(("water.json", "cameras.txt", "points3D.txt"))
    }


def test_a_half_written_folder_is_made_anew(tmp_path: Path) -> None:
    demo = Demo(**BRIEF, root=tmp_path)
    whole = demo.folder()
    (whole / "water.json").unlink()
    (whole / "images" / "view_000.png").write_bytes(b"half")
    assert demo.folder() == whole
    scene = next(iter(demo.scenes()))
    assert len(scene) == 2
    assert scene["view_000.png"].rgb.shape == (120, 160, 3)
    left = [path.name for path in tmp_path.iterdir() if not path.name.startswith(".")]
    assert left == [whole.name]


# -- geometry ------------------------------------------------------------------------------------------------


def test_depth_maps_of_two_views_agree(survey: Scene) -> None:
    first, second = survey.views[2], survey.views[3]
    here, there, z = carried(first, second)
    assert len(z) > 50_000
    agrees = np.abs(second.depth[there] / z - 1) < 0.01
    assert agrees.mean() > 0.9  # the rest is hidden in one of them
    differences = np.abs(first.reference[here] - second.reference[there])[agrees]
    assert np.median(differences) < 5 * LEVEL


def test_a_ridge_hides_the_board_behind_it() -> None:
    grid = Grid(-1.0, 2.0, 1.5, 1.0, 0.05)
    flat = np.zeros(grid.shape, np.float32)
    ridge = flat.copy()
    ridge[4] = 2
    grounds = [Terrain(grid, height, flat, flat) for height in (flat, ridge)]
    board = place_board(replace(SITES[0], x=-0.3, y=2.5), grounds[0], 0.05)
    centre = np.array([-0.3, 0, 0.5])
    ray = board.patches.mean(axis=(0, 1)) - centre
    in_sight, hidden = (
        RayCaster(ground, (board,)).cast(centre, ray[None]) for ground in grounds
    )
    assert (in_sight.board, in_sight.depth) == (0, pytest.approx(1))
    assert hidden.board == -1
    # the ridge's face, z = 40 (y - 2.175)
    assert hidden.depth == pytest.approx((40 * 2.175 + 0.5) / (40 * ray[1] - ray[2]))


# -- water ---------------------------------------------------------------------------------------------------


def test_images_follow_the_model_within_noise_and_rounding(survey: Scene) -> None:
    """Equation 5 on every fifth pixel, from the files alone."""
    few = np.s_[::5, ::5]
    residuals = [
        (view.rgb[few] - in_water(view.reference[few], view.distance[few], WATERS["coast"]))
        / LEVEL
        for view in survey
    ]
    # noise .004 = 1.02 levels, rounding 0.29, the rounded reference at most 0.29
    assert abs(np.mean(residuals)) < 0.06
    assert 1.0 < np.std(residuals) < 1.15
    assert np.abs(residuals).max() < 6


def test_the_deep_sea_is_lit_by_a_lamp_whose_light_falls_and_crosses_the_water_too(
    deep: MadeScene,
) -> None:
    """Without its veil, summed up finely along the ray, I / J tells the lobe; all channels must tell the same."""
    B, beta, gamma = np.array([(0.02, 0.17), (0.19, 0.055), (0.08, 0.07)])
    K = deep.camera.K
    for u, v in ((80, 60), (100, 70), (60, 75)):
        pixel = deep.rgb[-1, v, u, ::2] / 255, deep.reference[-1, v, u, ::2]
        ray = np.array([(u + 0.5 - K[0, 2]) / K[0, 0], (v + 0.5 - K[1, 2]) / K[1, 1], 1.0])
        point, z = ray * deep.depth[-1, v, u], np.linalg.norm(ray) * deep.depth[-1, v, u]
        steps = (np.arange(4000) + 0.5) / 4000
        light, way = lamp_light(LAMP, point * steps[:, None])
        lit = light[:, None] * np.exp(-gamma * z * steps[:, None] - beta * way[:, None])
        on_ground, way = lamp_light(LAMP, point)
        expected = pixel[1] * on_ground * np.exp(-beta * (z + way)) + B * gamma * z * lit.mean(
            axis=0
        )
        np.testing.assert_allclose(pixel[0], expected, atol=0.02)


# -- charts --------------------------------------------------------------------------------------------------


def test_charts_show_their_reference_colours_without_water(survey: Scene) -> None:
    nearest = survey.views[-1]
    assert {chart.kind for chart in nearest.charts} == {"dgk", "colorchecker24"}
    for chart in nearest.charts:
        for reading in measure(nearest.reference, chart):
            assert reading.n_pixels >= 4
            np.testing.assert_allclose(reading.rgb, reading.patch.srgb, atol=1.5 * LEVEL)
