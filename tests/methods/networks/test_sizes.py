"""The sizes that images are brought to for a network, and tiles."""

import cv2
import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import NOISE, empty_network, picture, planes, random_state

from sucre_bench.methods.networks import published
from sucre_bench.methods.networks.sizes import resized, tiled

RNG = np.random.default_rng(0)


@pytest.mark.parametrize("size", [(7, 11), (20, 24), (61, 90)])
def test_resizing_is_the_bicubic_that_does_not_alias(size: tuple[int, int]):
    how = {"mode": "bicubic", "antialias": True, "align_corners": False}
    expected = torch.nn.functional.interpolate(planes(NOISE), size=size, **how)
    np.testing.assert_allclose(resized(NOISE, *size), picture(expected), atol=2e-3)


@pytest.mark.parametrize("shape", [(1, 1), (4, 6), (64, 64), (65, 200), (97, 131)])
@pytest.mark.parametrize("multiple", [1, 8])
def test_tiles_of_an_unchanged_image_add_up_to_the_image(shape: tuple[int, int], multiple: int):
    image, sizes = RNG.random((*shape, 3), dtype=np.float32), []

    def same(x: np.ndarray) -> np.ndarray:
        sizes.append(x.shape[:2])
        return x

    np.testing.assert_allclose(
        tiled([image], same, 64, 16, multiple, least=8), image, atol=1e-6
    )
    assert all(8 <= n <= 64 and n % multiple == 0 for size in sizes for n in size)


def test_tiles_join_without_a_step():
    """Each tile has a value of its own. Between two tiles the result changes over half of their overlap."""
    value = iter(range(100))
    image = tiled(
        [np.zeros((1, 300, 3), np.float32)], lambda x: np.full_like(x, next(value)), 100, 40
    )
    steps = np.diff(image[0, :, 0])
    assert image[0, 0, 0] == 0
    assert image[0, -1, 0] == next(value) - 1
    assert steps.min() >= 0
    assert steps.max() <= 1 / 20 + 1e-6


def test_tiles_equal_the_whole_where_the_network_sees_no_further_than_a_quarter_of_their_overlap():
    def blur(x: np.ndarray) -> np.ndarray:  # sees 4 pixels to each side
        return cv2.blur(x, (9, 9), borderType=cv2.BORDER_CONSTANT)

    image = RNG.random((70, 110, 3), dtype=np.float32)
    np.testing.assert_allclose(tiled([image], blur, 48, 16), blur(image), atol=1e-4)
    assert not np.allclose(tiled([image], blur, 48, 4), blur(image), atol=1e-2)


@pytest.mark.parametrize(
    ("architecture", "size", "overlap"),
    [
        ("WaterNet", 64, published.WATER_NET_OVERLAP),
        ("FunieGenerator", 288, published.FUNIE_OVERLAP),
    ],
)
def test_a_network_sees_no_further_than_a_quarter_of_its_overlap(
    architecture: str, size: int, overlap: int
):
    network = empty_network(architecture)
    network.to_empty(device="cpu").load_state_dict(random_state(architecture))
    channels, middle = 12 if architecture == "WaterNet" else 3, slice(size // 2, size // 2 + 32)
    x = torch.rand((1, channels, size, size), generator=torch.Generator().manual_seed(0))
    other = x.clone()
    other[..., middle, middle] = 1 - other[..., middle, middle]
    with torch.inference_mode():
        network.eval()
        changed = ((network(x) - network(other)).abs() > 0).any(dim=1)[0].any(dim=0).nonzero()
    assert changed.min() > 0, "the picture is too small to tell"
    reach = max(size // 2 - int(changed.min()), int(changed.max()) - (size // 2 + 31))
    assert 0 < reach <= overlap / 4
