"""ULAP and UDCP, against their papers' formulas by hand and what they are for."""

from __future__ import annotations

import numpy as np
import pytest
from support.forward_model import hazy, restored, tiles, transmission_of

from sucre_bench import InputError
from sucre_bench.methods.udcp import Udcp
from sucre_bench.methods.ulap import Ulap, depth_prior


@pytest.mark.parametrize(
    ("colour", "expected"),
    [
        ((0, 0, 0), 0.51157954),
        ((1, 0, 0), -0.39353163),
        ((0, 0, 1), 1.01674119),
        ((0.2, 0.4, 0.6), 0.63365430),  # .51157954 + .30309699 - .18102223
        ((100 / 255, 200 / 255, 50 / 255), 0.55283920),  # of 8 bits: not divided as integers
    ],
)
def test_depth_is_linear_in_red_and_in_the_stronger_of_green_and_blue(
    colour: tuple[float, ...], expected: float
):
    image = np.tile(np.float32(colour), (2, 3, 1))
    np.testing.assert_allclose(depth_prior(image), expected, atol=2e-6)


def test_the_transmission_of_each_channel_is_what_remains_after_the_stretched_depth() -> None:
    near, far = np.array([0.6, 0.5, 0.4]), np.array([0.1, 0.6, 0.7])
    image = np.empty((40, 90, 3), np.float32)
    image[:, :30], image[:, 30:60], image[:, 60:] = near, (near + far) / 2, far
    result = restored(Ulap(radius=3, eps=1e-6, greatest=1), image)
    prior = [
        0.51157954 + 0.50516165 * max(c[1:]) - 0.90511117 * c[0]
        for c in (near, (near + far) / 2, far)
    ]
    nearest = 1 - 0.5 / 0.9  # red differs most from the veiling light, .1, and could by .9
    t = transmission_of(image, result)
    for columns, depth in (
        (slice(5, 25), 0.0),
        (slice(35, 55), (prior[1] - prior[0]) / (prior[2] - prior[0])),
    ):
        expected = np.array([0.83, 0.95, 0.97]) ** (8 * (depth + nearest))
        np.testing.assert_allclose(
            t[:, columns].reshape(-1, 3), np.tile(expected, (800, 1)), atol=2e-3
        )


A = np.array([0.1, 0.7, 0.8])


def made() -> tuple[np.ndarray, np.ndarray]:
    """Open water above (t = 0), below it a mosaic in which every window has a dark tile; (image, t)."""
    J = tiles(
        96,
        128,
        3,
        np.array([[0.9, 0, 0], [0.1, 0.6, 0.2], [0.3, 0.1, 0.0], [0.2, 0.2, 0.7]]),
        seed=1,
    )
    t = np.zeros((96, 128))
    t[24:] = np.linspace(0.25, 0.85, 72)[:, None]
    return hazy(J, A, t).astype(np.float32), t


def test_made_haze_is_measured() -> None:
    image, truth = made()
    result = restored(Udcp(greatest=1, radius=8), image)
    np.testing.assert_allclose(result.water.veiling_light, A, atol=1e-6)
    t = np.nanmean(transmission_of(image, result)[30:], axis=(1, 2))
    np.testing.assert_allclose(t, truth[30:, 0], atol=0.06)
    assert np.corrcoef(t, truth[30:, 0])[0, 1] > 0.99


def test_a_window_without_a_middle_is_refused() -> None:
    with pytest.raises(InputError, match=r"^udcp\.window: 4 .*odd"):
        Udcp(window=4)
