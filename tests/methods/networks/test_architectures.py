"""The published networks: their sizes, keys and layers, by hand in float64."""

from __future__ import annotations  # types do not import torch

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_networks import NOISE, empty_network, picture, planes, restored

from sucre_bench.methods.networks import published
from sucre_bench.methods.networks.run_torch import read_state


@pytest.mark.parametrize(
    ("architecture", "parameters"),
    # Sums over the published layers; the last is also what public logs of that generator print.
    [("WaterNet", 1_090_668), ("FunieGenerator", 7_019_587), ("TaclGenerator", 11_378_179)],
)
def test_an_architecture_has_as_many_parameters_as_the_published_one(
    architecture: str, parameters: int
):
    assert sum(p.numel() for p in empty_network(architecture).parameters()) == parameters


def water_net_by_hand(w: dict[str, torch.Tensor], images: list[torch.Tensor]) -> torch.Tensor:
    functional = torch.nn.functional

    def stack(name: str, x: torch.Tensor, n: int) -> torch.Tensor:
        for i in range(1, n + 1):
            weight = w[f"{name}.conv{i}.weight"]
            x = functional.conv2d(
                x, weight, w[f"{name}.conv{i}.bias"], padding=weight.shape[-1] // 2
            )
            x = torch.sigmoid(x) if (name, i) == ("cmg", 8) else x.clamp(min=0)
        return x

    raw, wb, ce, gc = images
    maps = stack("cmg", torch.cat([raw, wb, ce, gc], 1), 8)
    named = {"wb_refiner": wb, "ce_refiner": ce, "gc_refiner": gc}
    refined = [stack(name, torch.cat([raw, image], 1), 3) for name, image in named.items()]
    return refined[0] * maps[:, :1] + refined[1] * maps[:, 1:2] + refined[2] * maps[:, 2:]


def funie_by_hand(w: dict[str, torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    functional = torch.nn.functional

    def batch_norm(x: torch.Tensor, name: str) -> torch.Tensor:
        mean, var, gain, shift = (
            w[f"{name}.{part}"][:, None, None]
            for part in ("running_mean", "running_var", "weight", "bias")
        )
        return (x - mean) / (var + 1e-5).sqrt() * gain + shift

    seen = []
    for i in range(1, 6):
        x = functional.conv2d(x, w[f"down{i}.model.0.weight"], stride=2, padding=1)
        x = batch_norm(x, f"down{i}.model.1") if i in (2, 3, 4) else x
        x = torch.where(x > 0, x, 0.2 * x)
        seen.append(x)
    for i in range(1, 5):
        x = functional.conv_transpose2d(x, w[f"up{i}.model.0.weight"], stride=2, padding=1)
        x = torch.cat([batch_norm(x, f"up{i}.model.1").clamp(min=0), seen[4 - i]], 1)
    x = x.repeat_interleave(2, 2).repeat_interleave(2, 3)
    return torch.tanh(
        functional.conv2d(
            functional.pad(x, (2, 1, 2, 1)), w["final.2.weight"], w["final.2.bias"]
        )
    )


def tacl_by_hand(w: dict[str, torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    functional = torch.nn.functional

    def norm(x: torch.Tensor) -> torch.Tensor:
        return (x - x.mean((2, 3), keepdim=True)) / (
            x.var((2, 3), keepdim=True, correction=0) + 1e-5
        ).sqrt()

    def conv(x: torch.Tensor, name: str, mirror: int = 0, **how: int) -> torch.Tensor:
        x = functional.pad(x, (mirror,) * 4, mode="reflect") if mirror else x
        return functional.conv2d(x, w[f"{name}.weight"], w[f"{name}.bias"], **how)

    x = norm(conv(x, "model.1", 3)).clamp(min=0)
    for i in (4, 7):
        x = norm(conv(x, f"model.{i}", stride=2, padding=1)).clamp(min=0)
    for i in range(10, 19):
        inner = norm(conv(x, f"model.{i}.conv_block.1", 1)).clamp(min=0)
        x = x + norm(conv(inner, f"model.{i}.conv_block.5", 1))
    for i in (19, 22):
        weight, bias = w[f"model.{i}.weight"], w[f"model.{i}.bias"]
        x = norm(
            functional.conv_transpose2d(x, weight, bias, stride=2, padding=1, output_padding=1)
        ).clamp(min=0)
    return torch.tanh(conv(x, "model.26", 3))


def in_float64(path: Path) -> dict[str, torch.Tensor]:
    return {key: value.double() for key, value in read_state(path).items()}


PADDED = np.pad(NOISE, ((0, 12), (0, 8), (0, 0)), mode="symmetric")


@pytest.mark.parametrize(
    ("method", "by_hand", "given", "options", "atol"),
    [
        ("funie_gan", funie_by_hand, PADDED, {"size": None}, 2e-5),
        ("tacl", tacl_by_hand, NOISE[:16, :20], {}, 2e-4),
    ],
    ids=["funie_gan", "tacl"],
)
def test_a_generator_gives_what_its_layers_give_by_hand(
    files: dict[str, Path],
    method: str,
    by_hand: Callable[..., torch.Tensor],
    given: np.ndarray,
    options: dict[str, Any],
    atol: float,
):
    rgb = NOISE[: len(given), : given.shape[1]]
    made = picture((by_hand(in_float64(files[method]), 2 * planes(given) - 1) + 1) / 2)
    assert made.std() > 0.05  # it does not saturate
    image = restored(method, rgb, weights=files[method], **options)
    np.testing.assert_allclose(image, made[: len(rgb), : rgb.shape[1]], atol=atol)


def test_water_net_gives_what_its_layers_give_by_hand(files: dict[str, Path]):
    inputs = [NOISE, NOISE[::-1], NOISE[:, ::-1], 1 - NOISE]
    by_hand = picture(
        water_net_by_hand(in_float64(files["water_net"]), [planes(image) for image in inputs])
    )
    network = published.loaded("WaterNet", files["water_net"], "cpu")
    np.testing.assert_allclose(network(np.concatenate(inputs, axis=-1)), by_hand, atol=2e-5)
