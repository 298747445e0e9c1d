"""The paper's optimiser, against automatic differentiation in float64, and made water."""

from __future__ import annotations  # types do not import torch

import functools
import json
import re
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support import lazy_torch as torch
from support.made_observations import flat, made, parameters, record_of, table
from support.made_scene import WATER, make_scene

from sucre_bench import InputError, Scene, SolveError, restore
from sucre_bench.methods.sucre import SucrePaper, adam, adam_loops
from sucre_bench.methods.sucre.adam import Descent, Steps, descend, descend_on_torch
from sucre_bench.multiview.observations import Observations
from sucre_bench.multiview.observe import observe

SCENE = make_scene()
TARGET = SCENE["a.png"]
FEW = SucrePaper(steps=12, device="cpu")
START = np.full((3, 3), 0.1)  # rows B, beta, gamma


@functools.cache
def observed() -> Observations:
    return observe(TARGET, SCENE.views)


def colours_of(image: np.ndarray) -> np.ndarray:
    """The colours (3, P) float64 of the pixels that are observed."""
    return image.reshape(-1, 3)[observed().pixels].T.astype(np.float64)


def made_observations(
    n_pixels: int = 60, noise: float = 0.0
) -> tuple[Observations, np.ndarray]:
    """Pixels seen 1 to 6 times at 1 to 10 m in the made water, the last ten once only; and their colours (3, P)."""
    return made(n_pixels, 6, noise=noise, n_single=10)


def squared_error(
    observations: Observations, J: torch.Tensor, water: torch.Tensor
) -> torch.Tensor:
    """Eq. 7 for each channel (3,), written down as it stands, float64."""
    place, z, I = (torch.from_numpy(x) for x in flat(observations))
    B, beta, gamma = water[..., None]
    r = I - J[:, place] * torch.exp(-beta * z) - B * (1 - torch.exp(-gamma * z))
    return (r**2).sum(dim=1)


def naive_adam(
    observations: Observations,
    J: np.ndarray,
    steps: int,
    *,
    rows: int = 3,
    divided_by: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Adam on eq. 7 by automatic differentiation, float64, full batch: J and water of the last iterate.

    rows: of the water, 2 for eq. 1: B and its one coefficient.
    """
    unknowns = [
        torch.tensor(x, dtype=torch.float64, requires_grad=True) for x in (J, START[:rows])
    ]
    optimiser = torch.optim.Adam(unknowns, lr=0.05)
    for _ in range(steps):
        optimiser.zero_grad()
        J_now, water = unknowns
        (
            squared_error(observations, J_now, water[[0, 1, rows - 1]]).sum() / divided_by
        ).backward()
        optimiser.step()
    return unknowns[0].detach().numpy(), unknowns[1].detach().numpy()


# -- Adam ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("descend", [descend, descend_on_torch])
def test_shares_of_pixels_make_no_difference(
    descend: Callable[..., Descent], monkeypatch: pytest.MonkeyPatch
) -> None:
    observations, J = made_observations()
    whole = descend(observations, J * 0.7, START, Steps(30, 0.05), "cpu")
    monkeypatch.setattr(adam_loops, "SHARE", 7)
    monkeypatch.setattr(adam_loops, "usable_cores", lambda: 3)
    monkeypatch.setattr(adam, "_BLOCK_PX", 7)
    parts = descend(observations, J * 0.7, START, Steps(30, 0.05), "cpu")
    np.testing.assert_allclose(parts.J, whole.J, atol=2e-6)
    np.testing.assert_allclose(parts.water, whole.water, atol=2e-6)


@pytest.mark.parametrize("is_tied", [False, True])
def test_steps_on_a_gpus_library_are_those_of_the_loops(is_tied: bool) -> None:
    observations, J = made_observations(noise=0.004)
    steps = Steps(200, 0.05, is_tied=is_tied)
    loops, torched = (
        step(observations, J * 0.7, START, steps, "cpu") for step in (descend, descend_on_torch)
    )
    np.testing.assert_allclose(loops.J, torched.J, atol=5e-6)
    np.testing.assert_allclose(loops.water, torched.water, atol=5e-6)
    np.testing.assert_allclose(loops.first, torched.first, rtol=1e-6)
    np.testing.assert_allclose(loops.cost, torched.cost, rtol=1e-5)


# -- the method ------------------------------------------------------------------------------------------------------


def test_a_restoration_says_what_was_done() -> None:
    restored = FEW.restore(SCENE, TARGET)
    initial = squared_error(
        observed(), torch.tensor(colours_of(TARGET.rgb)), torch.tensor(START)
    ).numpy()
    # J = I, B = beta = gamma = .1
    np.testing.assert_allclose(restored.info["initial_cost"], initial, rtol=1e-5)
    assert all(np.array(restored.info["cost"]) < initial)
    assert restored.info["n_observations"] == len(observed())
    assert restored.info["n_views"] == 4
    assert (restored.info["steps"], restored.info["device"]) == (12, "cpu")
    J = restored.image[TARGET.valid]
    np.testing.assert_allclose(restored.info["negative_share"], (J < 0).mean(axis=0))


def test_no_step_of_sucre_is_an_option() -> None:
    options = {field.name for field in fields(SucrePaper)}
    assert options == {
        "fill",
        "steps",
        "lr",
        "objective",
        "start",
        "one_coefficient",
        "device",
    }


@pytest.mark.parametrize(
    ("options", "rows"),
    [
        ({}, 3),
        ({"objective": "mean"}, 3),
        ({"one_coefficient": True}, 2),
    ],
    ids=["defaults", "mean objective", "eq. 1"],
)
def test_a_restoration_is_200_steps_of_adam_on_eq_7(options: dict[str, Any], rows: int) -> None:
    divided_by = 3 * len(observed()) if options.get("objective") == "mean" else 1
    restored = SucrePaper(device="cpu", **options).restore(SCENE, TARGET)
    J, water = naive_adam(
        observed(), colours_of(TARGET.rgb), 200, rows=rows, divided_by=divided_by
    )
    np.testing.assert_allclose(colours_of(restored.image), J, atol=5e-6)
    found = parameters(restored.water)
    np.testing.assert_allclose(table(found)[:rows], water, atol=5e-6)
    assert rows == 3 or (found.beta == found.gamma).all()


@pytest.mark.parametrize("start", ["seathru", "truth"])
def test_adam_starts_from_the_water_of_another_method_or_of_the_dataset(start: str) -> None:
    scene = replace(SCENE, water=WATER)
    water = WATER if start == "truth" else restore("seathru", scene, TARGET.name).water
    restored = SucrePaper(start=start, steps=1, device="cpu").restore(scene, TARGET)
    rows = torch.tensor(table(parameters(water)))
    initial = squared_error(observed(), torch.tensor(colours_of(TARGET.rgb)), rows).numpy()
    np.testing.assert_allclose(restored.info["initial_cost"], initial, rtol=1e-4)
    # a step's size
    np.testing.assert_allclose(
        np.abs(restored.water.attenuation - water.attenuation), 0.05, rtol=1e-4
    )


@pytest.mark.parametrize("start", ["gray_word", "command", "own", ""])
def test_a_start_that_gives_no_water_is_refused_by_its_option(start: str) -> None:
    with pytest.raises(InputError, match=rf"^method\.start(={start})?: "):
        SucrePaper(start=start)


@pytest.mark.parametrize(
    ("record", "known", "remedy"),
    [
        ({"encoding": "linear"}, "a", "one of gamma intensities"),
        ({"gains": {"b.png": 1.0}}, "a", "even light"),
        ({"light": {"parts": ["lens"]}}, "a", r"method\.start=paper"),
        ({}, "z", r"method\.start takes paper, truth, "),
    ],
)
def test_what_is_wrong_with_a_start_is_mended_by_options_of_sucre_paper(
    record: dict[str, object], known: str, remedy: str, tmp_path: Path
) -> None:
    (tmp_path / f"{known}.json").write_text(json.dumps(record_of(WATER) | record))
    with pytest.raises(InputError, match=remedy) as refused:
        restore("sucre_paper", SCENE, TARGET.name, start=str(tmp_path), steps=1)
    assert not re.search(r"\.(encoding|light|water)\b|own|shared", str(refused.value))


def test_a_view_that_no_other_sees_is_restored_from_itself() -> None:
    restored = FEW.restore(Scene("alone", [TARGET], SCENE.has), TARGET)
    assert restored.info["n_views"] == 1
    assert np.isfinite(restored.image[TARGET.valid]).all()


def test_divergence_is_an_error_that_names_the_remedy() -> None:
    with pytest.raises(SolveError, match=r"^a\.png: .* 5 steps; .*\blr \(1000\.0\)"):
        SucrePaper(steps=5, lr=1000.0, device="cpu").restore(SCENE, TARGET)


@pytest.mark.parametrize(
    "options", [{"steps": 0}, {"lr": 0.0}, {"lr": -1.0}, {"lr": float("nan")}]
)
def test_options_that_make_no_sense_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(InputError, match="positive"):
        SucrePaper(**options)


def test_asking_for_a_gpu_that_is_not_there_is_an_error_that_names_the_remedy() -> None:
    if torch.cuda.is_available():
        pytest.skip("there is a GPU here")
    with pytest.raises(InputError, match=r"^method\.device=cuda: .*; .*method\.device=auto"):
        SucrePaper(device="cuda").restore(SCENE, TARGET)
    assert SucrePaper(steps=1).restore(SCENE, TARGET).info["device"] == "cpu"


def test_a_gpu_gives_what_the_cpu_gives() -> None:
    if not torch.cuda.is_available():
        pytest.skip("needs a CUDA GPU")
    cpu, gpu = (SucrePaper(device=device).restore(SCENE, TARGET) for device in ("cpu", "cuda"))
    np.testing.assert_allclose(gpu.image, cpu.image, atol=1e-4)
    np.testing.assert_allclose(gpu.info["cost"], cpu.info["cost"], rtol=1e-3)
