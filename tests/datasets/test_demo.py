"""The made scene is what it says: its files, its geometry, its water and its charts, each recomputed from outside."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.two_views import carried

from sucre_bench.datasets.demo import Demo
from sucre_bench.datasets.demo.made_scene import MadeScene, make, make_once
from sucre_bench.datasets.demo.render import (
    LAMP,
    RayCaster,
    lamp_light,
)
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
    assert shown_in(tmp_path) == [whole.name]  # nothing is left beside it


def shown_in(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if not path.name.startswith(".")]


# -- what is read back is what was made ----------------------------------------------------------------------


# -- geometry ------------------------------------------------------------------------------------------------


def test_depth_maps_of_two_views_agree(survey: Scene) -> None:
    first, second = survey.views[2], survey.views[3]
    here, there, z = carried(first, second)
    assert len(z) > 50_000
    agrees = np.abs(second.depth[there] / z - 1) < 0.01
    assert agrees.mean() > 0.9  # the rest is hidden in one of them
    differences = np.abs(first.reference[here] - second.reference[there])[agrees]
    assert np.median(differences) < 5 * LEVEL


def test_rays_meet_the_ground_and_a_board_where_plane_geometry_says() -> None:
    """Against every triangle for every ray (Moeller and Trumbore 1997), in float64."""
    rng = np.random.default_rng(0)
    grid = Grid(-1.0, 2.0, 1.5, 1.0, 0.05)
    terrain = Terrain(
        grid,
        rng.normal(0, 0.06, grid.shape).astype(np.float32),
        *np.zeros((2, *grid.shape), np.float32),
    )
    board = place_board(replace(SITES[0], x=-0.3, y=2.5), terrain, 0.05)
    x, y = grid.axes()
    points = np.stack([*np.meshgrid(x, y), terrain.height], axis=-1).astype(np.float64)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    corners = [np.stack(three, axis=-2).reshape(-1, 3, 3) for three in ((a, b, d), (a, d, c))]
    p, q, r = np.moveaxis(
        np.concatenate([*corners, board.outline[[[0, 2, 1], [0, 3, 2]]]]), 1, 0
    )
    centre, rays = np.array([-0.4, 1.2, 0.9]), rng.uniform((-1, 0, -1), (1, 2, 0.3), (400, 3))
    expected = np.zeros(len(rays))
    for i, ray in enumerate(rays):
        across = np.cross(ray, r - p)
        scale = 1 / ((q - p) * across).sum(axis=1)
        u = ((centre - p) * across).sum(axis=1) * scale
        side = np.cross(centre - p, q - p)
        v, t = side @ ray * scale, (side * (r - p)).sum(axis=1) * scale
        expected[i] = min(t[(u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)], default=0)
    hits = RayCaster(terrain, (board,)).cast(centre, rays)
    np.testing.assert_allclose(hits.depth, expected, rtol=5e-6)  # float32
    assert (hits.cell >= 0).sum() > 20
    assert (hits.board == 0).sum() > 5
    assert ((hits.board < 0) & (hits.cell < 0)).sum() > 5


# -- water ---------------------------------------------------------------------------------------------------


def test_images_follow_the_model_within_noise_and_rounding(survey: Scene) -> None:
    """Equation 5 written out per pixel, from the files alone."""
    rng = np.random.default_rng(0)
    B, beta, gamma = (0.07, 0.36, 0.42), (0.42, 0.14, 0.13), (0.30, 0.20, 0.18)
    residuals = []
    for view in survey:
        K = view.camera.K
        for u, v in zip(rng.integers(480, size=300), rng.integers(360, size=300), strict=True):
            ray = ((u + 0.5 - K[0, 2]) / K[0, 0], (v + 0.5 - K[1, 2]) / K[1, 1], 1.0)
            z = view.depth[v, u] * np.sqrt(sum(r * r for r in ray))
            for c in range(3):
                I = view.reference[v, u, c] * np.exp(-beta[c] * z) + B[c] * (
                    1 - np.exp(-gamma[c] * z)
                )
                residuals.append((view.rgb[v, u, c] - I) / LEVEL)
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
