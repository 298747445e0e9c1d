"""seams, on pictures with a seam of known height and length, and on pictures that have none."""

import numpy as np
import pytest

from sucre_bench.arrays import Array
from sucre_bench.camera import Camera
from sucre_bench.imaging.seams import find_seams
from sucre_bench.metrics.seams import Seams
from sucre_bench.scene import Arrays, Restoration, Score, View

H = 240
W = 320


def photograph() -> tuple[Array, Array]:
    """An image (H, W, 3) of blobs on a slanted ground in water, and its distances."""
    rng = np.random.default_rng(0)
    y, x = np.mgrid[:H, :W]
    z = 6 - 4 * y / H + 0.3 * x / W
    J = 0.5 + 0.15 * np.stack(
        [np.sin(x / 23 + c) * np.cos(y / 17 - c) for c in range(3)], axis=-1
    )
    for _ in range(25):  # edges
        cy, cx, r = rng.uniform(0, H), rng.uniform(0, W), rng.uniform(6, 25)
        J[(y - cy) ** 2 + (x - cx) ** 2 < r * r] = rng.uniform(0.1, 0.9, 3)
    J += 0.03 * rng.standard_normal(J.shape)
    image = J * np.exp(-0.3 * z[..., None]) + 0.3 * (1 - np.exp(-0.2 * z[..., None]))
    return (image + 0.004 * rng.standard_normal(J.shape)).clip(0, 1).astype(
        np.float32
    ), z.astype(np.float32)


IMAGE, Z = photograph()


def share(picture: Array, image: Array = IMAGE) -> float:
    found = find_seams(picture, image, Z)
    return float(found.is_seam[np.isfinite(found.excess)].mean())


def in_air(image: Array, z: Array) -> Array:
    """Noise and all, as a restorer of single images gives it."""
    return (
        (image - 0.3 * (1 - np.exp(-0.2 * z[..., None]))) / np.exp(-0.3 * z[..., None])
    ).clip(0, 1)


@pytest.mark.parametrize(
    "restore",
    [
        lambda image, z: image,
        lambda image, z: image * np.float32([2, 1, 0.7]) - 0.1,
        lambda image, z: image.clip(0, 1) ** np.float32(0.6),
        in_air,
        lambda image, z: image[..., ::-1] + 0.05 * np.sin(3 * z[..., None]),
        lambda image, z: np.clip(image, 0.25, 0.45),
    ],
    ids=[
        "itself",
        "gain",
        "gamma",
        "water-taken-out",
        "channels-swapped-and-bands-of-distance",
        "clipped",
    ],
)
def test_functions_of_colour_and_distance_have_no_seam(restore: object) -> None:
    assert share(restore(IMAGE, Z)) < 2e-4


@pytest.mark.parametrize("angle", [0, 20, 45, 75, 90, 130])
def test_a_seam_is_found_along_its_length_whatever_its_direction(angle: int) -> None:
    y, x = np.mgrid[:H, :W]
    side = (x - W / 2) * np.cos(np.radians(angle)) + (y - H / 2) * np.sin(np.radians(angle))
    contrast = np.ptp(np.percentile(IMAGE.reshape(-1, 3), [1, 99], axis=0), axis=0)
    picture = IMAGE + (side > 0)[..., None] * (0.3 * contrast).astype(np.float32)
    found = find_seams(picture, IMAGE, Z)
    looked_at = np.isfinite(found.excess)
    at, away = looked_at & (np.abs(side) < 1), looked_at & (np.abs(side) > 8)
    assert found.is_seam[at].mean() > 0.55  # the rest lies on edges of the photograph
    assert found.is_seam[away].mean() < 1e-3


@pytest.mark.parametrize("height", [0.1, 0.2, 0.4])
def test_the_excess_is_the_height_of_the_seam_and_falls_as_the_strips_leave_it(
    height: float,
) -> None:
    flat = np.full_like(IMAGE, 0.5)
    flat[:, :40], flat[:, -40:] = 0, 1  # what contrast is measured by
    picture = flat.copy()
    picture[:, W // 2 : -40] += height
    found = find_seams(picture, flat, np.ones_like(Z))
    # Strips of 5 pixels beside a pixel k pixels off the line: 5 - k of them lie on the other side of it.
    expected = height * np.array([0.4, 0.6, 0.8, 1, 1, 0.8, 0.6, 0.4])
    np.testing.assert_allclose(
        found.excess[40:-40, W // 2 - 4 : W // 2 + 4], np.tile(expected, (H - 80, 1)), rtol=0.02
    )
    assert found.is_seam[40:-40, W // 2 - 2 : W // 2 + 2].all()


def test_an_edge_that_the_photograph_has_is_no_seam_however_much_it_is_raised() -> None:
    image = IMAGE.copy()
    image[:, W // 2 :] += 0.1
    raised = np.tanh(6 * (image - 0.45))
    assert share(raised, image) < 1e-3
    assert share(raised, IMAGE) > 0.01


def test_holes_are_not_looked_at_and_make_no_seams() -> None:
    picture, z = IMAGE.copy(), Z.copy()
    picture[60:120, 80:160] = np.nan
    z[150:, 200:] = 0
    found = find_seams(picture, IMAGE, z)
    assert np.isnan(found.excess[60:120, 80:160]).all()
    assert np.isnan(found.excess[150:, 200:]).all()
    assert not found.is_seam.any()


def test_large_pictures_are_looked_at_small() -> None:
    big, z = (np.repeat(np.repeat(plane, 4, axis=0), 4, axis=1) for plane in (IMAGE, Z))
    picture = big + (np.arange(4 * W) >= 2 * W)[None, :, None] * np.float32(0.1)
    found = find_seams(picture, big, z)
    assert found.excess.shape == (384, 512)
    assert found.is_seam[:, 252:260].mean() > 0.3
    assert found.is_seam[:, :230].mean() < 1e-3


def score(
    picture: Array, variant: str, camera: Camera | None = None, z: Array | None = Z
) -> Score:
    view = View("a.png", Arrays(IMAGE, z), camera)
    (found,) = Seams().score(Restoration(picture), picture, view, variant)
    return found


def test_the_metric_scores_the_shown_picture_and_says_where_it_looked() -> None:
    seam = np.where((np.arange(W) < W // 2)[None, :, None], IMAGE, IMAGE + np.float32(0.15))
    visible, height = score(seam, "visible"), score(seam, "height")
    assert 0.01 < visible.value < 0.1
    assert 0.1 < height.value < 0.6
    assert 0.3 < visible.coverage < 1
    assert visible.n_pixels == round(visible.coverage * H * W)
    assert score(IMAGE, "visible").value == 0
    assert score(IMAGE, "height").value < 1e-3


@pytest.mark.parametrize("z", [np.zeros_like(Z), np.full_like(Z, np.nan)])
def test_without_a_place_to_look_at_there_is_no_score(z: Array) -> None:
    found = score(IMAGE, "visible", z=z)
    assert np.isnan(found.value)
    assert (found.n_pixels, found.coverage) == (0, 0)
