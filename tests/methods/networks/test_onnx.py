"""Networks as ONNX: one that is trained here restores what it never saw, and what models declare is heeded."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx.helper import make_node
from support.made_networks import NOISE, onnx_file
from support.messages import refused

from sucre_bench import Arrays, InputError, Restoration, Scene, View, restore
from sucre_bench.errors import MissingFileError
from sucre_bench.methods.networks.onnx import opened
from sucre_bench.methods.networks.sizes import resized
from sucre_bench.plugins.options import source_hash

SAME = make_node("Identity", ["x"], ["y"])


def result(rgb: np.ndarray, **options: Any) -> Restoration:
    view = View("a.png", Arrays(rgb))
    return restore("onnx", Scene("s", [view], frozenset()), view, **options)


def restored(rgb: np.ndarray, **options: Any) -> np.ndarray:
    return result(rgb, **options).image


def constants(**values: Any) -> dict[str, np.ndarray]:
    return {name: np.asarray(value) for name, value in values.items()}


# -- a network from training to scores ---------------------------------------------------------------------


# -- orders, layouts, ranges -------------------------------------------------------------------------------

GAIN = np.float32([0.9, 0.5, 0.1])


@pytest.mark.parametrize("order", ["rgb", "bgr"])
@pytest.mark.parametrize("layout", ["nchw", "nhwc"])
@pytest.mark.parametrize("told", [True, False])
def test_channels_reach_the_network_in_its_order_and_come_back_in_ours(
    order: str, layout: str, told: bool, tmp_path: Path
):
    gain = GAIN.reshape((1, 3, 1, 1) if layout == "nchw" else (1, 1, 1, 3))
    shape = (
        ("n", "c", "h", "w")
        if told
        else (1, 3, "h", "w")
        if layout == "nchw"
        else (1, "h", "w", 3)
    )
    path = onnx_file(
        tmp_path / "gain.onnx", [make_node("Mul", ["x", "g"], ["y"])], constants(g=gain), shape
    )
    image = restored(NOISE, model=path, order=order, layout=layout if told else "auto")
    np.testing.assert_allclose(
        image, NOISE * (GAIN if order == "rgb" else GAIN[::-1]), atol=1e-6
    )


def test_a_network_is_given_its_range_and_its_answer_is_brought_back(tmp_path: Path):
    mean, deviation = np.float32([0.485, 0.456, 0.406]), np.float32([0.229, 0.224, 0.225])
    given = {
        "unit": NOISE,
        "symmetric": 2 * NOISE - 1,
        "bytes": 255 * NOISE,
        "imagenet": (NOISE - mean) / deviation,
    }
    path = onnx_file(tmp_path / "same.onnx", [SAME])
    for name, expected in given.items():
        if name != "bytes":
            seen = restored(NOISE, model=path, range=name, output_range="unit")
            np.testing.assert_allclose(seen, expected, rtol=1e-5, atol=1e-5)
        np.testing.assert_allclose(restored(NOISE, model=path, range=name), NOISE, atol=1e-6)
    with pytest.raises(InputError, match="divide by 255"):
        restored(NOISE, model=path, range="bytes", output_range="unit")
    np.testing.assert_allclose(
        restored(NOISE, model=path, output_range="symmetric"), (NOISE + 1) / 2, atol=1e-6
    )


def test_whole_numbers_are_rounded_and_need_their_range(tmp_path: Path):
    path = onnx_file(tmp_path / "u8.onnx", [SAME], dtype="UINT8", output_dtype="UINT8")
    image = restored(NOISE, model=path, range="bytes")
    np.testing.assert_allclose(image, np.rint(255 * NOISE) / 255, atol=1e-6)
    with pytest.raises(InputError, match=r"u8\.onnx: .*onnx\.range=bytes"):
        restored(NOISE, model=path)


# -- sizes -------------------------------------------------------------------------------------------------


def test_a_model_of_one_size_gets_every_view_at_that_size(tmp_path: Path):
    path = onnx_file(tmp_path / "fixed.onnx", [SAME], shape=(1, 3, 32, 48))
    got = result(NOISE, model=path)
    assert got.info["worked_at"] == "32x48"
    np.testing.assert_allclose(got.image, resized(resized(NOISE, 32, 48), 20, 24), atol=1e-6)
    with pytest.raises(InputError, match=r"works at 32x48 only.*method.size=64"):
        restored(NOISE, model=path, size=64)


def halves(path: Path, scale: float) -> Path:
    """A model that halves the picture and enlarges it again: it fails nowhere, and loses a row of an odd height."""
    nodes = [
        make_node("AveragePool", ["x"], ["h"], kernel_shape=[2, 2], strides=[2, 2]),
        make_node("Resize", ["h", "", "s"], ["y"], mode="nearest"),
    ]
    return onnx_file(path, nodes, constants(s=np.float32([1, 1, scale, scale])))


def test_sizes_that_a_network_does_not_take_are_mirrored_up_to_a_multiple(tmp_path: Path):
    path, image = halves(tmp_path / "halves.onnx", 2), NOISE[:19]
    expected = np.pad(image, ((0, 1), (0, 0), (0, 0)), mode="symmetric")
    expected = (
        expected.reshape(10, 2, 12, 2, 3).mean((1, 3)).repeat(2, axis=0).repeat(2, axis=1)[:19]
    )
    np.testing.assert_allclose(restored(image, model=path, multiple=2), expected, atol=1e-6)
    with pytest.raises(InputError, match=r"makes 18x24 of 19x24.*method.multiple"):
        restored(image, model=path)


# -- files -------------------------------------------------------------------------------------------------


def made(*nodes: Any, **options: Any) -> Callable[[Path], object]:
    """Return what makes a model of these nodes."""
    return lambda path: onnx_file(path, nodes or [SAME], **options)


BAD: dict[str, tuple[Callable[[Path], object], set[str]]] = {
    "no model": (lambda path: path.write_text("hello"), {"onnxruntime"}),
    "two inputs": (
        made(make_node("Add", ["x", "z"], ["y"]), inputs=("x", "z")),
        {"'x'", "'z'", "one"},
    ),
    "two outputs": (
        made(SAME, make_node("Neg", ["x"], ["mask"]), outputs=("y", "mask")),
        {"y", "mask", "method.output=y"},
    ),
    "no picture": (made(shape=("n", 3)), {"?x3", "one"}),
    "gray": (made(shape=(1, 1, "h", "w")), {"1x1x?x?", "3", "channels"}),
    "a batch": (made(shape=(4, 3, "h", "w")), {"4x3x?x?", "one"}),
    "open": (made(shape=("n", "c", "h", "w")), {"channels", "method.layout=nchw"}),
    "half open": (made(shape=(1, 3, 256, "w")), {"1x3x256x?", "open"}),
    "words": (made(dtype="INT64", output_dtype="INT64"), {"tensor(int64)"}),
    "gray answer": (
        made(make_node("ReduceMean", ["x"], ["y"], axes=[1])),
        {"'y'", "(1, 1, 20, 24)"},
    ),
    "fails": (
        made(make_node("Reshape", ["x", "s"], ["y"]), constants=constants(s=[1, 3, 7, 7])),
        {"20x24", "method.size"},
    ),
}


@pytest.mark.parametrize(("write", "named"), BAD.values(), ids=BAD)
def test_a_model_that_cannot_be_used_is_named_with_its_fault_on_one_line(
    write: Callable[[Path], object], named: set[str], tmp_path: Path
):
    path = tmp_path / "given.onnx"
    write(path)
    with refused(str(path), *named):
        restored(NOISE, model=path)


def test_a_model_that_is_not_there_is_a_missing_file(tmp_path: Path):
    path = tmp_path / "given.onnx"
    with refused(str(path), "method.model", error=MissingFileError):
        restored(NOISE, model=path)


def test_one_of_several_outputs_is_taken_by_name(tmp_path: Path):
    path = onnx_file(
        tmp_path / "two.onnx",
        [SAME, make_node("Neg", ["x"], ["minus"])],
        outputs=("y", "minus"),
    )
    np.testing.assert_allclose(restored(NOISE, model=path, output="minus"), -NOISE, atol=1e-6)
    with pytest.raises(InputError, match=r"'minos'; .*'minus'"):
        restored(NOISE, model=path, output="minos")


def with_weights_in(told: str, path: Path) -> Path:
    """A model that takes its weights, ones, from the file it names."""
    import onnx

    gain = constants(g=np.ones((1, 3, 1, 1), np.float32))
    model = onnx.load(onnx_file(path, [make_node("Mul", ["x", "g"], ["y"])], gain))
    weights = model.graph.initializer[0]
    weights.ClearField("raw_data")
    weights.data_location = onnx.TensorProto.EXTERNAL
    weights.external_data.add(key="location", value=told)
    path.write_bytes(model.SerializeToString())
    return path


def test_a_model_reads_weights_beside_it_and_no_file_outside_of_its_folder(tmp_path: Path):
    (tmp_path / "models").mkdir()
    for place in (tmp_path, tmp_path / "models"):
        (place / "ones.bin").write_bytes(np.ones(3, np.float32).tobytes())
    path = tmp_path / "models" / "m.onnx"
    np.testing.assert_array_equal(
        restored(NOISE, model=with_weights_in("ones.bin", path)), NOISE
    )
    for told in ("../ones.bin", str(tmp_path / "ones.bin")):
        with pytest.raises(InputError, match=r"m\.onnx: onnxruntime "):
            restored(NOISE, model=with_weights_in(told, path))


def test_a_model_is_opened_once_and_again_when_its_file_changes(tmp_path: Path):
    path = onnx_file(tmp_path / "m.onnx", [SAME])
    first = opened(path, "auto", "auto", "")
    assert opened(path, "auto", "auto", "") is first
    onnx_file(path, [make_node("Neg", ["x"], ["y"])])
    np.testing.assert_allclose(restored(NOISE, model=path), -NOISE, atol=1e-6)


def test_a_model_may_be_given_as_its_folder_so_that_all_of_its_files_count(tmp_path: Path):
    (tmp_path / "ones.bin").write_bytes(np.ones(3, np.float32).tobytes())
    with pytest.raises(InputError, match=r"none; .*method\.model"):
        restored(NOISE, model=tmp_path)
    path = with_weights_in("ones.bin", tmp_path / "m.onnx")
    np.testing.assert_array_equal(restored(NOISE, model=tmp_path), NOISE)
    before = source_hash(files=[tmp_path])
    os.utime(tmp_path / "ones.bin", ns=(0, 10**18))
    assert source_hash(files=[tmp_path]) != before
    path.with_name("n.onnx").write_bytes(path.read_bytes())
    with pytest.raises(InputError, match=r"m\.onnx, n\.onnx; .*method\.model"):
        restored(NOISE, model=tmp_path)


def test_a_gpu_that_is_not_there_is_an_error(tmp_path: Path):
    import onnxruntime

    if "CUDAExecutionProvider" in onnxruntime.get_available_providers():
        pytest.skip("this machine has a GPU")
    with pytest.raises(InputError, match="no GPU"):
        restored(NOISE, model=onnx_file(tmp_path / "m.onnx", [SAME]), device="cuda")
