"""The inputs of published networks, and how their outputs become pictures."""

from pathlib import Path

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import NOISE, random_state, restored, saved

from sucre_bench import Arrays, Scene, View, restore
from sucre_bench.imaging.filters import equalised, stretched_by_weakness
from sucre_bench.methods.networks.sizes import limited, resized


@pytest.mark.parametrize("chosen", ["wb", "ce", "gc"])
def test_water_net_with_passing_weights_returns_the_derived_image_of_that_branch(
    chosen: str, tmp_path: Path
):
    """Order of branches and of colours: one map open, refiners that hand their second image on."""
    state = {key: torch.zeros_like(value) for key, value in random_state("WaterNet").items()}
    state["cmg.conv8.bias"] = torch.tensor(
        [40.0 if name == chosen else -40.0 for name in ("wb", "ce", "gc")]
    )
    for name in ("wb", "ce", "gc"):
        for c in range(3):
            state[f"{name}_refiner.conv1.weight"][c, 3 + c, 3, 3] = 1
            state[f"{name}_refiner.conv2.weight"][c, c, 2, 2] = 1
            state[f"{name}_refiner.conv3.weight"][c, c, 1, 1] = 1
    rgb = (NOISE * np.float32([0.2, 0.6, 0.9])).repeat(2, axis=0).repeat(2, axis=1)
    image = restored("water_net", rgb, weights=saved(tmp_path / "passing.pth", state))
    expected = {
        "wb": stretched_by_weakness(rgb),
        "ce": equalised(rgb, 3.56, 8),
        "gc": rgb.astype(np.float64) ** 0.7,
    }
    np.testing.assert_allclose(image, expected[chosen], atol=1e-6)


def test_funie_gan_sees_every_view_at_256_pixels_unless_told_otherwise(files: dict[str, Path]):
    view = View("a.png", Arrays(NOISE))
    result = restore(
        "funie_gan", Scene("s", [view], frozenset()), view, weights=files["funie_gan"]
    )
    assert result.info["worked_at"] == "256x256"
    square = restored(
        "funie_gan", resized(NOISE, 256, 256), weights=files["funie_gan"], size=None
    )
    np.testing.assert_allclose(result.image, resized(square, 20, 24), atol=1e-5)


def test_a_file_that_changes_is_read_again(tmp_path: Path):
    path = saved(tmp_path / "w.pth", random_state("WaterNet", 1))
    first = restored("water_net", NOISE, weights=path)
    saved(path, random_state("WaterNet", 2))
    assert not np.allclose(first, restored("water_net", NOISE, weights=path))


def test_a_longest_side_scales_larger_views_down_and_no_view_up(files: dict[str, Path]):
    for size, longest, expected in (
        ((4000, 6000), 1200, (800, 1200)),
        ((20, 30), 1200, (20, 30)),
        ((20, 30), None, (20, 30)),
        ((1, 5000), 10, (1, 10)),
    ):
        assert limited(np.broadcast_to(0, size), longest) == expected
    small = restored("water_net", NOISE, weights=files["water_net"], longest_side=12)
    at_10x12 = restored(
        "water_net", resized(NOISE, 10, 12).clip(0, 1), weights=files["water_net"]
    )
    np.testing.assert_allclose(small, resized(at_10x12, 20, 24), atol=1e-5)
