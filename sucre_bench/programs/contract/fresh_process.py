"""Runs plugins in a fresh process: cost and side effects of their import, and whether they restore equally there.

`python -m sucre_bench.programs.contract.fresh_process FILE` is that process: it reads what to do from the file, and
leaves the result there.
"""

import importlib
import os
import pickle
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT, PluginError, one_line
from sucre_bench.machine.children import python
from sucre_bench.programs.contract.contract import Subject
from sucre_bench.programs.contract.made_scenes import TARGET, submerged
from sucre_bench.programs.contract.process_state import changed, snapshot

# Packages that take long to import; they belong inside the functions that use them.
HEAVY = {
    *("torch", "torchvision", "tensorflow", "jax", "onnx", "onnxruntime", "numba", "kornia", "sklearn", "scipy"),
    *("skimage", "cv2", "colour", "open3d", "pycolmap", "pandas", "matplotlib", "mlflow", "hydra", "psutil"),
}


class Imported(NamedTuple):
    """Effects of importing a plugin. heavy: slow packages that it imported; changed: altered global state."""

    seconds: float
    heavy: tuple[str, ...]
    changed: tuple[str, ...]


def imported(subjects: Sequence[Subject]) -> list[Imported]:
    """Import plugins one after another in a fresh process; each counts only its own effects."""
    return [Imported(*one) for one in _in_fresh_process(_import_all, [_place(subject) for subject in subjects])]


def restored(subjects: Sequence[Subject]) -> list[Array]:
    """Restore the wall of noise in water in a fresh process with other seeds. Raises PluginError if a method fails."""
    methods = [(_place(subject), subject.plugin.name, dict(subject.options)) for subject in subjects]
    images = _in_fresh_process(_restore_all, methods)
    for image, subject in zip(images, subjects, strict=True):
        if isinstance(image, str):
            raise PluginError(f"{subject.plugin.name}: {image}")
    return list(images)


def _place(subject: Subject) -> str:
    """How another process imports a plugin: by its module, or by the file that was loaded if that is in no package."""
    module = subject.plugin.cls.__module__
    loaded = sys.modules[module.partition(".")[0]]
    return str(loaded.__file__) if module.startswith("sucre_bench_plugin_") else module


def _in_fresh_process(work: Any, argument: Any) -> Any:
    with tempfile.TemporaryDirectory(prefix="sucre_bench_") as folder:
        file = Path(folder) / "task"
        file.write_bytes(pickle.dumps((work.__name__, argument)))
        environment = _environment()
        # Sets of texts have another order there.
        environment["PYTHONHASHSEED"] = "8" if environment.get("PYTHONHASHSEED") == "7" else "7"
        command = python("-m", __name__, str(file))
        done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)
        if done.returncode:
            last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
            raise PluginError(f"a fresh process fails: {last}; it must import wherever `sucre-bench` runs")
        return pickle.loads(file.read_bytes())


def _environment() -> dict[str, str]:
    """The environment this process was started with: a loaded plugin may have altered it since."""
    try:
        entries = Path("/proc/self/environ").read_bytes().split(b"\0")
    except OSError:
        return dict(os.environ)
    pairs = (entry.partition(b"=") for entry in entries if entry)
    return {os.fsdecode(name): os.fsdecode(value) for name, _, value in pairs}


# -- in that process ---------------------------------------------------------------------------------------


def _load(place: str) -> None:
    from sucre_bench import plugins

    plugins.load_file(place) if place.endswith(".py") else importlib.import_module(place)


def _import_all(places: Sequence[str]) -> list[tuple[Any, ...]]:
    importlib.import_module("sucre_bench.plugins")
    done = []
    for place in places:
        known, before, started = set(sys.modules), snapshot(), time.process_time()
        _load(place)
        seconds = time.process_time() - started  # of the processor: others may be at work
        new = {name.split(".")[0] for name in set(sys.modules) - known}
        done.append((seconds, tuple(sorted(new & HEAVY)), tuple(changed(before, snapshot()))))
    return done


def _restore_all(methods: Sequence[tuple[str, str, dict[str, Any]]]) -> list[Array | str]:
    """Return the images, and text where a method fails."""
    from sucre_bench.engine import python_api

    random.seed(11)
    np.random.seed(11)
    images: list[Array | str] = []
    for place, name, options in methods:
        try:
            _load(place)
            scene = submerged()
            images.append(np.asarray(python_api.restore(name, scene, scene[TARGET], **options).image))
        except ANY_FAULT as fault:
            images.append(one_line(fault))
    return images


if __name__ == "__main__":
    task_file = Path(sys.argv[1])
    task, task_argument = pickle.loads(task_file.read_bytes())
    task_file.write_bytes(pickle.dumps(globals()[task](task_argument)))
