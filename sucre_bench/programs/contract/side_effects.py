"""What a plugin changes in a process, in this one and in a fresh one, and whether it restores equally there.

`python -m sucre_bench.programs.contract.side_effects FILE` is the fresh process: it reads what to do from the file, and
leaves the result there.
"""

import contextlib
import functools
import hashlib
import importlib
import io
import logging
import os
import pickle
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT, PluginError, one_line
from sucre_bench.machine.processes import python
from sucre_bench.programs.contract.contract import Doubt, Subject
from sucre_bench.programs.contract.made_scenes import TARGET, enlarged, submerged

# Packages that take long to import; they belong inside the functions that use them.
HEAVY = {
    *("torch", "torchvision", "tensorflow", "jax", "onnx", "onnxruntime", "numba", "kornia", "sklearn", "scipy"),
    *("skimage", "cv2", "colour", "open3d", "pycolmap", "pandas", "matplotlib", "mlflow", "hydra", "psutil"),
}

# State of packages, if loaded.
_OF_PACKAGE: Mapping[str, Callable[[Any], dict[str, object]]] = {
    "torch": lambda torch: {
        "torch's random state": torch.random.get_rng_state().numpy().tobytes(),
        "torch's threads": torch.get_num_threads(),
        "torch's default dtype": torch.get_default_dtype(),
        "torch's gradients": torch.is_grad_enabled(),
        "torch's deterministic algorithms": torch.are_deterministic_algorithms_enabled(),
        "torch's default device": torch.get_default_device(),
    },
    "cv2": lambda cv2: {"OpenCV's threads": cv2.getNumThreads(), "OpenCV's optimisation": cv2.useOptimized()},
    "jax": lambda jax: {"JAX's 64-bit flag": jax.config.jax_enable_x64},
    "matplotlib": lambda matplotlib: {"matplotlib's style": sorted(map(str, matplotlib.rcParams.items()))},
    "pandas": lambda pandas: {"pandas' width": pandas.get_option("display.width")},
}

# Environment variables that packages set when they are first imported or run: torch for its compiler, OpenCV for its
# libraries. sucre_bench itself may be the one who imports OpenCV.
_THEIRS = ("TORCHINDUCTOR_", "TRITON_", "LD_LIBRARY_PATH")

# What to do about a change, by the beginning of its name.
_REMEDIES = {
    "os.environ": "put it back; where importing a package does it, name the package in requires=",
    "the file": "write into a folder of tempfile's, or not at all",
    "torch's random": "use a generator of its own, torch.Generator().manual_seed(self.seed)",
    "numpy's random": "use a generator of its own, numpy.random.default_rng(self.seed)",
    "random's": "use a generator of its own, numpy.random.default_rng(self.seed)",
    "": "put it back",
}


def snapshot() -> dict[str, str]:
    """Return the global state of this process: a short hash by name."""
    state: dict[str, object] = {
        "numpy's random state": [np.asarray(part).tobytes() for part in np.random.get_state(legacy=True)],
        "random's state": random.getstate(),
        "numpy's error handling": sorted(np.geterr().items()),
        "numpy's print options": sorted(map(str, np.get_printoptions().items())),
        "the working directory": Path.cwd(),
        "the search path": tuple(sys.path),
        "logging's level": logging.getLogger().level,
        "logging's handlers": len(logging.getLogger().handlers),
        "the recursion limit": sys.getrecursionlimit(),
        **{f"os.environ[{name}]": value for name, value in os.environ.items() if not name.startswith(_THEIRS)},
        **{f"the file {path.name}": "there" for path in Path().iterdir() if not path.name.startswith((".", "__"))},
    }
    for package, state_of in _OF_PACKAGE.items():
        module = sys.modules.get(package)
        if module is not None and getattr(getattr(module, "__spec__", None), "_initializing", False) is False:
            state |= state_of(module)
    return {name: hashlib.blake2b(repr(value).encode(), digest_size=8).hexdigest() for name, value in state.items()}


def changed(before: Mapping[str, str], after: Mapping[str, str]) -> list[str]:
    """Return the names of changed state. Packages loaded in between are ignored; new variables and files count.

    Files are not compared after a change of the working directory.
    """
    other = [name for name in before if after.get(name) != before[name]]
    other += [name for name in after if name not in before and name.startswith(("os.environ", "the file"))]
    moved = "the working directory" in other
    return [name for name in other if not (moved and name.startswith("the file"))]


@contextlib.contextmanager
def watched() -> Iterator[list[str]]:
    """Fill a list of findings, when the block ends, with what it changed or printed, and restore the random states.

    The random states are altered first: a plugin that always sets the same seed would else change nothing.
    """
    kept, found = (np.random.get_state(legacy=True), random.getstate()), list[str]()
    torch: Any = sys.modules.get("torch")
    torch_kept = torch.random.get_rng_state() if torch else None
    np.random.random()
    random.random()
    if torch:
        torch.rand(1)
    before = snapshot()
    try:
        # A real file, because programs that a plugin starts may inherit it.
        with io.TextIOWrapper(tempfile.TemporaryFile(), "utf-8") as printed:
            with contextlib.redirect_stdout(printed):
                yield found
            printed.seek(0)
            line = printed.read().strip().partition("\n")[0]
        for name in changed(before, snapshot()):
            remedy = next(remedy for start, remedy in _REMEDIES.items() if name.startswith(start))
            found.append(f"changes {name}; {remedy}")
        if line:
            found.append(Doubt(f"prints '{line}'; leave the terminal to whoever runs it, warnings.warn reaches people"))
    finally:
        np.random.set_state(kept[0])
        random.setstate(kept[1])
        if torch_kept is not None:
            torch.random.set_rng_state(torch_kept)


class Fresh(NamedTuple):
    """What a plugin does in a fresh process.

    seconds: of the processor for its import; heavy: slow packages that it imports; changed: global state that its
    import alters; image: its restoration (H, W, 3) of the wall of noise in water, or why there is none.
    """

    seconds: float
    heavy: list[str]
    changed: list[str]
    image: Array | str


@functools.lru_cache(maxsize=1)
def in_fresh_process(subjects: tuple[Subject, ...], restore: bool = True) -> list[Fresh]:
    """Import plugins one after another in a fresh process with other seeds, and restore with those that are methods.

    restore: False to import only. Raises PluginError if the process fails.
    """
    import psutil

    tasks = []
    for subject in subjects:
        module, options = subject.plugin.cls.__module__, dict(subject.options)
        # A module in no package is imported from the file that was loaded.
        is_file = module.startswith("sucre_bench_plugin_")
        place = str(sys.modules[module.partition(".")[0]].__file__) if is_file else module
        does_restore = restore and subject.plugin.kind == "method" and not subject.obstacle
        tasks.append((place, is_file, subject.plugin.name if does_restore else "", options, subject.factor))
    # The environment that this process was started with: a loaded plugin may have altered it since.
    environment = psutil.Process().environ()
    environment["PYTHONHASHSEED"] = "8" if environment.get("PYTHONHASHSEED") == "7" else "7"  # another order of sets
    with tempfile.TemporaryDirectory(prefix="sucre_bench_") as folder:
        file = Path(folder) / "task"
        file.write_bytes(pickle.dumps(tasks))
        command = python("-m", __name__, str(file))
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise PluginError(f"a fresh process fails: {last}; it must import wherever `sucre-bench` runs")
        return [Fresh(*values) for values in pickle.loads(file.read_bytes())]


def _do(tasks: Sequence[tuple[str, bool, str, dict[str, Any], int]]) -> list[tuple[Any, ...]]:
    """Do in the fresh process what `in_fresh_process` is asked for."""
    from sucre_bench import plugins

    imported = []
    for place, is_file, *_ in tasks:
        known, before, started = set(sys.modules), snapshot(), time.process_time()
        plugins.load_file(place) if is_file else importlib.import_module(place)
        seconds = time.process_time() - started  # of the processor: others may be at work
        new = {name.split(".")[0] for name in set(sys.modules) - known}
        imported.append((seconds, sorted(new & HEAVY), changed(before, snapshot())))
    from sucre_bench.engine import python_api

    random.seed(11)
    np.random.seed(11)
    images: list[Array | str] = []
    for _, _, method, options, factor in tasks:
        scene = enlarged(submerged(), factor)
        try:
            every = slice(factor // 2, None, factor)
            restored = python_api.restore(method, scene, scene[TARGET], **options).image if method else None
            image = "" if restored is None else np.asarray(restored)[every, every]
        except ANY_FAULT as fault:
            image = one_line(fault)
        images.append(image)
    return [(*about, image) for about, image in zip(imported, images, strict=True)]


if __name__ == "__main__":
    Path(sys.argv[1]).write_bytes(pickle.dumps(_do(pickle.loads(Path(sys.argv[1]).read_bytes()))))
