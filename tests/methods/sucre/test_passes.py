"""The passes over all observations: every backend against float64, and float64 against the model written densely."""

import contextlib
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from support.made_ground import WATERS, make_ground
from support.made_observations import (
    ONE_MODEL,
    flat,
    made,
    parameters,
    reduced_residuals,
    table,
)

from sucre_bench.errors import InputError
from sucre_bench.methods.sucre import Sucre
from sucre_bench.methods.sucre.model import ReducedSystem, WaterParameters
from sucre_bench.methods.sucre.passes import (
    WALL,
    Kernel,
    blocks,
    fill,
    opened,
    products,
    products_on_gpu,
)
from sucre_bench.multiview.observations import Observations

pytestmark = pytest.mark.short

BACKENDS = ["numpy", "numba", "torch", "jax"]
SINGLE = BACKENDS[1:]  # those that compute in float32
# Near made_scene's, not at the minimum: rows RGB, columns B, beta, gamma.
ROWS = np.array([[0.08, 0.38, 0.27], [0.25, 0.16, 0.2], [0.33, 0.12, 0.11]])
WATER = WaterParameters.of_channels(ROWS)
MARGIN = np.array([0.02, 0.05, 0.01])
NOISE = np.array([0.01, 0.02, 0.005])


def system(
    observations: Observations, backend: Any, margin: np.ndarray | None = None
) -> ReducedSystem:
    with opened(observations, backend, "cpu") as kernel:
        return kernel.system(WATER, margin)


def dark(**options: Any) -> Observations:
    """Observations of which many lie below the veil of WATER, so that their colours are negative."""
    return made(600, colours=(-0.1, 0.3), noise=0.02, **options)[0]


def assert_close(found: ReducedSystem, truth: ReducedSystem, rtol: float) -> None:
    """Equal to so many digits: g in units of its Cauchy-Schwarz bound, as its terms cancel near a minimum."""
    size = np.sqrt(np.einsum("cii->ci", truth.H))
    np.testing.assert_allclose(
        found.H / size[:, None], truth.H / size[:, None], rtol=rtol, atol=rtol * size.max()
    )
    np.testing.assert_array_less(
        np.abs(found.H - truth.H), rtol * size[:, :, None] * size[:, None, :] + 1e-30
    )
    np.testing.assert_array_less(
        np.abs(found.K - truth.K), rtol * size[:, :, None] * size[:, None, :] + 1e-30
    )
    np.testing.assert_array_less(
        np.abs(found.g - truth.g), rtol * size * np.sqrt(truth.cost)[:, None] + 1e-30
    )
    np.testing.assert_allclose(found.cost, truth.cost, rtol=rtol)


def dense(
    observations: Observations, c: int, margin: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The products (4, 4) of D' and r by elimination of all J from the full Jacobian, and the colours (P,)."""
    place, z, I = flat(observations)
    B, beta, gamma = ROWS[c]
    w = (
        np.ones(len(z))
        if observations.weight is None
        else np.broadcast_to(observations.weight, I.shape)[c] * np.float64(1)
    )
    a, e = np.exp(-beta * z), np.exp(-gamma * z)
    of_J = np.zeros((len(z), len(observations.pixels)))
    of_J[np.arange(len(z)), place] = a
    root = np.sqrt(w)[:, None]
    J = np.linalg.lstsq(root * of_J, root[:, 0] * (I[c] - B * (1 - e)), rcond=None)[0]
    of_water = np.stack([1 - e, -J[place] * a * z, B * z * e], axis=1)
    r = I[c] - J[place] * a - B * (1 - e)
    jacobian = root * np.hstack([of_water, of_J])
    orthogonal, _ = np.linalg.qr(jacobian[:, 3:])
    columns = np.column_stack([jacobian[:, :3], root[:, 0] * r])
    columns -= orthogonal @ (orthogonal.T @ columns)
    return columns.T @ columns, J


def held_cost(observations: Observations, c: int, water: np.ndarray, margin: float) -> float:
    """The reduced cost of one channel with what holds colours above zero, float64."""
    place, z, I = flat(observations)
    a, y = np.exp(-water[1] * z), I[c] - water[0] * (1 - np.exp(-water[2] * z))
    n = len(observations.pixels)
    A = np.bincount(place, a * a, n)
    short = np.minimum(np.bincount(place, a * y, n) / np.sqrt(A) + margin, 0)
    return float(
        (reduced_residuals(observations, c, water) ** 2).sum() + ((WALL * short) ** 2).sum()
    )


# -- float64 against the model itself ----------------------------------------------------------------------


@pytest.mark.parametrize("weights", [None, 1, 3])
def test_the_system_is_that_of_the_full_jacobian_without_its_colours(
    weights: int | None,
) -> None:
    observations, _ = made(40, noise=0.02)
    if weights:
        weight = (
            np.random.default_rng(1)
            .uniform(0.1, 3, (weights, len(observations)))
            .astype(np.float32)
        )
        observations = replace(observations, weight=weight if weights > 1 else weight[0])
    found = system(observations, "numpy")
    for c in range(3):
        truth, _ = dense(observations, c)
        np.testing.assert_allclose(found.H[c], truth[:3, :3], rtol=1e-9)
        np.testing.assert_allclose(found.g[c], truth[:3, 3], rtol=1e-7, atol=1e-10)
        np.testing.assert_allclose(found.cost[c], truth[3, 3], rtol=1e-9)


def test_g_is_minus_half_the_slope_of_the_reduced_cost() -> None:
    observations = dark(n_single=100)
    found = system(observations, "numpy", MARGIN)
    for c in range(3):
        margin = MARGIN[c]
        step = 1e-5
        for i, towards in enumerate(np.eye(3) * step):
            higher, lower = (
                held_cost(observations, c, ROWS[c] + sign * towards, margin) for sign in (1, -1)
            )
            assert -2 * found.g[c, i] == pytest.approx(
                (higher - lower) / (2 * step), rel=1e-4, abs=1e-5
            )
        assert found.cost[c] == pytest.approx(
            held_cost(observations, c, ROWS[c], margin), rel=1e-9
        )


def test_K_is_minus_the_slope_of_g() -> None:
    observations, step = dark(), 1e-5
    with opened(observations, "numpy", "cpu") as kernel:
        found = kernel.system(WATER)
        for i, towards in enumerate(np.eye(3) * step):
            lower, higher = (
                kernel.system(WaterParameters.of_channels(ROWS + sign * towards)).g
                for sign in (-1, 1)
            )
            np.testing.assert_allclose(
                found.K[:, i], (lower - higher) / (2 * step), rtol=1e-5, atol=1e-6
            )


# -- the backends against float64 --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("backend", "device"),
    [*((backend, "cpu") for backend in SINGLE), ("torch", "cuda"), ("jax", "cuda")],
)
@pytest.mark.parametrize("is_weighted", [False, True])
@pytest.mark.parametrize("distances_m", [(1, 10), (3, 3.3)])
def test_float32_keeps_the_digits_of_the_system_and_of_the_colours(
    backend: Any, device: Any, is_weighted: bool, distances_m: tuple[float, float]
) -> None:
    """The subtracted form of H is wrong by a factor of 9 at 3 to 3.3 m."""
    observations = dark(distances_m=distances_m, n_single=50)
    lost = 7
    if is_weighted:
        observations = with_weights(observations, lost)
    V = np.stack([np.diag([1e-4, 2e-4, 3e-4]) + 5e-5] * 3)
    with contextlib.ExitStack() as stack:
        try:
            kernel = stack.enter_context(opened(observations, backend, device))
        except InputError:
            pytest.skip(f"{backend} sees no GPU")
        exact = stack.enter_context(opened(observations, "numpy", "cpu"))
        for margin in (None, MARGIN):
            assert_close(kernel.system(WATER, margin), exact.system(WATER, margin), 1e-4)
        J, deviation = kernel.colours(WATER, NOISE, V)
        J_exact, deviation_exact = exact.colours(WATER, NOISE, V)
    assert J.dtype == deviation.dtype == np.float32
    np.testing.assert_allclose(J, J_exact, rtol=1e-5, atol=1e-6)
    np.testing.assert_allclose(deviation, deviation_exact, rtol=1e-5, atol=1e-6)
    assert not is_weighted or (J[0, lost], deviation[0, lost]) == (0, np.inf)


def with_weights(observations: Observations, lost: int) -> Observations:
    """With weights of each channel. Some are 0, and all of a pixel in red, whose colour is then unknown."""
    rng = np.random.default_rng(4)
    shape = (3, len(observations))
    weight = (rng.uniform(0.1, 3, shape) * (rng.random(shape) > 0.1)).astype("f4")
    weight[:, : len(observations.pixels)] = weight[:, : len(observations.pixels)].clip(min=0.2)
    weight[0, [part.start + lost for n, part in observations.slots() if n > lost]] = 0
    return replace(observations, weight=weight)


@pytest.mark.parametrize("backend", SINGLE)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_every_type_of_colour_is_read(backend: str, dtype: Any) -> None:
    observations = made(600, noise=0.01)[0]
    scale = 1 if dtype == np.float32 else np.iinfo(dtype).max
    stored = (observations.colour.clip(0, 1) * scale).astype(dtype)
    truth = system(
        replace(observations, colour=(stored / np.float64(scale)).astype(np.float32)), "numpy"
    )
    assert_close(system(replace(observations, colour=stored), backend), truth, 1e-4)


@pytest.mark.parametrize("backend", BACKENDS)
def test_pixels_seen_once_add_nothing_unless_colours_are_held(backend: str) -> None:
    with_singles = dark(n_single=200)
    without = with_singles.take(np.arange(with_singles.n_repeated))
    assert len(without) == len(with_singles) - 200
    assert_close(system(with_singles, backend), system(without, backend), 1e-6)
    # With a margin that nothing falls short of they do take part, and still add nothing.
    assert_close(
        system(with_singles, backend, np.full(3, 10.0)), system(without, backend), 1e-4
    )
    assert (
        system(with_singles, backend, MARGIN).cost > system(without, backend, MARGIN).cost
    ).all()


@pytest.mark.parametrize("backend", BACKENDS)
def test_equal_passes_give_equal_bits_in_many_blocks(backend: str) -> None:
    observations = made(60_000, 5, eight_bit=True)[0]
    first, second = system(observations, backend, MARGIN), system(observations, backend, MARGIN)
    for name in ("H", "g", "cost"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    if backend != "numpy":
        assert_close(first, system(observations, "numpy", MARGIN), 1e-4)


def test_a_block_too_large_for_the_memory_is_halved() -> None:
    observations, sizes = made(600, noise=0.01)[0], []

    def compute(formula: Any, block: Any, *parameters: Any) -> np.ndarray:
        sizes.append(block.n)
        if block.n > 40:
            raise MemoryError
        return np.asarray(formula(*fill(observations, block, np.float64), *parameters))

    kernel = Kernel(observations, "cpu", compute, 1_000)
    with opened(observations, "numpy", "cpu") as exact:
        assert_close(kernel.system(WATER, MARGIN), exact.system(WATER, MARGIN), 1e-9)
        found, truth = (
            each.colours(WATER, NOISE, np.zeros((3, 3, 3)))[0] for each in (kernel, exact)
        )
        np.testing.assert_array_equal(found, truth)
    assert min(sizes) <= 40 < max(sizes)


def test_sums_in_trees_as_on_a_gpu_are_those_of_a_matrix_product() -> None:
    observations = dark()
    block, parameters = (
        blocks(observations, 10_000)[0],
        (ROWS.T[..., None, None], MARGIN[:, None, None]),
    )
    arrays = (*fill(observations, block, np.float64), *parameters)
    np.testing.assert_allclose(products_on_gpu(*arrays), products(*arrays), rtol=1e-12)


def test_every_backend_restores_alike() -> None:
    scene = make_ground(WATERS["milky"], width=80, height=60)
    reference, *others = (
        Sucre(backend=name, **ONE_MODEL).restore(scene, scene["3.png"]) for name in BACKENDS
    )
    for result in others:
        assert result.info["footprint"] is True
        found, exact = (table(parameters(one.water)) for one in (result, reference))
        np.testing.assert_allclose(found, exact, rtol=1e-3)
        np.testing.assert_allclose(
            result.image[result.valid], reference.image[reference.valid], atol=1e-3
        )
