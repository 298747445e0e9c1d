"""Distances completed from their surroundings, on made scenes whose distances are known."""

import numpy as np
import pytest

import sucre_bench as sb
from sucre_bench import Arrays, Camera, Scene, View, Water
from sucre_bench.imaging.fill import completed_distance

HEIGHT, WIDTH = 90, 120
V, U = np.mgrid[:HEIGHT, :WIDTH] + 0.5


def test_a_hole_in_a_plane_gets_the_planes_distances() -> None:
    plane = (6 / (1 + V / HEIGHT + 0.3 * U / WIDTH)).astype(np.float32)
    z = plane.copy()
    z[20:60, 30:80] = 0
    found = completed_distance(z, np.full((HEIGHT, WIDTH, 3), 0.5, np.float32))
    np.testing.assert_allclose(found, plane, rtol=0.02)
    assert (found[z > 0] == z[z > 0]).all()


def test_a_step_of_depth_lies_at_the_edge_of_the_image() -> None:
    near = U < 60
    guide = np.where(near[..., None], [0.7, 0.4, 0.3], [0.1, 0.4, 0.5]).astype(np.float32)
    truth = np.where(near, 2.0, 8.0).astype(np.float32)
    z = truth.copy()
    z[10:80, 35:85] = 0  # the hole reaches over the edge
    found = completed_distance(z, guide)
    away = np.abs(U - 60) > 3
    np.testing.assert_allclose(found[away], truth[away], rtol=0.1)


def test_nothing_is_nearer_or_farther_than_what_is_known_around_a_hole() -> None:
    rng = np.random.default_rng(0)
    z = np.where(V > 45, 9 - V / 15, 0).astype(np.float32)  # above the horizon nothing is known
    found = completed_distance(z, rng.random((HEIGHT, WIDTH, 3)).astype(np.float32))
    assert found.min() >= z[z > 0].min() * (1 - 1e-6)
    assert found.max() <= z.max() * (1 + 1e-6)
    assert found[:40].min() > 5, "water above the ground is as far as the farthest ground below it"


def scene() -> tuple[Scene, np.ndarray]:
    """A textured plane at a slant in known water, with holes in its depth map; and its colours without water."""
    rng = np.random.default_rng(3)
    camera = Camera(np.array([[100.0, 0, WIDTH / 2], [0, 100, HEIGHT / 2], [0, 0, 1]]), WIDTH, HEIGHT)
    depth = (8 / (1 + V / HEIGHT)).astype(np.float32)
    J = rng.uniform(0.1, 0.9, (HEIGHT, WIDTH, 3))
    water = Water(np.array([0.1, 0.3, 0.4]), np.array([0.4, 0.15, 0.1]), np.array([0.3, 0.2, 0.15]))
    z = View("x", Arrays(J, depth), camera).distance[..., None]
    seen = J * np.exp(-water.attenuation * z) + water.veiling_light * (1 - np.exp(-water.backscatter * z))
    holed = depth.copy()
    holed[30:50, 40:70] = 0
    view = View("a.png", Arrays(seen, holed, J), camera, np.eye(4))
    return Scene("slant", [view], frozenset({"depth", "poses", "reference", "truth"}), water), J


@pytest.mark.parametrize(
    "method", ["sucre", "sucre_plus", "sucre_paper", "seathru", "gaussian_seathru", "stitching", "dive_gray_world"]
)
def test_every_method_that_needs_depth_fills_and_leaves_the_rest_as_it_is(method: str) -> None:
    made, _ = scene()
    view = made[0]
    options = {"sucre": {"water": "truth"}, "sucre_plus": {"water": "truth"}, "sucre_paper": {"steps": 3}}.get(
        method, {}
    )
    plain, filled = (sb.restore(method, made, view, fill=fill, **options) for fill in (False, True))
    holes = view.depth == 0
    assert plain.filled is None
    assert filled.filled is not None
    np.testing.assert_array_equal(filled.image, plain.image)
    np.testing.assert_array_equal(filled.valid, ~holes)
    np.testing.assert_array_equal(np.isfinite(filled.filled).all(axis=-1), holes)
    assert np.isfinite(filled.picture).all()
    np.testing.assert_array_equal(filled.picture[~holes], plain.shown[~holes])
    rows = [sb.score(one, view, metrics=["psnr", "coverage"]) for one in (plain, filled)]
    a, b = (row.loc[row["metric"].isin(["psnr", "coverage"]), "value"].to_numpy() for row in rows)
    np.testing.assert_array_equal(a, b)


def test_filled_pixels_have_their_own_colour_in_the_same_water_and_less_confidence() -> None:
    made, J = scene()
    holes = made[0].depth == 0
    result = sb.restore("sucre", made, 0, water="truth", fill=True)
    np.testing.assert_allclose(result.filled[holes], J[holes], atol=0.06)
    known = np.isfinite(result.confidence) & ~holes
    assert np.isfinite(result.confidence[holes]).all()
    assert not known.any() or np.median(result.confidence[holes]) > np.median(result.confidence[known])
