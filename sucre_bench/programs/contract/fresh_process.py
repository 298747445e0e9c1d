"""Runs plugins in a fresh process: cost and side effects of their import, and whether they restore equally there.

`python -m sucre_bench.programs.contract.fresh_process` is that process. It reads what to do as JSON, and its last line
is JSON.
"""

import contextlib
import importlib
import json
import os
import random
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from sucre_bench.arrays import Array
from sucre_bench.errors import ANY_FAULT, PluginError, one_line
from sucre_bench.machine.children import python
from sucre_bench.programs.contract.contract import Subject
from sucre_bench.programs.contract.made_scenes import TARGET, submerged
from sucre_bench.programs.contract.process_state import changed, snapshot

# Packages that take long to import; they belong inside the functions that use them.
HEAVY = frozenset(
    [
        *("torch", "torchvision", "tensorflow", "jax", "onnx", "onnxruntime", "numba", "kornia", "sklearn", "scipy"),
        *("skimage", "cv2", "colour", "open3d", "pycolmap", "pandas", "matplotlib", "mlflow", "hydra", "psutil"),
    ]
)


@dataclass(frozen=True)
class Imported:
    """Effects of importing a plugin. heavy: slow packages that it imported; changed: altered global state."""

    seconds: float
    heavy: tuple[str, ...]
    changed: tuple[str, ...]


def imported(subjects: Sequence[Subject]) -> list[Imported]:
    """Import plugins one after another in a fresh process; each counts only its own effects."""
    told = _told({"places": [_place(subject) for subject in subjects]})
    return [Imported(one["seconds"], tuple(one["heavy"]), tuple(one["changed"])) for one in told]


def restored(subjects: Sequence[Subject]) -> list[Array]:
    """Restore the wall of noise in water in a fresh process with other seeds. Raises PluginError if a method fails."""
    with tempfile.TemporaryDirectory(prefix="sucre_bench_") as folder:
        methods = [
            {
                "place": _place(subject),
                "name": subject.plugin.name,
                "options": {name: str(v) if isinstance(v, Path) else v for name, v in subject.options.items()},
            }
            for subject in subjects
        ]
        for subject, fault in zip(subjects, _told({"methods": methods, "folder": folder}), strict=True):
            if fault:
                raise PluginError(f"{subject.plugin.name}: {fault}")
        return [np.load(Path(folder) / f"{number}.npy") for number in range(len(subjects))]


def _place(subject: Subject) -> str:
    """How another process imports a plugin: by its module, or by the file that was loaded if that is in no package."""
    module = subject.plugin.cls.__module__
    loaded = sys.modules[module.partition(".")[0]]
    return str(loaded.__file__) if module.startswith("sucre_bench_plugin_") else module


def _told(task: Mapping[str, Any]) -> Any:
    done = subprocess.run(
        python("-m", __name__),
        input=json.dumps(task),
        capture_output=True,
        text=True,
        check=False,
        env=_other_order_of_sets(_environment()),
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise PluginError(f"a fresh process fails: {last}; it must import wherever `sucre-bench` runs")
    return json.loads(done.stdout.splitlines()[-1])


def _other_order_of_sets(environment: Mapping[str, str]) -> dict[str, str]:
    """Let sets of texts have another order than in a process of this environment."""
    return {**environment, "PYTHONHASHSEED": "8" if environment.get("PYTHONHASHSEED") == "7" else "7"}


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


def _import_all(places: Iterable[str]) -> list[dict[str, Any]]:
    importlib.import_module("sucre_bench.plugins")
    told = []
    for place in places:
        known, before, started = set(sys.modules), snapshot(), time.process_time()
        _load(place)
        seconds = time.process_time() - started  # of the processor: others may be at work
        new = {name.split(".")[0] for name in set(sys.modules) - known}
        told.append(asdict(Imported(seconds, tuple(sorted(new & HEAVY)), tuple(changed(before, snapshot())))))
    return told


def _restore_all(methods: Iterable[Mapping[str, Any]], folder: Path) -> list[str]:
    from sucre_bench.engine import python_api

    random.seed(11)
    np.random.seed(11)
    told = []
    for number, method in enumerate(methods):
        try:
            _load(method["place"])
            scene = submerged()
            image = python_api.restore(method["name"], scene, scene[TARGET], **method["options"]).image
            np.save(folder / f"{number}.npy", image)
            told.append("")
        except ANY_FAULT as fault:
            told.append(one_line(fault))
    return told


def _main() -> None:
    task = json.load(sys.stdin)
    with contextlib.redirect_stdout(sys.stderr):
        told = _import_all(task["places"]) if "places" in task else _restore_all(task["methods"], Path(task["folder"]))
    print(json.dumps(told))


if __name__ == "__main__":
    _main()
