"""Noise in red, where green is known well."""

from __future__ import annotations

import numpy as np

from sucre_bench.methods.sucre.follow_best_channel import followed

SHAPE = (90, 120)
ROW, COLUMN = np.mgrid[: SHAPE[0], : SHAPE[1]]


def ground(seed: int = 0) -> np.ndarray:
    """Colours (H, W, 3): texture of one reflectance, with a red patch."""
    texture = np.random.default_rng(seed).uniform(0.2, 0.6, (*SHAPE, 1)) * [0.9, 1, 0.8]
    patch = (ROW > 30) & (ROW < 60) & (COLUMN > 40) & (COLUMN < 80)
    return np.where(patch[..., None], texture * [2, 0.4, 0.4], texture)


def with_noise(J: np.ndarray, deviation: np.ndarray, seed: int = 1) -> np.ndarray:
    return (J + deviation * np.random.default_rng(seed).standard_normal(J.shape)).astype(np.float32)


def test_noise_of_red_falls_and_red_things_stay_red() -> None:
    J, deviation = ground(), np.full((*SHAPE, 3), (0.1, 0.002, 0.004))
    before = with_noise(J, deviation)
    after, left = followed(before, deviation)
    errors = [np.sqrt(np.mean((colours - J)[..., 0] ** 2)) for colours in (before, after)]
    assert errors[1] < 0.6 * errors[0]
    patch = (slice(36, 55), slice(46, 75), 0)
    assert abs(after[patch].mean() - J[patch].mean()) < 0.03
    assert 0.5 < errors[1] / np.sqrt(np.mean(left[..., 0] ** 2)) < 2
    np.testing.assert_array_equal(after[..., 1], before[..., 1])


def test_colours_that_are_known_stay_as_they_are() -> None:
    J, deviation = ground(), np.full((*SHAPE, 3), 0.001)
    before = with_noise(J, deviation)
    assert np.abs(followed(before, deviation)[0] - before).max() < 0.01


def test_differences_that_neighbours_share_are_no_noise() -> None:
    J, deviation = ground(), np.full((*SHAPE, 3), (0.1, 0.002, 0.004))
    detail = np.random.default_rng(3).standard_normal(SHAPE) * 0.02  # of red alone, far below the deviation
    J = J + detail[..., None] * [1, 0, 0]
    after, left = followed(J.astype(np.float32), deviation)
    assert left[..., 0].mean() > 0.08
    assert np.corrcoef((after - ground())[..., 0].ravel(), detail.ravel())[0, 1] > 0.6


def test_holes_stay_and_unknown_deviations_are_no_numbers_in_colours() -> None:
    J, deviation = ground().astype(np.float32), np.full((*SHAPE, 3), 0.05, np.float32)
    hole = (ROW < 20) & (COLUMN < 20)
    J[hole], deviation[hole] = np.nan, np.nan
    deviation[50:60, :, 0] = np.inf
    after, left = followed(J, deviation)
    np.testing.assert_array_equal(np.isnan(after), np.isnan(J))
    assert np.isinf(left[50:60, :, 0]).all()
    assert np.isnan(followed(np.full_like(J, np.nan), deviation)[0]).all()
