"""Underwater haze-lines, against mosaics in water of a known type, and against each step done by hand."""

import functools

import numpy as np
import pytest
from support.forward_model import UNWANTED, hazy, restored, tiles

from sucre_bench import Arrays, Restoration, Scene, View
from sucre_bench.imaging.encoding import srgb_decode, srgb_encode
from sucre_bench.methods.haze_lines import (
    WATER_TYPES,
    HazeLines,
)
from sucre_bench.plugins.call_method import checked_restore
from sucre_bench.scene import Encoding

A = np.array([0.08, 0.30, 0.42])
TYPE = {water.name: water for water in WATER_TYPES}


@functools.cache
def made(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Open water, and below it a mosaic, gray in the mean, that recedes: linear image, blue's t, and J."""
    rng = np.random.default_rng(2)
    t = np.zeros((180, 240))
    t[60:] = np.geomspace(0.4, 0.9, 120)[:, None]
    colours = rng.uniform(0.05, 0.95, (24, 3))
    J = tiles(180, 240, 8, (colours * 0.5 / colours.mean(axis=0)).clip(0, 1), seed=2)
    water = TYPE[name]
    t_c = t[..., None] ** (1 / np.array([water.blue_to_red, water.blue_to_green, 1]))
    return hazy(J, A, t_c), t, J


@pytest.mark.parametrize(
    ("name", "linear"),
    [("I", True), ("II", True), ("1C", True), ("3C", True), ("5C", True), ("3C", False)],
)
def test_the_waters_type_and_veiling_light_are_found(name: str, linear: bool) -> None:
    image = made(name)[0]
    rgb = (srgb_encode(image) if linear else image).clip(0, 1).astype(np.float32)
    result = restored(HazeLines(linear=linear), rgb)
    assert result.info["water_type"] == name
    np.testing.assert_allclose(
        result.water.veiling_light, srgb_encode(A) if linear else A, atol=1e-3
    )


def test_the_colours_without_water_come_back_but_for_their_scale() -> None:
    image, t, J = made("3C")
    restored_linear = srgb_decode(
        restored(HazeLines(), srgb_encode(image).clip(0, 1).astype(np.float32)).image
    )
    near = t > 0.5
    before = np.corrcoef(image[near].ravel(), J[near].ravel())[0, 1]
    after = np.corrcoef(restored_linear[near].ravel(), J[near].ravel())[0, 1]
    assert after > 0.97 > before


@pytest.mark.parametrize("kind", UNWANTED)
def test_an_unwanted_image_gets_finite_colours_in_gamma_encoding_too(kind: str) -> None:
    assert np.isfinite(restored(HazeLines(linear=False), UNWANTED[kind]).image).all()


@pytest.mark.parametrize("linear", [True, False])
def test_the_veiling_light_is_told_as_a_gamma_encoded_colour_and_named_so(linear: bool) -> None:
    """Whatever the view's encoding: the engine hands over encoded pixels, and `linear` is no one else's business."""
    image = made("3C")[0].clip(0, 1)
    of: dict[Encoding, Restoration] = {}
    for encoding in ("gamma", "linear"):
        pixels = (srgb_encode(image) if encoding == "gamma" else image).astype(np.float32)
        view = View("photo.png", Arrays(pixels), encoding=encoding)
        of[encoding] = checked_restore(
            HazeLines(linear=linear), Scene("photo", [view], frozenset()), view
        )
        water = of[encoding].water
        assert water.encoding == "gamma"
        np.testing.assert_allclose(water.veiling_light, srgb_encode(A), atol=1e-3)
    np.testing.assert_allclose(srgb_decode(of["gamma"].image), of["linear"].image, atol=2e-3)
