"""The published networks: their layers by hand in float64, their files, the sizes they are brought to."""

from __future__ import annotations

import pickle
import shutil
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from support.made_networks import ARCHITECTURES, random_state, weights_file
from torch.nn import functional

from sucre_bench import Arrays, InputError, Scene, View, restore
from sucre_bench.imaging.filters.lab import equalised
from sucre_bench.imaging.filters.white_balance import stretched_by_weakness
from sucre_bench.methods.networks import architectures, funie_gan, water_net
from sucre_bench.methods.networks.sizes import limited, resized, tiled
from sucre_bench.methods.networks.water_net import WaterNet
from sucre_bench.methods.networks.weights import read_state

RNG = np.random.default_rng(0)
NOISE = RNG.random((20, 24, 3), dtype=np.float32)
OWN_SIZE = {"water_net": {}, "funie_gan": {"size": None}, "tacl": {}}


def restored(method: str, rgb: np.ndarray, **options: Any) -> np.ndarray:
    view = View("a.png", Arrays(rgb))
    return restore(method, Scene("s", [view], frozenset()), view, **options).image


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("weights")
    return {method: weights_file(method, folder) for method in ARCHITECTURES}


def saved(path: Path, state: dict[str, Any]) -> Path:
    torch.save(state, path)
    return path


# -- the architectures -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("architecture", "parameters"),
    # Sums over the published layers; the last is also what public logs of that generator print.
    [("WaterNet", 1_090_668), ("FunieGenerator", 7_019_587), ("TaclGenerator", 11_378_179)],
)
def test_an_architecture_has_as_many_parameters_as_the_published_one(architecture: str, parameters: int):
    with torch.device("meta"):
        network = getattr(architectures, architecture)()
    assert sum(p.numel() for p in network.parameters()) == parameters


@pytest.mark.parametrize(
    ("architecture", "key", "shape"),
    [
        ("WaterNet", "cmg.conv1.weight", (128, 12, 7, 7)),
        ("WaterNet", "cmg.conv8.bias", (3,)),
        ("WaterNet", "gc_refiner.conv3.weight", (3, 32, 3, 3)),
        ("FunieGenerator", "down1.model.0.weight", (32, 3, 4, 4)),
        ("FunieGenerator", "down2.model.1.running_mean", (128,)),
        ("FunieGenerator", "up1.model.0.weight", (256, 256, 4, 4)),
        ("FunieGenerator", "final.2.weight", (3, 64, 4, 4)),
        ("TaclGenerator", "model.1.weight", (64, 3, 7, 7)),
        ("TaclGenerator", "model.10.conv_block.1.weight", (256, 256, 3, 3)),
        ("TaclGenerator", "model.18.conv_block.5.bias", (256,)),
        ("TaclGenerator", "model.19.weight", (256, 128, 3, 3)),
        ("TaclGenerator", "model.26.bias", (3,)),
    ],
)
def test_keys_are_those_of_the_public_checkpoints(architecture: str, key: str, shape: tuple[int, ...]):
    with torch.device("meta"):
        network = getattr(architectures, architecture)()
    assert tuple(network.state_dict()[key].shape) == shape


def planes(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(rgb.astype(np.float64).transpose(2, 0, 1)[None].copy())


def picture(x: torch.Tensor) -> np.ndarray:
    return x[0].numpy().transpose(1, 2, 0)


def water_net_by_hand(w: dict[str, torch.Tensor], images: list[torch.Tensor]) -> torch.Tensor:
    def stack(name: str, x: torch.Tensor, n: int) -> torch.Tensor:
        for i in range(1, n + 1):
            weight = w[f"{name}.conv{i}.weight"]
            x = functional.conv2d(x, weight, w[f"{name}.conv{i}.bias"], padding=weight.shape[-1] // 2)
            x = torch.sigmoid(x) if (name, i) == ("cmg", 8) else x.clamp(min=0)
        return x

    raw, wb, ce, gc = images
    maps = stack("cmg", torch.cat([raw, wb, ce, gc], 1), 8)
    named = {"wb_refiner": wb, "ce_refiner": ce, "gc_refiner": gc}
    refined = [stack(name, torch.cat([raw, image], 1), 3) for name, image in named.items()]
    return refined[0] * maps[:, :1] + refined[1] * maps[:, 1:2] + refined[2] * maps[:, 2:]


def funie_by_hand(w: dict[str, torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    def batch_norm(x: torch.Tensor, name: str) -> torch.Tensor:
        mean, var, gain, shift = (
            w[f"{name}.{part}"][:, None, None] for part in ("running_mean", "running_var", "weight", "bias")
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
    return torch.tanh(functional.conv2d(functional.pad(x, (2, 1, 2, 1)), w["final.2.weight"], w["final.2.bias"]))


def tacl_by_hand(w: dict[str, torch.Tensor], x: torch.Tensor) -> torch.Tensor:
    def norm(x: torch.Tensor) -> torch.Tensor:
        return (x - x.mean((2, 3), keepdim=True)) / (x.var((2, 3), keepdim=True, correction=0) + 1e-5).sqrt()

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
        x = norm(functional.conv_transpose2d(x, weight, bias, stride=2, padding=1, output_padding=1)).clamp(min=0)
    return torch.tanh(conv(x, "model.26", 3))


def in_float64(path: Path) -> dict[str, torch.Tensor]:
    return {key: value.double() for key, value in read_state(path).items()}


def test_funie_gan_gives_what_its_layers_give_by_hand(files: dict[str, Path]):
    rgb = np.pad(NOISE, ((0, 12), (0, 8), (0, 0)), mode="symmetric")
    by_hand = picture((funie_by_hand(in_float64(files["funie_gan"]), 2 * planes(rgb) - 1) + 1) / 2)[:20, :24]
    assert by_hand.std() > 0.05  # it does not saturate
    image = restored("funie_gan", NOISE, weights=files["funie_gan"], size=None)
    np.testing.assert_allclose(image, by_hand, atol=2e-5)


def test_tacl_gives_what_its_layers_give_by_hand(files: dict[str, Path]):
    rgb = NOISE[:16, :20]
    by_hand = picture((tacl_by_hand(in_float64(files["tacl"]), 2 * planes(rgb) - 1) + 1) / 2)
    assert by_hand.std() > 0.05
    np.testing.assert_allclose(restored("tacl", rgb, weights=files["tacl"]), by_hand, atol=2e-4)


def test_water_net_gives_what_its_layers_give_by_hand(files: dict[str, Path]):
    inputs = [NOISE, NOISE[::-1], NOISE[:, ::-1], 1 - NOISE]
    by_hand = picture(water_net_by_hand(in_float64(files["water_net"]), [planes(image) for image in inputs]))
    network = water_net.loaded("WaterNet", files["water_net"], "cpu")
    np.testing.assert_allclose(network(np.concatenate(inputs, axis=-1)), by_hand, atol=2e-5)


# -- what they are given and what is made of it ------------------------------------------------------------


@pytest.mark.parametrize("chosen", ["wb", "ce", "gc"])
def test_water_net_with_passing_weights_returns_the_derived_image_of_that_branch(chosen: str, tmp_path: Path):
    """Order of branches and of colours: one map open, refiners that hand their second image on."""
    state = {key: torch.zeros_like(value) for key, value in random_state("WaterNet").items()}
    state["cmg.conv8.bias"] = torch.tensor([40.0 if name == chosen else -40.0 for name in ("wb", "ce", "gc")])
    for name in ("wb", "ce", "gc"):
        for c in range(3):
            state[f"{name}_refiner.conv1.weight"][c, 3 + c, 3, 3] = 1
            state[f"{name}_refiner.conv2.weight"][c, c, 2, 2] = 1
            state[f"{name}_refiner.conv3.weight"][c, c, 1, 1] = 1
    rgb = (NOISE * np.float32([0.2, 0.6, 0.9])).repeat(2, axis=0).repeat(2, axis=1)
    image = restored("water_net", rgb, weights=saved(tmp_path / "passing.pth", state))
    expected = {"wb": stretched_by_weakness(rgb), "ce": equalised(rgb, 3.56, 8), "gc": rgb.astype(np.float64) ** 0.7}
    np.testing.assert_allclose(image, expected[chosen], atol=1e-6)


@pytest.mark.parametrize("method", ["funie_gan", "tacl"])
def test_a_networks_minus_one_is_black_and_its_one_is_white_whatever_else_is_in_the_picture(
    method: str, tmp_path: Path, files: dict[str, Path]
):
    """A common script stretches input and output together to [0, 1] on saving: that is not the network's colour."""
    state = read_state(files[method])
    last = "final.2" if method == "funie_gan" else "model.26"
    state[f"{last}.weight"].zero_()
    state[f"{last}.bias"] = torch.tensor([-0.5, 0.0, 0.5])
    image = restored(method, NOISE, weights=saved(tmp_path / "last.pth", state), **OWN_SIZE[method])
    np.testing.assert_allclose(image, np.broadcast_to((np.tanh([-0.5, 0, 0.5]) + 1) / 2, NOISE.shape), atol=1e-6)


def test_funie_gan_sees_every_view_at_256_pixels_unless_told_otherwise(files: dict[str, Path]):
    view = View("a.png", Arrays(NOISE))
    result = restore("funie_gan", Scene("s", [view], frozenset()), view, weights=files["funie_gan"])
    assert result.info["worked_at"] == "256x256"
    square = restored("funie_gan", resized(NOISE, 256, 256), weights=files["funie_gan"], size=None)
    np.testing.assert_allclose(result.image, resized(square, 20, 24), atol=1e-5)


HARD = {
    "noise": NOISE,
    "black": np.zeros_like(NOISE),
    "white": np.ones_like(NOISE),
    "no red": NOISE * np.float32([0, 1, 1]),
    "tiny": NOISE[:4, :6],
    "gray": np.full_like(NOISE, 0.5),
    "a pixel": NOISE[:1, :1],
}


@pytest.mark.parametrize("kind", HARD)
@pytest.mark.parametrize("method", ARCHITECTURES)  # the outer one: a network is loaded once
def test_every_image_gets_finite_colours_at_its_own_size(method: str, kind: str, files: dict[str, Path]):
    image = restored(method, HARD[kind], weights=files[method], **OWN_SIZE[method])
    assert image.shape == HARD[kind].shape
    assert image.dtype == np.float32
    assert np.isfinite(image).all()


@pytest.mark.parametrize("method", ARCHITECTURES)
def test_a_network_gives_the_same_twice_and_leaves_torch_as_it_was(method: str, files: dict[str, Path], tmp_path: Path):
    weights = shutil.copy(files[method], tmp_path)  # a new file is loaded, which may not draw random numbers either
    before = torch.get_rng_state(), torch.get_num_threads(), torch.get_default_device(), torch.is_grad_enabled()
    first, second = (restored(method, NOISE, weights=weights, **OWN_SIZE[method]) for _ in "12")
    np.testing.assert_array_equal(first, second)
    assert torch.equal(before[0], torch.get_rng_state())
    assert before[1:] == (torch.get_num_threads(), torch.get_default_device(), torch.is_grad_enabled())


def test_a_file_that_changes_is_read_again(tmp_path: Path):
    path = saved(tmp_path / "w.pth", random_state("WaterNet", 1))
    first = restored("water_net", NOISE, weights=path)
    saved(path, random_state("WaterNet", 2))
    assert not np.allclose(first, restored("water_net", NOISE, weights=path))


def test_a_longest_side_scales_larger_views_down_and_no_view_up(files: dict[str, Path]):
    assert limited(4000, 6000, 1200) == (800, 1200)
    assert limited(20, 30, 1200) == limited(20, 30, None) == (20, 30)
    assert limited(1, 5000, 10) == (1, 10)
    small = restored("water_net", NOISE, weights=files["water_net"], longest_side=12)
    at_10x12 = restored("water_net", resized(NOISE, 10, 12).clip(0, 1), weights=files["water_net"])
    np.testing.assert_allclose(small, resized(at_10x12, 20, 24), atol=1e-5)


def test_a_gpu_that_is_not_there_is_an_error_and_auto_goes_without(files: dict[str, Path]):
    if torch.cuda.is_available():
        pytest.skip("this machine has a GPU")
    with pytest.raises(InputError, match="no GPU"):
        restored("water_net", NOISE, weights=files["water_net"], device="cuda")


# -- sizes and tiles ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [(7, 11), (20, 24), (61, 90)])
def test_resizing_is_the_bicubic_that_does_not_alias(size: tuple[int, int]):
    expected = functional.interpolate(planes(NOISE), size=size, mode="bicubic", antialias=True, align_corners=False)
    np.testing.assert_allclose(resized(NOISE, *size), picture(expected), atol=2e-3)


def test_an_image_of_the_right_size_needs_no_library_to_resize_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "PIL", None)
    assert resized(NOISE, 20, 24) is NOISE
    assert {"PIL", "torch"} <= set(WaterNet.__plugin__.requires)


@pytest.mark.parametrize("shape", [(1, 1), (4, 6), (64, 64), (65, 200), (97, 131)])
@pytest.mark.parametrize("multiple", [1, 8])
def test_tiles_of_an_unchanged_image_add_up_to_the_image(shape: tuple[int, int], multiple: int):
    image, sizes = RNG.random((*shape, 3), dtype=np.float32), []

    def same(x: np.ndarray) -> np.ndarray:
        sizes.append(x.shape[:2])
        return x

    np.testing.assert_allclose(tiled([image], same, 64, 16, multiple, least=8), image, atol=1e-6)
    assert all(8 <= n <= 64 and n % multiple == 0 for size in sizes for n in size)


def test_tiles_join_without_a_step():
    """Each tile has a value of its own: between two, what is left of them changes over half of the overlap."""
    value = iter(range(100))
    image = tiled([np.zeros((1, 300, 3), np.float32)], lambda x: np.full_like(x, next(value)), 100, 40)
    steps = np.diff(image[0, :, 0])
    assert image[0, 0, 0] == 0
    assert image[0, -1, 0] == next(value) - 1
    assert steps.min() >= 0
    assert steps.max() <= 1 / 20 + 1e-6


def test_tiles_equal_the_whole_where_the_network_sees_no_further_than_a_quarter_of_their_overlap():
    kernel = torch.from_numpy(RNG.normal(size=(3, 3, 9, 9)).astype(np.float32))

    def blur(x: np.ndarray) -> np.ndarray:  # sees 4 pixels to each side
        given = torch.from_numpy(x.transpose(2, 0, 1)[None].copy())
        return functional.conv2d(given, kernel, padding=4)[0].numpy().transpose(1, 2, 0)

    image = RNG.random((70, 110, 3), dtype=np.float32)
    np.testing.assert_allclose(tiled([image], blur, 48, 16), blur(image), atol=1e-4)
    assert not np.allclose(tiled([image], blur, 48, 4), blur(image), atol=1e-2)


@pytest.mark.parametrize(
    ("architecture", "size", "overlap"),
    [("WaterNet", 64, water_net.OVERLAP), ("FunieGenerator", 288, funie_gan.OVERLAP)],
)
def test_a_network_sees_no_further_than_a_quarter_of_its_overlap(architecture: str, size: int, overlap: int):
    with torch.device("meta"):
        network = getattr(architectures, architecture)()
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


# -- files -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wrap", ["bare", "state_dict", "model", "params", "netG", "both", "module.", "legacy"])
def test_state_dicts_are_read_as_they_are_saved(wrap: str, tmp_path: Path):
    state = random_state("WaterNet")
    content: dict[str, Any] = {wrap: state, "epoch": 95, "optimizer": {"lr": 1e-4}}
    if wrap == "module.":
        content = {f"module.{key}": value for key, value in state.items()}
    elif wrap == "both":
        content = {"epoch": 95, "net": {"state_dict": {f"module.{key}": value for key, value in state.items()}}}
    elif wrap in ("bare", "legacy"):
        content = state
    path = tmp_path / "w.pth"
    torch.save(content, path, _use_new_zipfile_serialization=wrap != "legacy")
    found = read_state(path)
    assert list(found) == list(state)
    assert all(torch.equal(found[key], state[key]) for key in state)


def test_weights_without_counters_of_batches_or_in_half_precision_do_as_well(tmp_path: Path, files: dict[str, Path]):
    state = {key: value.half() for key, value in read_state(files["funie_gan"]).items() if "num_batches" not in key}
    image = restored("funie_gan", NOISE, weights=saved(tmp_path / "w.pth", state), size=None)
    full = restored("funie_gan", NOISE, weights=files["funie_gan"], size=None)
    np.testing.assert_allclose(image, full, atol=0.02)


class Trap:
    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return Path.touch, (self.path,)


def bad_file(kind: str, path: Path) -> None:
    state = random_state("WaterNet")
    whole = path.with_name("whole.pth")
    torch.save(state, whole)
    first = "cmg.conv1.weight"
    if kind == "missing":
        return
    if kind in ("web page", "empty", "text", "cut", "pickle"):
        trap = pickle.dumps({"state_dict": Trap(path.with_name("sprung"))})
        content = {"web page": b"\n<!DOCTYPE html><html>", "empty": b"", "text": b"hello\n" * 99, "pickle": trap}
        path.write_bytes(content.get(kind, whole.read_bytes()[:100_000]))
    elif kind == "folder":
        path.mkdir()
    elif kind == "module":
        with torch.device("meta"):
            torch.save(architectures.WaterNet(), path)
    elif kind == "trap":
        torch.save({"state_dict": state, "further": Trap(path.with_name("sprung"))}, path)
    elif kind == "list":
        torch.save([1, 2], path)
    elif kind == "no tensors":
        torch.save({"epoch": 3}, path)
    elif kind == "script":
        torch.jit.trace(torch.nn.ReLU(), torch.ones(1)).save(str(path))
    elif kind == "other network":
        torch.save(random_state("FunieGenerator"), path)
    elif kind == "further":
        torch.save({**state, "cmg.conv9.bias": torch.ones(3)}, path)
    elif kind == "shape":
        torch.save({**state, first: torch.ones(128, 9, 7, 7)}, path)
    else:
        torch.save({**state, first: torch.full_like(state[first], float("nan"))}, path)


@pytest.mark.filterwarnings("ignore:`torch.jit")
@pytest.mark.parametrize(
    ("kind", "says"),
    {
        "missing": "no such file",
        "folder": "is a folder",
        "web page": "is a web page",
        "empty": "is empty",
        "text": "no PyTorch file, or cut short",
        "cut": "no PyTorch file, or cut short",
        "pickle": "no PyTorch file|Python object",
        "module": r"Python object, .*WaterNet.*state_dict\(\)",
        "trap": r"Python object.*state_dict\(\)",
        "list": "no state dict but list",
        "no tensors": "no state dict but dict",
        "script": "TorchScript.*method=onnx",
        "other network": "not the weights of WaterNet, it lacks 'cmg.conv1.weight' 128x12x7x7",
        "further": "WaterNet, which has no 'cmg.conv9.bias'",
        "shape": "'cmg.conv1.weight' is 128x9x7x7 and not 128x12x7x7",
        "not finite": "'cmg.conv1.weight' holds numbers that are not finite",
    }.items(),
)
def test_a_file_that_cannot_be_used_is_named_with_its_fault_and_runs_nothing(kind: str, says: str, tmp_path: Path):
    path = tmp_path / "given.pth"
    bad_file(kind, path)
    with pytest.raises(InputError, match=says) as fault:
        restored("water_net", NOISE, weights=path)
    assert str(path) in str(fault.value)
    assert "\n" not in str(fault.value)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize(
    ("method", "options"),
    [
        ("funie_gan", {"size": 100}),
        ("funie_gan", {"size": 0}),
        ("water_net", {"longest_side": 0}),
        ("water_net", {"clahe_clip": 0.0}),
        ("water_net", {"clahe_clip": float("nan")}),
        ("water_net", {"clahe_clip": float("inf")}),
        ("tacl", {"longest_side": -1}),
    ],
)
def test_options_out_of_range_are_refused_before_any_work(method: str, options: dict[str, Any], files: dict[str, Path]):
    with pytest.raises(InputError, match=next(iter(options))):
        restored(method, NOISE, weights=files[method], **options)


@pytest.mark.parametrize("method", ARCHITECTURES)
def test_the_weights_must_be_given(method: str):
    with pytest.raises(InputError, match="weights: must be given"):
        restored(method, NOISE)
