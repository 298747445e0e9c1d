"""Versions, source commit and machine that produced a result: ``environment.json`` beside the score table."""

import functools
import importlib.metadata
import json
import platform
import subprocess
import sys
from pathlib import Path
from typing import Any

from sucre_bench.errors import InputError
from sucre_bench.machine.cores import usable_cores
from sucre_bench.machine.files import regular, write_atomically
from sucre_bench.machine.records import masked

PACKAGES = (
    "colour-science",
    "hydra-core",
    "jax",
    "mlflow",
    "numba",
    "numpy",
    "onnxruntime",
    "open3d",
    "opencv-python-headless",
    "pandas",
    "pyarrow",
    "pycolmap",
    "scikit-image",
    "scipy",
    "torch",
)

# Import name -> name in the package index, where the two differ.
_PACKAGE = {
    "cv2": "opencv-python-headless",
    "skimage": "scikit-image",
    "colour": "colour-science",
    "hydra": "hydra-core",
    "PIL": "Pillow",
}


def environment(command: list[str], seed: int, data: dict[str, str]) -> dict[str, Any]:
    """Return command, versions, source commit, data and machine of a run. data: dataset label -> data_id."""
    import psutil

    commit, dirty = source_commit()
    processor = ""
    if sys.platform == "linux":
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return {
        "command": command,
        "sucre_bench": version_of("sucre-bench"),
        "git_commit": commit,
        "git_dirty": dirty,
        "seed": seed,
        "data": data,
        "python": platform.python_version(),
        "packages": {name: version_of(name) for name in PACKAGES},
        "machine": {
            "system": platform.platform(),
            "processor": processor or platform.processor() or platform.machine(),
            "cores": usable_cores(),
            "memory_gb": round(psutil.virtual_memory().total / 2**30, 1),
            "gpu": gpu(),
        },
    }


def distribution_of(package: str) -> str:
    """Return the name in the package index of an import name."""
    return _PACKAGE.get(package, package)


@functools.cache
def version_of(package: str) -> str | None:
    """Return an installed package's version, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def source_commit() -> tuple[str | None, bool | None]:
    """Return the source tree's commit and whether it has uncommitted changes; None, None outside a checkout."""
    here = Path(__file__).resolve().parent.parent.parent
    if not (here / ".git").exists():
        return None, None
    commit, status = (_output("git", "-C", str(here), *words) for words in (("rev-parse", "HEAD"), ("status", "-s")))
    return (None, None) if commit is None or status is None else (commit, bool(status))


def gpu() -> str | None:
    """Return the name of the first NVIDIA GPU, or None."""
    names = _output("nvidia-smi", "--query-gpu=name", "--format=csv,noheader")
    return names.splitlines()[0] if names else None


def _output(*command: str) -> str | None:
    """What a program prints, None if it fails."""
    try:
        return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


def write(path: Path, content: dict[str, Any]) -> None:
    """Write an environment as JSON, without passwords."""
    write_atomically(path, (masked(json.dumps(content, indent=2)) + "\n").encode())


def read(path: Path) -> dict[str, Any] | None:
    """Read an environment; None if the file does not exist or is no JSON."""
    try:
        content: dict[str, Any] = json.loads(regular(path).read_text(encoding="utf-8"))
    except (OSError, InputError, ValueError, RecursionError):
        return None
    return content
