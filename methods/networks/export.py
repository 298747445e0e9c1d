"""Makes files that `onnx` and the published networks read, from files of others. Nothing of a weights file is run.

    python -m sucre_bench.methods.networks.export WEIGHTS NEW.pt
    python -m sucre_bench.methods.networks.export WEIGHTS NEW.onnx MODULE:CLASS [OPTION=NUMBER]... [at=HEIGHTxWIDTH]

The first saves the tensors alone, of a file that holds more, for example the options of training, an optimiser or a
whole module. The second makes the network of an author's code and exports it; run it in the folder of that code, which
is imported. It needs torch and onnx. at: the network works at this size alone, if torch cannot export it for any.
"""

import importlib
import io
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sucre_bench.errors import InputError, SucreBenchError, one_line
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.machine.provenance import require
from sucre_bench.methods.networks.run_torch import UNREADABLE, UNREADABLE_REMEDY, UNSAFE, bare

if TYPE_CHECKING:
    import torch

_SIDE = 256  # pixels, of the picture that the export follows through the network; a multiple of most networks' steps


class _StandIn:
    """Takes the place of an object of the file: it keeps the object's state, and runs nothing."""

    def __init__(self, *given: Any, **named: Any) -> None:
        self.state: Any = None

    def __setstate__(self, state: Any) -> None:
        self.state = state


def tensors(path: Path) -> dict[str, "torch.Tensor"]:
    """Return the state dict in a file of weights, whatever else it holds. Raises InputError if there is none.

    torch reads with weights_only=True, and gives a stand-in for each object that is no tensor. Of a whole module the
    parameters are taken from its state.
    """
    import torch

    regular(path, "give the author's file of weights")
    stand_ins: dict[str, type] = {}
    while True:
        try:
            with torch.serialization.safe_globals(
                [(made, name) for name, made in stand_ins.items()]
            ):
                content = torch.load(path, map_location="cpu", weights_only=True)
        except Exception as fault:  # pickle, zip and torch each have their own
            unsafe = re.search(UNSAFE, str(fault))
            if not unsafe:
                raise InputError(UNREADABLE, path, UNREADABLE_REMEDY) from fault
            if unsafe[1] in stand_ins:
                raise InputError(
                    f"is not read, {unsafe[0]}", path, "save the network's state_dict()"
                ) from fault
            stand_ins[unsafe[1]] = type("_Object", (_StandIn,), {})
        else:
            return bare(
                dict(_of_module(content)) if isinstance(content, _StandIn) else content, path
            )


def _of_module(module: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """The parameters of a whole module, and what it holds, by their keys in its state dict."""
    state = (
        module.state
        if isinstance(module, _StandIn) and isinstance(module.state, Mapping)
        else {}
    )
    left_out = state.get("_non_persistent_buffers_set", ())
    for name, value in {**state.get("_parameters", {}), **state.get("_buffers", {})}.items():
        if value is not None and name not in left_out:
            yield prefix + name, value
    for name, inner in state.get("_modules", {}).items():
        yield from _of_module(inner, f"{prefix}{name}.")


def export(
    weights: Path, target: Path, network: str, options: Mapping[str, Any], at: str = ""
) -> None:
    """Write a network of the code in the current folder as ONNX, of any height and width, or of "480x640".

    network: "package.module:Class"; options: its arguments. Raises InputError if the network cannot be made or
    exported, or the weights are not the network's.
    """
    import torch

    sys.path.insert(0, str(Path.cwd()))
    module, _, name = network.partition(":")
    try:
        made: torch.nn.Module = getattr(importlib.import_module(module), name)(**options)
    except Exception as fault:  # of others' code
        remedy = "run this in the folder of its code, and give MODULE:CLASS and the options that it needs"
        raise InputError(f"cannot be made, {one_line(fault)}", network, remedy) from fault
    try:
        made.load_state_dict(tensors(weights))
    except RuntimeError as fault:
        raise InputError(
            f"not the weights of {network}, {one_line(fault)}", weights, "give its options"
        ) from fault
    sides = {} if at else {2: "height", 3: "width"}
    height, width = map(int, (at or f"{_SIDE}x{_SIDE}").split("x"))
    image = torch.rand(1, 3, height, width)
    try:
        content = _onnx(made.eval(), image, sides)
    except Exception as fault:  # of torch, onnx and others' code
        remedy = "give a size that it takes as at=HEIGHTxWIDTH, or run its own program by method=command"
        raise InputError(f"cannot be exported, {one_line(fault)}", network, remedy) from fault
    write_atomically(target, content)


def _onnx(network: Any, image: Any, sides: Mapping[int, str]) -> bytes:
    """Return a network as ONNX. sides: of the image, whose length may be another."""
    import torch

    content: Any = io.BytesIO()
    torch.onnx.export(
        network,
        (image,),
        content,
        input_names=["image"],
        output_names=["restored"],
        dynamic_axes={"image": sides, "restored": sides},
        dynamo=False,
    )
    written: bytes = content.getvalue()
    return written


def _main(words: list[str]) -> None:
    if (
        len(words) < 2
        or Path(words[1]).suffix not in (".pt", ".onnx")
        or (words[1][-3:] == ".pt") != (len(words) == 2)
    ):
        print(__doc__, file=sys.stderr)
        sys.exit(2)
    weights, target, *network = words
    try:
        require("export", "torch", *(["onnx"] if network else []))
        if Path(target).exists():
            raise InputError("is there", target, "give a new file, or move this one away")
        for word in network[1:]:
            if not re.fullmatch(r"at=\d+x\d+|(?!at=)\w+=-?\d+", word):
                raise InputError(
                    "is no option", word, "write OPTION=NUMBER, or at=HEIGHTxWIDTH"
                )
        given = dict(word.split("=", 1) for word in network[1:])
        at = given.pop("at", "")
        if network:
            export(
                Path(weights),
                Path(target),
                network[0],
                {name: int(value) for name, value in given.items()},
                at,
            )
        else:
            import torch

            content = io.BytesIO()
            torch.save(tensors(Path(weights)), content)
            write_atomically(Path(target), content.getvalue())
    except SucreBenchError as fault:
        print(f"error: {fault}", file=sys.stderr)
        sys.exit(2)
    print(target)


if __name__ == "__main__":
    _main(sys.argv[1:])
